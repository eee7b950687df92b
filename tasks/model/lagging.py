"""A quantity that follows another one late, as through a filter of first order."""

import numpy as np

from sinew.runner.compiled import at_first_call
from sinew.tasks.model.effect import Array


def lagging(time_s: Array, driver: Array, lag_s: Array) -> Array:
    """What follows ``driver`` ``[n, t]`` with a time constant ``lag_s`` ``[n, 1]`` (s), from where it begins.

    Exact where the driver is linear between the points.
    """
    ratio = np.diff(time_s) / lag_s
    kept = np.exp(-ratio)
    mean = -np.expm1(-ratio) / ratio
    follows = np.array(driver)
    _follow(kept, mean - kept, 1.0 - mean, np.ascontiguousarray(driver), follows)
    return follows


@at_first_call(error_model="numpy")
def _follow(kept, former, latter, driver, follows):  # type: ignore[no-untyped-def]
    """Write ``follows`` ``[n, t]`` behind ``driver`` ``[n, t]``."""
    for row in range(driver.shape[0]):
        for t in range(1, driver.shape[1]):
            before = former[row, t - 1] * driver[row, t - 1] + latter[row, t - 1] * driver[row, t]
            follows[row, t] = kept[row, t - 1] * follows[row, t - 1] + before
