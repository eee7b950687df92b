"""Stiffness that is lost with every strain there and back."""

from typing import Any

import numpy as np

from sinew.runner.compiled import at_first_call
from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _left(bars: Bars, values: Values) -> Array:
    path = np.cumsum(np.abs(np.diff(bars.strain, axis=1, prepend=bars.strain[:, :1])), axis=1)
    return np.exp(-values["fatigue_per_strain"] * path)


def _matrix_stress(bars: Bars, values: Values) -> Array:
    return bars.matrix_MPa * _left(bars, values)


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * _left(bars, values)


def _not_healed(bars: Bars, values: Values) -> Array:
    path = np.abs(np.diff(bars.strain, axis=1, prepend=bars.strain[:, :1]))
    left = np.empty_like(path)
    _tire_and_heal(values["fatigue_per_strain"] * path, values["healing_rate"] * bars.steps_s, left)
    return left


@at_first_call()
def _tire_and_heal(tiring: Any, healing: Any, left: Any) -> None:
    """Write the part of the stiffness that is left ``[n, t]``: exact where both rates are constant in a step."""
    for row in range(tiring.shape[0]):
        lost = 0.0
        for t in range(tiring.shape[1]):
            both = tiring[row, t] + healing[row, t]
            if both > 0.0:
                lost += (tiring[row, t] / both - lost) * -np.expm1(-both)
            left[row, t] = 1.0 - lost


def _healing_matrix_stress(bars: Bars, values: Values) -> Array:
    return bars.matrix_MPa * _not_healed(bars, values)


def _healing_fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * _not_healed(bars, values)


_NO_FEBIO = "inside `viscoelastic`, `reactive fatigue` of FEBio 4.11 runs and does not fatigue"
_CONFOUNDED = {
    "softening": "with growing peaks, both lose stiffness from cycle to cycle; equal peaks tell them apart",
    "tau_3f": "slow relaxation also lowers the peaks of a row of cycles",
    "force-drift": "a slope also lowers later peaks; it lowers the valleys as much",
}

HEALING = Effect(
    slug="cyclic-fatigue",
    form="healing",
    title="Fatigue that heals",
    description="Bonds that break in the cycles form anew with time, so stiffness comes back in holds and pauses.",
    equation="S -> S (1 - D), dD = fatigue_per_strain (1 - D) |dE| - healing_rate D dt, E = Green-Lagrange strain",
    reference="Hingorani et al. (2004) Ann Biomed Eng 32:306 (recovery); Lemaitre (1985) J Eng Mater Technol 107:83",
    parameters=(
        Parameter(
            "fatigue_per_strain", "1", 0.0, 5.0, 0.8, "part lost per unit of strain gone through", strain_power=-1
        ),
        Parameter("healing_rate", "1/s", 0.0, 0.2, 0.02, "part of the loss that comes back per second"),
    ),
    null={"fatigue_per_strain": 0.0},
    seen_by=("peak", "unload", "valley", "later cycles", "late hold"),
    confounded_with={**_CONFOUNDED, "relaxation-mode": "what heals in a hold makes its relaxation slower"},
    no_febio=_NO_FEBIO,
    matrix_stress=_healing_matrix_stress,
    fibre_stress=_healing_fibre_stress,
)

EFFECT = Effect(
    slug="cyclic-fatigue",
    title="Fatigue",
    description="Matrix and fibres lose a part of their stiffness with the strain that they go through, up and down "
    "alike, whether or not it is larger than before.",
    equation="S -> S exp(-fatigue_per_strain x P), P = accumulated |change of the Green-Lagrange strain|",
    reference="Wren et al. (2003) Ann Biomed Eng 31:710; Fung et al. (2009) J Orthop Res 27:264 (tendon fatigue)",
    parameters=(
        Parameter(
            "fatigue_per_strain", "1", 0.0, 1.0, 0.2, "part lost per unit of strain gone through", strain_power=-1
        ),
    ),
    null={"fatigue_per_strain": 0.0},
    seen_by=("peak", "unload", "valley", "later cycles"),
    confounded_with=_CONFOUNDED,
    no_febio=_NO_FEBIO,
    other_forms=(HEALING,),
    matrix_stress=_matrix_stress,
    fibre_stress=_fibre_stress,
)
