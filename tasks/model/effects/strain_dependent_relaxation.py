"""Relaxation times that depend on the strain."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _slowing(bars: Bars, values: Values) -> Array:
    return np.exp(values["slowing_per_strain"] * bars.strain)


EFFECT = Effect(
    slug="strain-dependent-relaxation",
    title="Strain-dependent relaxation",
    description="Relaxation becomes slower (or faster) with strain, so holds at different strains are no scaled copies "
    "of each other.",
    equation="tau_i -> tau_i exp(slowing_per_strain x E) for all six times, E = present Green-Lagrange strain",
    reference="Provenzano et al. (2001) Ann Biomed Eng 29:908; Duenwald et al. (2009) Ann Biomed Eng 37:1131",
    parameters=(
        Parameter(
            "slowing_per_strain",
            "1",
            -60.0,
            60.0,
            25.0,
            "logarithm of the times per strain",
            floor=-np.inf,
            strain_power=-1,
        ),
    ),
    null={"slowing_per_strain": 0.0},
    seen_by=("early hold", "middle hold", "late hold", "unload", "later cycles"),
    confounded_with={
        "tau_2f": "at one strain it is a change of all times; holds at two strains tell them apart",
        "relaxation-mode": "both change the shape of a hold",
    },
    no_febio="the times of its `viscoelastic` are constants",
    slowing=_slowing,
)
