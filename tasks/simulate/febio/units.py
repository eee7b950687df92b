"""FEBio's systems of units."""

UNITS = {
    "mm-N-s": (1.0, 1.0),
    "SI": (1e-3, 1.0),
    "CGS": (1e-1, 1e-5),
    "mm-kg-s": (1.0, 1e-3),
    "mm-g-s": (1.0, 1e-6),
    "mm-mg-s": (1.0, 1e-9),
    "um-nN-s": (1e3, 1e-9),
}
"""FEBio's systems of units: a millimetre in the unit of length, and the unit of force in newtons."""

MILLIMETRES = "mm-N-s"  # of a model that names none


def stress_MPa(name: str) -> float:
    """A system's unit of stress in MPa. Raises :class:`KeyError` for one that is not known."""
    millimetre, newtons = UNITS[name]
    return newtons * millimetre**2
