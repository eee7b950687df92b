"""A load cell whose zero is off, or moves."""

import numpy as np

from tasks.model.effect import Array, Bars, Effect, Values
from tasks.model.parameters import Parameter


def _reading(bars: Bars, values: Values) -> Array:
    since = bars.time_s - bars.time_s[0]
    return bars.force_N + values["force_offset"] + values["force_slope"] * since


EFFECT = Effect(
    slug="force-drift",
    title="Drift of the load cell",
    description="The load cell was not at zero when the test began, or its zero moves with temperature and time.",
    equation="reading = force + force_offset + force_slope x (time since the first point)",
    reference="ASTM E74 (calibration of force-measuring instruments: zero and creep)",
    parameters=(
        Parameter("force_offset", "N", -50.0, 50.0, 15.0, "reading without force at the first point", floor=-np.inf),
        Parameter("force_slope", "N/s", -0.2, 0.2, 0.05, "change of that reading with time", floor=-np.inf),
    ),
    null={"force_offset": 0.0, "force_slope": 0.0},
    seen_by=("rest", "toe", "late hold", "valley", "later cycles"),
    confounded_with={
        "preload": "prestretched fibres are force at rest too; they also change the toe",
        "tau_3f": "a slope in a hold looks like a relaxation that is slower or faster",
    },
    no_febio="it is in the instrument, not in the specimen",
    reading=_reading,
)
