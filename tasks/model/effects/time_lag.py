"""A force that is recorded late."""

import numpy as np

from tasks.model.effect import Array, Bars, Effect, Values
from tasks.model.parameters import Parameter


def _reading(bars: Bars, values: Values) -> Array:
    late = bars.time_s - values["force_lag"]
    return np.array([np.interp(at, bars.time_s, force) for at, force in zip(late, bars.force_N, strict=True)])


EFFECT = Effect(
    slug="time-lag",
    title="Lag of the force",
    description="The clock of the force is behind that of the displacement: filters, or two recorders. Between samples "
    "the force is taken as linear, so corners are cut by a fraction of a sample.",
    equation="reading(t) = force(t - force_lag); before the first point, its force",
    reference="Oppenheim and Schafer, Discrete-Time Signal Processing (delay of filters)",
    parameters=(Parameter("force_lag", "s", 0.0, 1.0, 0.2, "time by which the force is late"),),
    null={"force_lag": 0.0},
    seen_by=("toe", "ramp", "peak", "early hold", "unload", "valley"),
    confounded_with={
        "tau_1f": "a fast mode also shifts the force in time; it shifts it ahead",
        "rate-viscosity": "both turn their sign at a reversal",
        "toe-slack": "in one loading ramp, a lag is a longer toe; unloading tells them apart",
    },
    shared=("force_lag",),
    no_febio="it is in the instrument, not in the specimen",
    reading=_reading,
)
