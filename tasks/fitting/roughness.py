"""A rough error of a model: what is left at one point tells of the next, as after each reversal of a test.

Splines cannot follow corners and steps. So whitened errors may hold, beside noise of unit variance, a stationary
process of first order along each curve: its standard deviation is ``size``, and its neighbours correlate by
``memory``. Errors of such a kind are made white by a Kalman filter: each less what those before it lead to expect, in
units of how well that is known (Harvey 1989, Forecasting, structural time series models and the Kalman filter).
"""

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Roughness:
    """A rough error of ``size`` (in units of the noise) and ``memory`` (0 to 1) along curves of ``lengths`` points."""

    size: float
    memory: float
    lengths: tuple[int, ...]

    @cached_property
    def _filter(self) -> tuple[Array, Array]:
        """Of each point ``[g]``: the standard deviation of what is new there, and how much of that is rough error."""
        deviations, gains = np.empty(sum(self.lengths)), np.empty(sum(self.lengths))
        _filtered(self.size**2, self.memory, np.array(self.lengths), deviations, gains)
        return deviations, gains

    @property
    def log_determinant(self) -> float:
        """The logarithm of the determinant of the errors' covariance."""
        return float(2.0 * np.log(self._filter[0]).sum())

    def white(self, errors: Array) -> Array:
        """White errors ``[n, g]`` of errors ``[n, g]`` that hold this one and noise."""
        deviations, gains = self._filter
        found = np.empty(errors.shape)
        _whitened(np.ascontiguousarray(errors), self.memory, np.array(self.lengths), deviations, gains, found)
        return found


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _filtered(variance, memory, lengths, deviations, gains):  # type: ignore[no-untyped-def]
    """Write what :attr:`Roughness._filter` returns."""
    at = 0
    for length in lengths:
        known = variance
        for _ in range(length):
            deviations[at] = np.sqrt(known + 1.0)
            gains[at] = known / (known + 1.0)
            known = memory * memory * known * (1.0 - gains[at]) + variance * (1.0 - memory * memory)
            at += 1


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _whitened(errors, memory, lengths, deviations, gains, found):  # type: ignore[no-untyped-def]
    """Write the white errors ``found`` ``[n, g]`` of ``errors`` ``[n, g]``."""
    for row in range(errors.shape[0]):
        at = 0
        for length in lengths:
            expected = 0.0
            for _ in range(length):
                new = errors[row, at] - expected
                found[row, at] = new / deviations[at]
                expected = memory * (expected + gains[at] * new)
                at += 1
