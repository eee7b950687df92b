"""Taut fibres: they carry load at the gauge length already."""

from dataclasses import replace

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _fibre_stretch(bars: Bars, values: Values) -> Array:
    return bars.fibre_stretch * values["preload_stretch"]


def _fibre_stress(bars: Bars, values: Values) -> Array:
    return bars.fibre_MPa * values["preload_stretch"]


_RELAXED = Effect(
    slug="preload",
    title="Prestretched fibres",
    description="The gauge length was measured under a preload: the fibres are stretched, and relaxed, at zero "
    "displacement, so there is force at rest and little or no toe.",
    equation="fibre stretch = preload_stretch x stretch; S_f -> preload_stretch x S_f(fibre stretch)",
    reference="Maas et al. (2016) J Mech Behav Biomed Mater 61:499 (prestrain)",
    parameters=(
        Parameter(
            "preload_stretch", "1", 1.0, 1.02, 1.004, "stretch of the fibres at gauge length", floor=0.5, strain_power=1
        ),
    ),
    null={"preload_stretch": 1.0},
    seen_by=("rest", "toe", "ramp", "valley"),
    confounded_with={
        "alpha_f": "a softer exponent also gives load at small strains",
        "force-drift": "an offset is force at rest too; it does not change the toe",
        "area-error": "with the toe gone, both mostly scale the force",
    },
    febio={
        "fibre_elastic": """\
<elastic type="prestrain elastic">
  [[ elastic ]]
  <prestrain type="prestrain gradient">
    <ramp>1</ramp>
    <F0>1,0,0,0,1,0,0,0,{{ parameters.preload_stretch | full }}</F0>
  </prestrain>
</elastic>"""
    },
    loaded_at_rest=True,
    fibre_stretch=_fibre_stretch,
    fibre_stress=_fibre_stress,
)

UNRELAXED = replace(
    _RELAXED,
    form="unrelaxed",
    title="Prestretched fibres, not relaxed",
    description="The specimen was mounted under a preload right before the test: the force of the prestretched fibres "
    "comes with the first step, and relaxes during the test.",
    equation="as the relaxed form, but no history before the first step",
    loaded_at_rest=False,
    unrelaxed=True,
)
EFFECT = replace(_RELAXED, other_forms=(UNRELAXED,))
