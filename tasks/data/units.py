"""Units of measured quantities, and their factors to the units that sinew computes in: s, mm, N, MPa and 1."""

import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

Units = Mapping[str, float]
LONGEST = 40  # characters of a spelling

MASSES = frozenset({"g", "gram", "grams", "kg", "mg"})  # that some write for a force
TIME: Units = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "min": 60.0,
    "minutes": 60.0, "us": 1e-6, "µs": 1e-6, "h": 3600.0,
}  # fmt: skip
LENGTH: Units = {
    "mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "nm": 1e-6, "in": 25.4, "mil": 0.0254, "ft": 304.8,
}  # fmt: skip
FORCE: Units = {
    "N": 1.0, "kN": 1e3, "mN": 1e-3, "cN": 1e-2, "daN": 10.0, "uN": 1e-6, "µN": 1e-6, "nN": 1e-9, "pN": 1e-12,
    "lbf": 4.4482216152605, "kgf": 9.80665, "kp": 9.80665,
    "tf": 9806.65, "kip": 4448.2216152605, "gf": 9.80665e-3, "ozf": 0.27801385095378125, "dyn": 1e-5,
    "newton": 1.0, "newtons": 1.0,
}  # fmt: skip
STRESS: Units = {
    "Pa": 1e-6, "kPa": 1e-3, "MPa": 1.0, "GPa": 1e3, "N/mm2": 1.0, "N/mm^2": 1.0, "N/mm²": 1.0, "N/cm2": 1e-2,
    "kN/mm2": 1e3, "kgf/mm2": 9.80665, "kgf/cm2": 9.80665e-2, "bar": 0.1, "mbar": 1e-4, "psi": 6.894757293168e-3,
    "ksi": 6.894757293168, "MN/m2": 1.0, "MN/m^2": 1.0, "MN/m²": 1.0, "kN/m2": 1e-3, "kN/m²": 1e-3,
}  # fmt: skip
AREA: Units = {
    "mm2": 1.0, "mm^2": 1.0, "mm²": 1.0, "cm2": 100.0, "cm^2": 100.0, "cm²": 100.0, "um2": 1e-6, "µm²": 1e-6,
    "m2": 1e6, "m²": 1e6, "in2": 645.16, "in²": 645.16,
}  # fmt: skip
NUMBER: Units = {"1": 1.0, "-": 1.0, "mm/mm": 1.0, "m/m": 1.0, "in/in": 1.0, "L/L0": 1.0}
FRACTION: Units = {
    "%": 0.01, "percent": 0.01, "pct": 0.01, "‰": 1e-3, "mm/m": 1e-3, "µm/m": 1e-6, "µε": 1e-6, **NUMBER,
}  # fmt: skip

#: Other spellings, which no message lists.
_SPELLINGS = {
    "minute": "min", "mins": "min", "minuten": "min", "minutos": "min", "分": "min", "分钟": "min",
    "hr": "h", "hour": "h", "hours": "h", "sek": "s", "sec.": "s", "sek.": "s",
    "seg": "s", "sekunden": "s", "secondes": "s", "segundos": "s",
    "秒": "s", "초": "s", "毫秒": "ms", "millisecond": "ms", "milliseconds": "ms", "msecs": "ms", "millis": "ms",
    "inch": "in", "inches": "in", '"': "in", "mils": "mil", "feet": "ft", "毫米": "mm", "厘米": "cm", "微米": "um",
    "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm", "micron": "um", "microns": "um",
    "lb": "lbf", "lbs": "lbf", "pounds": "lbf", "kilonewton": "kN", "牛": "N", "牛顿": "N", "千牛": "kN", "克力": "gf",
    "grams force": "gf", "gram-force": "gf", "kg f": "kgf", "dyne": "dyn", "dynes": "dyn",
    "kips": "kip",
    "n/m2": "Pa", "pascal": "Pa", "兆帕": "MPa", "千帕": "kPa", "帕": "Pa", "sq mm": "mm2", "sq in": "in2",
    "lbf/in2": "psi", "lb/in2": "psi", "lbs/in2": "psi", "sn": "s", "saniye": "s", "sekund": "s", "sekunder": "s",
    "microstrain": "µε", "micro strain": "µε", "µstrain": "µε", "ustrain": "µε", "promille": "‰",
    "cm/cm": "1", "µm/µm": "1", "in./in.": "1",
    "per cent": "%", "prozent": "%", "unitless": "1", "dimensionless": "1",
    "с": "s", "сек": "s", "мс": "ms", "мин": "min", "мм": "mm", "см": "cm", "м": "m", "мкм": "um", "н": "N", "кн": "kN",
    "мм2": "mm2", "см2": "cm2", "кв. мм": "mm2", "н/мм2": "N/mm2", "平方毫米": "mm2",
    "кгс": "kgf", "па": "Pa", "кпа": "kPa", "мпа": "MPa", "гпа": "GPa",
}  # fmt: skip
#: Units of what is no column of a test: of frequencies, angles, torques and temperatures.
FREQUENCIES = frozenset({"hz", "khz"})
ANGLES = frozenset({"deg", "deg.", "degree", "degrees", "°", "rad", "radian", "radians", "grad", "度"})
_OTHERS = FREQUENCIES | ANGLES | {"°c", "°f", "n.m", "n·m", "n*m", "\u03bcn.m", "mn.m", "kn.m", "n.mm", "n·mm", "n*mm"}
EITHER = " or "  # between units that contradict each other
_EVERY = (TIME, LENGTH, FORCE, STRESS, AREA, FRACTION)
#: Spellings whose prefix may be milli or mega. Those of ``_EXACT`` count as they are written, the others not at all.
_EXACT = ("mN", "MN/m2", "MN/m^2", "MN/m²")
_AMBIGUOUS = ("mn", "MN", "mPa", "Mbar", "мПа")


