"""A matrix that stiffens with strain."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _matrix_stress(bars: Bars, values: Values) -> Array:
    return bars.matrix_MPa * np.exp(values["matrix_stiffening"] * bars.strain**2)


EFFECT = Effect(
    slug="matrix-stiffening",
    title="Stiffening of the matrix",
    description="The matrix is itself a network of coiled molecules, and stiffens when it is stretched or compressed.",
    equation="S_m -> S_m exp(matrix_stiffening x E^2), E = Green-Lagrange strain (Fung's law in one dimension)",
    reference="Fung (1967) Am J Physiol 213:1532; Fung et al. (1979) Am J Physiol 237:H620",
    parameters=(Parameter("matrix_stiffening", "1", 0.0, 1000.0, 300.0, "exponent of the matrix", strain_power=-2),),
    null={"matrix_stiffening": 0.0},
    seen_by=("ramp", "peak", "valley", "compression"),
    confounded_with={
        "E_f": "beyond the toe, fibres and a stiffened matrix pull alike; they relax differently",
        "alpha_f": "both bend the force upwards",
    },
    no_febio="its Fung materials are not the linear matrix of the template where the exponent is zero",
    matrix_stress=_matrix_stress,
)
