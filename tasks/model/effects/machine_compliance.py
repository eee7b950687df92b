"""A machine that gives way: part of the measured displacement never reaches the gauge length."""

import numpy as np

from tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from tasks.model.parameters import Parameter


def _displacement(bars: Bars, values: Values) -> Array:
    return bars.displacement_mm - values["compliance"] * bars.force_N


def _giving_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    nothing = np.zeros_like(bars.force_N)
    return (GivingWay(values["compliance"] + nothing, nothing),)


EFFECT = Effect(
    slug="machine-compliance",
    title="Compliance of the machine",
    description="Frame, load cell and grips are springs in series with the specimen; displacement is measured at the "
    "actuator, and what the springs take is counted as strain.",
    equation="gauge displacement = grip displacement - compliance x force",
    reference="Kalidindi et al. (1997) Exp Mech 37:210",
    parameters=(Parameter("compliance", "mm/N", 0.0, 1e-3, 1e-4, "displacement that the machine takes per force"),),
    null={"compliance": 0.0},
    seen_by=("ramp", "peak", "early hold", "middle hold", "late hold"),
    confounded_with={
        "E_f": "a spring in series lowers the stiffness; that it also slows relaxation is a second-order change",
        "area-error": "both lower the force at a displacement; specimens of other sizes tell them apart",
        "grip-slip": "both lose displacement under load; a spring gives it back",
    },
    shared=("compliance",),
    no_febio="the template prescribes the displacement of the specimen itself; there is no machine in it",
    displacement=_displacement,
    giving_way=_giving_way,
)
