"""A load cell whose zero is off, or moves."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.parameters import Parameter


def _reading(bars: Bars, values: Values) -> Array:
    since = bars.time_s - bars.time_s[0]
    return bars.force_N + values["force_offset"] + values["force_slope"] * since


def _settling(bars: Bars, values: Values) -> Array:
    since = bars.time_s - bars.time_s[0]
    return bars.force_N + values["force_offset"] - values["force_change"] * np.expm1(-since / values["settling_time"])


_OFFSET = Parameter("force_offset", "N", -50.0, 50.0, 15.0, "reading without force at the first point", floor=-np.inf)
_NO_INSTRUMENT = "it is in the instrument, not in the specimen"
_CONFOUNDED = {
    "preload": "prestretched fibres are force at rest too; they also change the toe",
    "tau_3f": "a slope in a hold looks like a relaxation that is slower or faster",
}

SETTLING = Effect(
    slug="force-drift",
    form="settling",
    title="Drift of a load cell that settles",
    description="The zero of the load cell moves after switching on or after a change of temperature, fast at first, "
    "until it has settled.",
    equation="reading = force + force_offset + force_change x (1 - exp(-(time since the first point) / settling_time))",
    reference="OIML R 60 (load cells: warm-up and creep)",
    parameters=(
        _OFFSET,
        Parameter("force_change", "N", -50.0, 50.0, 15.0, "change of that reading until it settles", floor=-np.inf),
        Parameter("settling_time", "s", 2.0, 1000.0, 100.0, "time constant of the change", exclusive=True),
    ),
    null={"force_offset": 0.0, "force_change": 0.0},
    seen_by=("rest", "toe", "early hold", "middle hold", "late hold", "valley", "later cycles"),
    confounded_with={
        **_CONFOUNDED,
        "relaxation-mode": "in one hold both are an exponential; the valleys tell them apart",
    },
    no_febio=_NO_INSTRUMENT,
    around=True,
    reading=_settling,
)

EFFECT = Effect(
    slug="force-drift",
    title="Drift of the load cell",
    description="The load cell was not at zero when the test began, or its zero moves with temperature and time.",
    equation="reading = force + force_offset + force_slope x (time since the first point)",
    reference="ASTM E74 (calibration of force-measuring instruments: zero and creep)",
    parameters=(
        _OFFSET,
        Parameter("force_slope", "N/s", -0.2, 0.2, 0.05, "change of that reading with time", floor=-np.inf),
    ),
    null={"force_offset": 0.0, "force_slope": 0.0},
    seen_by=("rest", "toe", "late hold", "valley", "later cycles"),
    confounded_with=_CONFOUNDED,
    no_febio=_NO_INSTRUMENT,
    around=True,
    other_forms=(SETTLING,),
    reading=_reading,
)
