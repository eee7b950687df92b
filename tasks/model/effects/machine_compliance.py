"""A machine that gives way: part of the measured displacement never reaches the gauge length."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from sinew.tasks.model.parameters import Parameter


def _displacement(bars: Bars, values: Values) -> Array:
    return bars.displacement_mm - values["compliance"] * bars.force_N


def _giving_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    nothing = np.zeros_like(bars.force_N)
    return (GivingWay(values["compliance"] + nothing, nothing),)


def _closing(bars: Bars, values: Values) -> Array:
    limit = values["closing_force"]
    taken = -values["compliance_at_rest"] * limit * np.expm1(-np.abs(bars.force_N) / limit)
    return bars.displacement_mm - np.sign(bars.force_N) * taken


def _closing_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    left = np.exp(-np.abs(bars.force_N) / values["closing_force"])
    return (GivingWay(values["compliance_at_rest"] * left, np.zeros_like(bars.force_N)),)


_NO_MACHINE = "the template prescribes the displacement of the specimen itself; there is no machine in it"
_CONFOUNDED = {
    "E_f": "a spring in series lowers the stiffness; that it also slows relaxation is a second-order change",
    "area-error": "both lower the force at a displacement; specimens of other sizes tell them apart",
    "grip-slip": "both lose displacement under load; a spring gives it back",
}

CLOSING = Effect(
    slug="machine-compliance",
    form="closing",
    title="Compliance of contacts that close",
    description="Grips, pins and threads touch at few points at first; under load the contacts close and become stiff, "
    "so that most of the displacement that the machine takes is taken at small forces.",
    equation="gauge displacement = grip displacement - compliance_at_rest x closing_force x "
    "(1 - exp(-|F| / closing_force)) x sign of F",
    reference="Johnson (1985) Contact Mechanics, chapter 13 (stiffness of rough contacts)",
    parameters=(
        Parameter("compliance_at_rest", "mm/N", 0.0, 2e-3, 2e-4, "displacement that the machine takes per small force"),
        Parameter("closing_force", "N", 50.0, 5000.0, 800.0, "force at which the contacts close", exclusive=True),
    ),
    null={"compliance_at_rest": 0.0},
    seen_by=("toe", "ramp", "peak", "early hold", "valley"),
    confounded_with={**_CONFOUNDED, "toe-slack": "both lengthen the toe; slack has an end"},
    shared=("compliance_at_rest", "closing_force"),
    no_febio=_NO_MACHINE,
    around=True,
    displacement=_closing,
    giving_way=_closing_way,
)

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
    confounded_with=_CONFOUNDED,
    shared=("compliance",),
    no_febio=_NO_MACHINE,
    around=True,
    other_forms=(CLOSING,),
    displacement=_displacement,
    giving_way=_giving_way,
)
