"""A specimen whose length at rest grows while it is strained or pulled."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, GivingWay, Values
from sinew.tasks.model.parameters import Parameter


def _longer(bars: Bars, growth: Array) -> Array:
    """Displacement of a gauge length that has grown: its stretch is the present length over the length at rest."""
    return (bars.length_mm + bars.displacement_mm) / (1.0 + growth) - bars.length_mm


def _by_strain(bars: Bars, values: Values) -> Array:
    strain = np.maximum(bars.displacement_mm / bars.length_mm, 0.0)
    between = 0.5 * (strain[:, 1:] + strain[:, :-1]) * bars.steps_s[1:]
    growth = values["creep_rate"] * np.cumsum(between, axis=1)
    return _longer(bars, np.concatenate([np.zeros_like(growth[:, :1]), growth], axis=1))


def _growth(bars: Bars, rate: Array, unit: Array, limit: Array) -> Array:
    """Growth ``[n, t]`` with ``rate`` (1/s) per force / ``unit`` (N) beyond ``limit``."""
    beyond = np.maximum(bars.force_N / unit - limit, 0.0)
    growth: Array = rate * np.cumsum(beyond * bars.steps_s, axis=1)
    return growth


def _flowing(bars: Bars, rate: Array, unit: Array, limit: Array) -> tuple[GivingWay, ...]:
    # what is lost is in proportion to the length that has grown, which is that of the present point, not of the past
    length = (bars.length_mm + bars.displacement_mm) / (1.0 + _growth(bars, rate, unit, limit)) ** 2
    kept = np.ones_like(length)
    kept[:, 1:] = length[:, 1:] / length[:, :-1]
    return (GivingWay(rate * length * (bars.force_N / unit > limit) * bars.steps_s / unit, kept),)


def _by_stress(bars: Bars, values: Values) -> Array:
    return _longer(bars, _growth(bars, values["creep_per_stress"], bars.material["area_mm2"], values["creep_stress"]))


def _by_stress_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    return _flowing(bars, values["creep_per_stress"], bars.material["area_mm2"], values["creep_stress"])


def _peak(bars: Bars) -> Array:
    """The largest force that it would take if nothing gave way ``[n, 1]`` (N)."""
    return np.asarray(np.maximum(bars.rigid_N.max(axis=1, keepdims=True), np.finfo(float).tiny))


def _by_part(bars: Bars, values: Values) -> Array:
    return _longer(bars, _growth(bars, values["creep_speed"], _peak(bars), values["creep_part"]))


def _by_part_way(bars: Bars, values: Values) -> tuple[GivingWay, ...]:
    return _flowing(bars, values["creep_speed"], _peak(bars), values["creep_part"])


_SEEN = ("ramp", "peak", "late hold", "unload", "valley", "later cycles")
_NO_GROWTH = "its growth laws follow a prescribed course in time, not the strain or stress"
_CONFOUNDED = {
    "grip-slip": "to first order, a specimen that creeps and one that slips in its grips lose the same displacement; "
    "only specimens of other lengths, or markers on the specimen, tell them apart",
    "tau_3f": "creep relaxes the force like a slow mode; unloading shows whether the length has changed",
    "permanent-set": "after both the bar is longer; a set is in the matrix alone, and comes at once",
}

BY_STRESS = Effect(
    slug="creep",
    form="stress",
    title="Creep beyond a stress",
    description="The specimen flows where the stress exceeds a limit, and stays longer when the stress falls.",
    equation="as above; dc/dt = creep_per_stress x max(force / area - creep_stress, 0)",
    reference="Perzyna (1966) Adv Appl Mech 9:243",
    parameters=(
        Parameter(
            "creep_per_stress",
            "1/(MPa s)",
            0.0,
            1e-4,
            1e-5,
            "rate of growth per stress beyond the limit",
            strain_power=1,
        ),
        Parameter("creep_stress", "MPa", 0.0, 40.0, 12.0, "stress at which creep begins"),
    ),
    null={"creep_per_stress": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    no_febio=_NO_GROWTH,
    displacement=_by_stress,
    giving_way=_by_stress_way,
)

BY_PART = Effect(
    slug="creep",
    form="part",
    title="Creep beyond a part of the peak",
    description="The specimen flows near the peaks of each test, whatever their height: fibres that earlier tests have "
    "stretched bear the more of it.",
    equation="as above; dc/dt = creep_speed x max(F / F_peak - creep_part, 0), F_peak = largest force of the test if "
    "nothing gave way",
    reference="Perzyna (1966) Adv Appl Mech 9:243 (flow beyond a limit, here relative to the peak)",
    parameters=(
        Parameter(
            "creep_speed",
            "1/s",
            0.0,
            5e-3,
            5e-4,
            "rate of growth per part of the peak beyond the limit",
            strain_power=1,
        ),
        Parameter("creep_part", "1", 0.0, 1.0, 0.4, "part of the peak at which creep begins"),
    ),
    asks_rigid=True,
    null={"creep_speed": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    no_febio=_NO_GROWTH,
    displacement=_by_part,
    giving_way=_by_part_way,
)

EFFECT = Effect(
    slug="creep",
    title="Creep of the length at rest",
    description="Fibres slide past each other for good: while the specimen is strained, its length at rest grows.",
    equation="stretch = (length + displacement) / (length (1 + c)), dc/dt = creep_rate x max(nominal strain, 0)",
    reference="Wren et al. (2003) Ann Biomed Eng 31:710 (creep of tendon)",
    parameters=(Parameter("creep_rate", "1/s", 0.0, 3e-3, 5e-4, "rate of growth per strain"),),
    null={"creep_rate": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    no_febio=_NO_GROWTH,
    other_forms=(BY_STRESS, BY_PART),
    displacement=_by_strain,
)
