"""Slack fibres: they begin to carry load only when the bar is stretched beyond its gauge length."""

from tasks.model.effect import Array, Bars, Effect, Values
from tasks.model.parameters import Parameter


def _fibre_stretch(bars: Bars, values: Values) -> Array:
    return bars.fibre_stretch * values["slack_stretch"]


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * values["slack_stretch"]


EFFECT = Effect(
    slug="toe-slack",
    title="Slack fibres",
    description="At the gauge length as measured the fibres are still crimped or slack; they are taut only at a "
    "stretch of 1 / slack_stretch, so the toe is longer and the force at a given stretch is smaller.",
    equation="fibre stretch = slack_stretch x stretch; S_f -> slack_stretch x S_f(fibre stretch)",
    reference="Fratzl et al. (1998) J Struct Biol 122:119; "
    "Maas et al. (2016) J Mech Behav Biomed Mater 61:499 (prestrain)",
    parameters=(Parameter("slack_stretch", "1", 0.97, 1.0, 0.99, "fibre stretch at gauge length", exclusive=True),),
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
