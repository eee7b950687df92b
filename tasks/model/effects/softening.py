"""Softening of the fibres by the largest strain so far (Mullins), with damage in two forms: Weibull and Simo."""

import numpy as np

from sinew.tasks.model import fibre
from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _weibull(bars: Bars, values: Values) -> Array:
    largest = np.maximum.accumulate(np.maximum(bars.fibre_strain, 0.0), axis=1)
    damage = -values["softening_loss"] * np.expm1(
        -np.float_power(largest / values["softening_strain"], values["softening_shape"])
    )
    return bars.fibre_MPa * (1.0 - damage)


def _simo(bars: Bars, values: Values) -> Array:
    a, b = values["softening_stress_root"], values["softening_rest"]
    drive = np.sqrt(2.0 * fibre.energy(bars.fibre_stretch, bars.material))
    ratio = np.maximum(np.maximum.accumulate(drive, axis=1) / a, 1e-9)
    return bars.fibre_MPa * (b - (1.0 - b) * np.expm1(-ratio) / ratio)


_PHASES = ("peak", "unload", "valley", "later cycles")
_CONFOUNDED = {
    "E_f": "damage reached in the first ramp lowers the stiffness for good; only reloading tells them apart",
    "permanent-set": "both lower the force below the largest strain so far; a set also shifts where it begins",
    "cyclic-fatigue": "with growing peaks, both lose stiffness from cycle to cycle",
}

SIMO = Effect(
    slug="softening",
    form="simo",
    title="Softening by the largest energy (Simo)",
    description="Fibres lose stiffness with the largest elastic energy that they have held.",
    equation="S_f -> S_f (b + (1 - b)(1 - exp(-x / a)) a / x), x = largest sqrt(2 W_f) so far; "
    "a = softening_stress_root, b = softening_rest",
    reference="Simo (1987) Comput Methods Appl Mech Eng 60:153",
    parameters=(
        Parameter("softening_stress_root", "MPa^0.5", 0.05, 2.0, 0.25, "root of energy that damages", exclusive=True),
        Parameter("softening_rest", "1", 0.3, 1.0, 0.7, "part of the stress that is never lost"),
    ),
    null={"softening_rest": 1.0},
    seen_by=_PHASES,
    confounded_with=_CONFOUNDED,
    febio={
        "fibre_elastic": """\
<elastic type="elastic damage">
  [[ elastic ]]
  <damage type="CDF Simo">
    <a>{{ parameters.softening_stress_root | full }}</a>
    <b>{{ parameters.softening_rest | full }}</b>
    <Dmax>1</Dmax>
  </damage>
  <criterion type="DC Simo"/>
</elastic>"""
    },
    fibre_stress=_simo,
)

EFFECT = Effect(
    slug="softening",
    title="Softening by the largest strain (Mullins)",
    description="Fibres or their links break as the strain exceeds all before; below that strain the rest stays as it "
    "is. The first pull to a strain is stiffer than all later ones.",
    equation="S_f -> S_f (1 - D), D = softening_loss (1 - exp(-(X / softening_strain)^softening_shape)), "
    "X = largest Green-Lagrange fibre strain so far",
    reference="Mullins (1969) Rubber Chem Technol 42:339; Nims et al. (2016) Interface Focus 6:20150063",
    parameters=(
        Parameter("softening_loss", "1", 0.0, 0.9, 0.3, "part of the stress that can be lost", ceiling=1.0),
        Parameter("softening_shape", "1", 0.4, 5.0, 2.0, "shape of the Weibull distribution", exclusive=True),
        Parameter(
            "softening_strain",
            "1",
            0.002,
            0.2,
            0.03,
            "scale of the Weibull distribution",
            exclusive=True,
            strain_power=1,
        ),
    ),
    null={"softening_loss": 0.0},
    seen_by=_PHASES,
    confounded_with=_CONFOUNDED,
    febio={
        "fibre_elastic": """\
<elastic type="elastic damage">
  [[ elastic ]]
  <damage type="CDF Weibull">
    <Dmax>{{ parameters.softening_loss | full }}</Dmax>
    <alpha>{{ parameters.softening_shape | full }}</alpha>
    <mu>{{ parameters.softening_strain | full }}</mu>
    <ploc>0</ploc>
  </damage>
  <criterion type="DC max normal Lagrange strain"/>
</elastic>"""
    },
    other_forms=(SIMO,),
    fibre_stress=_weibull,
)
