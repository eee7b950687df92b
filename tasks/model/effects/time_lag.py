"""A force that is recorded late."""

import numpy as np

from sinew.tasks.model.effect import Array, Bars, Effect, Values
from sinew.tasks.model.lagging import lagging
from sinew.tasks.model.parameters import Parameter


def _reading(bars: Bars, values: Values) -> Array:
    late = bars.time_s - values["force_lag"]
    return np.array([np.interp(at, bars.time_s, force) for at, force in zip(late, bars.force_N, strict=True)])


def _filtered(bars: Bars, values: Values) -> Array:
    return lagging(bars.time_s, bars.force_N, values["filter_time"])


_CONFOUNDED = {
    "tau_1f": "a fast mode also shifts the force in time; it shifts it ahead",
    "rate-viscosity": "both turn their sign at a reversal",
    "toe-slack": "in one loading ramp, a lag is a longer toe; unloading tells them apart",
}
_SEEN = ("toe", "ramp", "peak", "early hold", "unload", "valley")
_NO_INSTRUMENT = "it is in the instrument, not in the specimen"

FILTER = Effect(
    slug="time-lag",
    form="filter",
    title="Filter of the force",
    description="A low-pass filter of the amplifier lies between load cell and recorder, of the first order: the force "
    "comes late, and its peaks are lower and rounder.",
    equation="filter_time d(reading)/dt + reading = force; at the first point they are the same",
    reference="Oppenheim and Schafer, Discrete-Time Signal Processing (first-order filters)",
    parameters=(Parameter("filter_time", "s", 0.0, 1.0, 0.2, "time constant of the filter"),),
    null={"filter_time": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    shared=("filter_time",),
    no_febio=_NO_INSTRUMENT,
    around=True,
    reading=_filtered,
)

EFFECT = Effect(
    slug="time-lag",
    title="Lag of the force",
    description="The clock of the force is behind that of the displacement: filters, or two recorders. Between samples "
    "the force is taken as linear, so corners are cut by a fraction of a sample.",
    equation="reading(t) = force(t - force_lag); before the first point, its force",
    reference="Oppenheim and Schafer, Discrete-Time Signal Processing (delay of filters)",
    parameters=(Parameter("force_lag", "s", 0.0, 1.0, 0.2, "time by which the force is late"),),
    null={"force_lag": 0.0},
    seen_by=_SEEN,
    confounded_with=_CONFOUNDED,
    shared=("force_lag",),
    no_febio=_NO_INSTRUMENT,
    around=True,
    other_forms=(FILTER,),
    reading=_reading,
)
