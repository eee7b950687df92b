"""Stiffness that is lost with every strain there and back."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _left(bars: Bars, values: Values) -> Array:
    path = np.cumsum(np.abs(np.diff(bars.strain, axis=1, prepend=bars.strain[:, :1])), axis=1)
    return np.exp(-values["fatigue_per_strain"] * path)


def _matrix_stress(bars: Bars, values: Values) -> Array:
    return bars.matrix_MPa * _left(bars, values)


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * _left(bars, values)


EFFECT = Effect(
    slug="cyclic-fatigue",
    title="Fatigue",
    description="Matrix and fibres lose a part of their stiffness with the strain that they go through, up and down "
    "alike, whether or not it is larger than before.",
    equation="S -> S exp(-fatigue_per_strain x P), P = accumulated |change of the Green-Lagrange strain|",
    reference="Wren et al. (2003) Ann Biomed Eng 31:710; Fung et al. (2009) J Orthop Res 27:264 (tendon fatigue)",
    parameters=(Parameter("fatigue_per_strain", "1", 0.0, 1.0, 0.2, "part lost per unit of strain gone through"),),
    null={"fatigue_per_strain": 0.0},
    seen_by=("peak", "unload", "valley", "later cycles"),
    confounded_with={
        "softening": "with growing peaks, both lose stiffness from cycle to cycle; equal peaks tell them apart",
        "tau_3f": "slow relaxation also lowers the peaks of a row of cycles",
        "force-drift": "a slope also lowers later peaks; it lowers the valleys as much",
    },
    no_febio="inside `viscoelastic`, `reactive fatigue` of FEBio 4.11 runs and does not fatigue",
    matrix_stress=_matrix_stress,
    fibre_stress=_fibre_stress,
)
