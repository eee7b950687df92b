"""A matrix that yields, and keeps a part of the strain."""

import numpy as np

from sinew.runner.compiled import at_first_call
from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter

FAMILIES, BIAS = 11, 0.9  # those with weight of FEBio's 12 families, and its ratio of neighbouring weights


def _families(values: Values) -> tuple[Array, Array]:
    """Weights and yield stresses (MPa) of the families of bonds, each ``[n, 11]``: FEBio's "PFC paper"."""
    parts = BIAS ** np.arange(FAMILIES)
    parts /= parts.sum()
    weights = values["yielding_part"] * parts
    before = np.cumsum(weights, axis=1) - weights
    return weights, values["yield_stress"] + np.cumsum(values["yield_spread"] * parts / (1.0 - before), axis=1)


def _matrix_stress(bars: Bars, values: Values) -> Array:
    stress = np.empty_like(bars.matrix_MPa)
    _slide(np.ascontiguousarray(bars.matrix_MPa), *_families(values), stress)
    return stress


@at_first_call()
def _slide(elastic, weights, limits, stress):  # type: ignore[no-untyped-def]
    """Each family follows the elastic stress and slides where it would bear more than its limit."""
    for row in range(elastic.shape[0]):
        slid = np.zeros(weights.shape[1])
        bonded = 1.0 - weights[row].sum()
        for t in range(elastic.shape[1]):
            total = bonded * elastic[row, t]
            for family in range(weights.shape[1]):
                borne = min(max(elastic[row, t] - slid[family], -limits[row, family]), limits[row, family])
                slid[family] = elastic[row, t] - borne
                total += weights[row, family] * borne
            stress[row, t] = total


EFFECT = Effect(
    slug="permanent-set",
    title="Permanent set of the matrix",
    description="Bonds of the matrix yield, a few first and more later, and keep the strain at which they did: after "
    "unloading the matrix pushes back. Each family of bonds is elastic up to its limit and slides beyond.",
    equation="S_m = sum over families of weight x clip(E_m (E - slid), +- limit) + the rest elastic; 11 families with "
    "limits from yield_stress on, spaced so that the whole hardens over yield_spread",
    reference="Iwan (1967) J Appl Mech 34:612; Zimmerman et al. (2021) J Mech Phys Solids 155:104534 (FEBio)",
    parameters=(
        Parameter("yielding_part", "1", 0.0, 0.95, 0.85, "part of the bonds that can yield", ceiling=1.0),
        Parameter("yield_stress", "MPa", 0.1, 2.0, 0.7, "stress at which the first bonds yield"),
        # the least is a limit of the law: all bonds yield at one stress, Prager's plasticity with linear hardening
        Parameter("yield_spread", "MPa", 0.0, 1.5, 0.4, "rise of the stress until all have yielded"),
    ),
    null={"yielding_part": 0.0},
    seen_by=("ramp", "peak", "unload", "valley", "later cycles"),
    confounded_with={
        "softening": "both lower the force below the largest strain so far; a set pushes back in the valleys",
        "grip-slip": "both leave the bar slack after unloading; slip shifts the fibres as well",
        "E_m": "a matrix that has yielded throughout is softer",
    },
    febio={
        "matrix_elastic": """\
<elastic type="reactive plasticity">
  [[ elastic ]]
  <yield_criterion type="DC von Mises stress"/>
  <flow_curve type="PFC paper">
    <Y0>{{ parameters.yield_stress | full }}</Y0>
    <Ymax>{{ (parameters.yield_stress + parameters.yield_spread) | full }}</Ymax>
    <w0>0</w0>
    <we>{{ (1 - parameters.yielding_part) | full }}</we>
    <nf>12</nf>
    <r>0.9</r>
  </flow_curve>
  <isochoric>1</isochoric>
</elastic>"""
    },
    matrix_stress=_matrix_stress,
)
