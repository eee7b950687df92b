"""Slack fibres: they begin to carry load only when the bar is stretched beyond its gauge length."""

from dataclasses import replace

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Law, Values
from sinew.tasks.model.parameters import Parameter

FAMILIES = 12  # of fibres, by their slack


def _fibre_stretch(bars: Bars, values: Values) -> Array:
    return bars.fibre_stretch * values["slack_stretch"]


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * values["slack_stretch"]


def _recruited(law: Law, values: Values) -> Law:
    nodes, weights = np.polynomial.legendre.leggauss(FAMILIES)
    mean = values["slack_stretch"]
    each = [1.0 - (1.0 - mean) * (1.0 + values["slack_spread"] * node) for node in nodes]

    def together(stretch: Array) -> Array:
        # the stretch given includes the mean already, and its stress will be multiplied by it
        own = [own / mean for own in each]
        found = np.zeros_like(stretch)
        for weight, one in zip(weights, own, strict=True):
            found += 0.5 * weight * one * law(one * stretch)
        return found

    return together


_TOGETHER = Effect(
    slug="toe-slack",
    title="Slack fibres",
    description="At the gauge length as measured the fibres are still crimped or slack; they are taut only at a "
    "stretch of 1 / slack_stretch, so the toe is longer and the force at a given stretch is smaller.",
    equation="fibre stretch = slack_stretch x stretch; S_f -> slack_stretch x S_f(fibre stretch)",
    reference="Fratzl et al. (1998) J Struct Biol 122:119; "
    "Maas et al. (2016) J Mech Behav Biomed Mater 61:499 (prestrain)",
    parameters=(
        Parameter(
            "slack_stretch", "1", 0.97, 1.0, 0.99, "fibre stretch at gauge length", exclusive=True, strain_power=1
        ),
    ),
    null={"slack_stretch": 1.0},
    seen_by=("toe", "ramp", "peak", "valley", "later cycles"),
    confounded_with={
        "alpha_f": "a stiffer exponent also moves the load to larger strains",
        "toe-exponent": "both lengthen the toe",
        "grip-slip": "lost displacement at the first loading looks like slack; it differs in later cycles",
        "permanent-set": "both take load from small strains; a set grows with the peaks",
    },
    febio={
        "fibre_elastic": """\
<elastic type="prestrain elastic">
  [[ elastic ]]
  <prestrain type="prestrain gradient">
    <ramp>1</ramp>
    <F0>1,0,0,0,1,0,0,0,{{ parameters.slack_stretch | full }}</F0>
  </prestrain>
</elastic>"""
    },
    fibre_stretch=_fibre_stretch,
    fibre_stress=_fibre_stress,
)

SPREAD = replace(
    _TOGETHER,
    form="spread",
    title="Slack fibres, one after the other",
    description="Crimped fibres are of different lengths, so they become taut one after the other: the toe is long and "
    "round.",
    equation="S_f -> mean of s S_f(s x stretch) over s from slack_stretch + slack_spread (1 - slack_stretch) to "
    "slack_stretch - slack_spread (1 - slack_stretch), all as frequent",
    reference="Kastelic et al. (1980) J Biomech 13:887; Hurschler et al. (1997) J Biomech Eng 119:392",
    parameters=(
        *_TOGETHER.parameters,
        Parameter("slack_spread", "1", 0.0, 1.0, 0.5, "half of the range of slack, in parts of the mean"),
    ),
    febio={},
    no_febio="fibres with prestretches of their own are as many materials, which the template does not have",
    fibre_law=_recruited,
)
EFFECT = replace(_TOGETHER, other_forms=(SPREAD,))
