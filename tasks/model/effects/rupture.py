"""A part of the specimen that tears at a strain, once and for all."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter

BUNDLES = 4  # that can tear one after the other
LEAST = 0.02  # part that never tears


def _left(bars: Bars, values: Values) -> Array:
    largest = np.maximum.accumulate(bars.strain, axis=1)
    torn = np.zeros_like(largest)
    for bundle in range(BUNDLES if "tearing_distance" in values else 1):
        begin = values["tearing_strain"] + (bundle * values["tearing_distance"] if bundle else 0.0)
        torn += np.clip((largest - begin) / values["tearing_range"], 0.0, 1.0)
    return np.maximum(1.0 - values["torn_part"] * torn, LEAST)


def _matrix_stress(bars: Bars, values: Values) -> Array:
    return bars.matrix_MPa * _left(bars, values)


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * _left(bars, values)


_PARAMETERS = (
    Parameter("torn_part", "1", 0.0, 0.15, 0.05, "part of the stress that is lost"),
    Parameter("tearing_strain", "1", 0.002, 0.05, 0.018, "strain at which tearing begins", strain_power=1),
    Parameter(
        "tearing_range", "1", 1e-3, 0.02, 0.004, "range of strain in which a bundle tears", floor=1e-3, strain_power=1
    ),
)
_SEEN = ("ramp", "peak", "unload", "later cycles")
_CONFOUNDED = {
    "softening": "both lose stiffness at new largest strains, softening over a wide range and in the fibres alone",
    "cyclic-fatigue": "both lower later cycles; a rupture comes once",
}
_NO_FEBIO = "its partial holds fibres and matrix apart, and both would have to tear at one strain"

SEVERAL = Effect(
    slug="rupture",
    form="several",
    title="Rupture of one bundle after the other",
    description="Bundles tear one after the other at strains in equal steps, and each takes the same part of the "
    "stress with it.",
    equation="as above, summed over 4 bundles that begin to tear at tearing_strain + k x tearing_distance",
    reference="Liao and Belkoff (1999) J Biomech 32:183 (sequential failure of fibres)",
    parameters=(
        *_PARAMETERS,
        Parameter("tearing_distance", "1", 0.002, 0.05, 0.008, "strain between two bundles", strain_power=1),
    ),
    null={"torn_part": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    no_febio=_NO_FEBIO,
    matrix_stress=_matrix_stress,
    fibre_stress=_fibre_stress,
)

EFFECT = Effect(
    slug="rupture",
    title="Partial rupture",
    description="A bundle tears within a narrow range of strain: fibres and matrix lose a part of their stress, for "
    "good.",
    equation="S -> S (1 - torn_part x clip((X - tearing_strain) / tearing_range, 0, 1)), X = largest Green-Lagrange "
    "strain so far",
    reference="Liao and Belkoff (1999) J Biomech 32:183 (sequential failure of fibres)",
    parameters=_PARAMETERS,
    null={"torn_part": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    no_febio=_NO_FEBIO,
    other_forms=(SEVERAL,),
    matrix_stress=_matrix_stress,
    fibre_stress=_fibre_stress,
)