def factor(units: Units, unit: str) -> float | None:
    """The factor of ``unit`` in a table; None if it is not there or ambiguous. Upper and lower case are the same."""
    if unit in units:
        return units[unit]
    if len(unit) > LONGEST or ambiguous(unit):
        return None
    folded = _folded(unit)
    folded = _folded(_SPELLINGS.get(folded, folded))
    return next((value for name, value in units.items() if _folded(name) == folded and name not in _EXACT), None)


@lru_cache(maxsize=2**14)
def _folded(name: str) -> str:
    """In lower case, with plain digits for raised ones, and one letter for both characters for micro."""
    return _plain(name).casefold().replace("^", "")


@lru_cache(maxsize=2**14)
def _plain(name: str) -> str:
    return " ".join(unicodedata.normalize("NFKC", name).split())  # full-width letters become plain ones


def usual(units: Units, unit: str) -> str:
    """The spelling of ``unit`` in a table, such as ``s`` for ``S``; the same text for one that is not in it."""
    same = [name for name, value in units.items() if value == factor(units, unit)]
    return unit if unit in units or not same else next((n for n in same if n.casefold() == unit.casefold()), same[0])


def ambiguous(unit: str) -> bool:
    """Whether a spelling may mean two units, such as millinewton and meganewton."""
    return len(unit) <= LONGEST and _plain(unit) in _AMBIGUOUS


@lru_cache(maxsize=2**14)
def is_unit(text: str) -> bool:
    """Whether a text is a unit of any quantity."""
    return ambiguous(text) or any(factor(units, text) is not None for units in _EVERY)


def is_other(text: str) -> bool:
    """Whether a text is a unit of a frequency, an angle, a torque or a temperature, which no column of a test has."""
    return len(text) <= LONGEST and _plain(text).casefold() in _OTHERS


def agreed(told: Sequence[str]) -> str:
    """The unit that several places tell, of which some may be empty; "N or kN" where they contradict each other.

    What is no unit counts where no place tells one, and a bare number (a channel's) beside no other unit.
    """
    known = [text for text in told if is_unit(text)]
    known = [text for text in known if text not in ("1", "-")] or known
    if not known:
        return next(filter(None, told), "")
    others = [text for text in known if not _same(text, known[0])]
    return EITHER.join((known[0], *dict.fromkeys(others)))


def _same(one: str, other: str) -> bool:
    """Whether two spellings are of one unit."""
    return one == other or any(factor(u, one) == factor(u, other) is not None for u in _EVERY)


def to_own(unit: str) -> tuple[float, str] | None:
    """The factor of a unit of any quantity to that which sinew computes in, and this one; None if it is not known."""
    own = ("s", "mm", "N", "MPa", "mm2", "1")
    found = ((factor(table, unit), name) for table, name in zip(_EVERY, own, strict=True))
    return next(((value, name) for value, name in found if value is not None), None)


def is_rate(unit: str) -> bool:
    """Whether a unit is one of a change in time or of a frequency, such as mm/s, %/min or Hz."""
    per = unit.rpartition("/")[2].strip()
    return unit.casefold() in FREQUENCIES or ("/" in unit and factor(TIME, per) is not None)


def is_reciprocal(unit: str) -> bool:
    """Whether a unit is one over another, such as 1/MPa of a compliance."""
    return unit.startswith("1/")


def belongs_elsewhere(units: Units, unit: str) -> bool:
    """Whether a unit is not in a table but in that of another quantity. A bare number belongs to none."""
    known = factor(NUMBER, unit) is None and any(factor(other, unit) is not None for other in _EVERY)
    return known and factor(units, unit) is None


def listed(units: Units) -> tuple[str, ...]:
    """One name for each unit in a table, for messages and for answers."""
    names: dict[float, str] = {}
    for name, value in units.items():
        names.setdefault(value, name)
    return tuple(names.values())


def merged(tables: Iterable[Units]) -> tuple[str, ...]:
    """The same for several tables."""
    return tuple(dict.fromkeys(name for units in tables for name in listed(units)))
