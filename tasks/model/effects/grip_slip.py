"""A specimen that slips in its grips, and stays slipped."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from sinew.tasks.model.parameters import Parameter


def _displacement(bars: Bars, values: Values) -> Array:
    pull = np.maximum(bars.force_N, 0.0)
    impulse = np.cumsum(pull * bars.steps_s, axis=1)
    largest = np.maximum.accumulate(pull, axis=1)
    slip = values["slip_per_force"] * (largest - pull[:, :1]) + values["slip_per_impulse"] * impulse
    return bars.displacement_mm - slip


def _giving_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    pulled = bars.force_N > 0.0
    largest = np.maximum.accumulate(np.maximum(bars.force_N, 0.0), axis=1)
    rises = np.diff(largest, axis=1, prepend=largest[:, :1]) > 0.0
    return (
        GivingWay(values["slip_per_force"] * rises, 1.0 - rises),
        GivingWay(values["slip_per_impulse"] * pulled * bars.steps_s, np.ones_like(bars.force_N)),
    )


def _slipped(bars: Bars, speed: Array, held: Array) -> Array:
    """Displacement of the gauge length where grips that hold up to ``held`` (N) lose it with ``speed`` (mm/(N s))."""
    beyond = np.maximum(bars.force_N - held, 0.0)
    return bars.displacement_mm - speed * np.cumsum(beyond * bars.steps_s, axis=1)


def _slipping(bars: Bars, speed: Array, held: Array) -> tuple[GivingWay, ...]:
    beyond = bars.force_N > held
    return (GivingWay(speed * beyond * bars.steps_s, np.ones_like(bars.force_N)),)


def _slid(bars: Bars, values: Values) -> Array:
    return _slipped(bars, values["slip_speed"], values["slip_force"])


def _sliding(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    return _slipping(bars, values["slip_speed"], values["slip_force"])


def _crept(bars: Bars, values: Values) -> Array:
    return _slipped(bars, values["slip_rate"], _held(bars, values))


def _creeping(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    return _slipping(bars, values["slip_rate"], _held(bars, values))


def _held(bars: Bars, values: Values) -> Array:
    """The force up to which the grips hold ``[n, 1]`` (N)."""
    return values["slip_part"] * np.maximum(bars.rigid_N.max(axis=1, keepdims=True), 0.0)


CREEP = Effect(
    slug="grip-slip",
    form="threshold",
    title="Creep in the grips beyond a force",
    description="The grips are tightened for each test, and hold up to a part of the largest force that it would take "
    "to pull the specimen if nothing gave way, neither grips nor machine; beyond it the specimen creeps out of them, "
    "the faster the higher the force, and stays where it is when the force falls.",
    equation="gauge displacement = grip displacement - slip_rate x integral of max(F - slip_part x F_hold, 0) dt, "
    "F_hold = largest force if nothing gave way",
    reference="Cheung and Zhang (2006) Med Eng Phys 28:379 (gripping tendons)",
    parameters=(
        Parameter("slip_rate", "mm/(N s)", 0.0, 1e-3, 5e-5, "speed of slip per force beyond what the grips hold"),
        Parameter("slip_part", "1", 0.0, 1.0, 0.6, "part of that force up to which they hold"),
    ),
    asks_rigid=True,
    null={"slip_rate": 0.0},
    seen_by=("peak", "early hold", "unload", "valley", "later cycles"),
    confounded_with={
        "softening": "both lower the force once a peak is passed; slip goes on in the early hold",
        "permanent-set": "after both the bar is longer",
    },
    no_febio="the template prescribes the displacement of the specimen itself; there are no grips in it",
    around=True,
    displacement=_crept,
    giving_way=_creeping,
)

SLIDING = Effect(
    slug="grip-slip",
    form="force",
    title="Slip beyond a force",
    description="The grips hold up to a force, the same in all tests; beyond it the specimen slides out of them, the "
    "faster the higher the force, and stays where it is when the force falls.",
    equation="gauge displacement = grip displacement - slip_speed x integral of max(F - slip_force, 0) dt",
    reference="Cheung and Zhang (2006) Med Eng Phys 28:379 (gripping tendons)",
    parameters=(
        Parameter("slip_speed", "mm/(N s)", 0.0, 1e-3, 5e-5, "speed of slip per force beyond what the grips hold"),
        Parameter("slip_force", "N", 0.0, 1500.0, 500.0, "force up to which they hold"),
    ),
    null={"slip_speed": 0.0},
    seen_by=("peak", "early hold", "unload", "valley", "later cycles"),
    confounded_with={
        "softening": "both lower the force once a peak is passed; slip goes on in the early hold",
        "creep": "a specimen that creeps loses nearly the same displacement",
    },
    no_febio="the template prescribes the displacement of the specimen itself; there are no grips in it",
    around=True,
    displacement=_slid,
    giving_way=_sliding,
)

EFFECT = Effect(
    slug="grip-slip",
    title="Slip in the grips",
    description="The specimen is drawn out of the grips a little whenever the pull exceeds all before, and creeps "
    "while it is pulled. Slip is counted from the first point and never comes back, so later cycles begin slack.",
    equation="gauge displacement = grip displacement - slip_per_force x (largest force so far - first force) "
    "- slip_per_impulse x integral of the force over time",
    reference="Cheung and Zhang (2006) Med Eng Phys 28:379 (gripping tendons)",
    parameters=(
        Parameter("slip_per_force", "mm/N", 0.0, 5e-4, 3e-5, "slip per new largest force"),
        Parameter("slip_per_impulse", "mm/(N s)", 0.0, 1e-6, 2e-7, "slip per force and time"),
    ),
    null={"slip_per_force": 0.0, "slip_per_impulse": 0.0},
    seen_by=("ramp", "peak", "late hold", "unload", "valley", "later cycles"),
    confounded_with={
        "machine-compliance": "both lose displacement under load; only unloading shows whether it comes back",
        "permanent-set": "both leave the bar slack after unloading; a set is in the matrix alone",
        "tau_3f": "creep in the grips relaxes the force like a slow mode",
    },
    no_febio="the template prescribes the displacement of the specimen itself; there are no grips in it",
    around=True,
    other_forms=(CREEP, SLIDING),
    displacement=_displacement,
    giving_way=_giving_way,
)
