"""The prior of an inference: independent normal distributions between bounds, or uniform ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array

ON_A_BOUND = 1e-6  # of a range: a calibrated value that close to an end lies on it


@dataclass(frozen=True, eq=False)
class Prior:
    """``names`` ``[d]`` with ``mean``, ``sd`` before truncation, ``low`` and ``high``, all ``[d]``.

    An infinite ``sd`` stands for a uniform distribution.
    """

    names: tuple[str, ...]
    mean: Array
    sd: Array
    low: Array
    high: Array

    def density(self, values: Array) -> float:
        """The density at one set of values ``[d]``."""
        if (values < self.low).any() or (values > self.high).any():
            return 0.0
        apart = (values - self.mean) / self.sd
        return float(np.exp(-0.5 * (apart @ apart) - self._log_area))

    def quantiles(self, share: Array) -> Array:
        """Values ``[..., d]`` below which there are ``share`` ``[..., d]`` of the draws."""
        low, high = self._between
        values = self._mean + self._sd * ndtri(low + share * (high - low))
        if self.uniform.any():
            values = np.where(self.uniform, self._low + share * (self._high - self._low), values)
        return np.minimum(np.maximum(values, self.low), self.high)

    @cached_property
    def uniform(self) -> Array:
        """Which distributions ``[d]`` are uniform."""
        return np.isinf(self.sd)

    @cached_property
    def spread(self) -> Array:
        """Standard deviations ``[d]``, before truncation where they are normal."""
        return np.where(self.uniform, (self._high - self._low) / np.sqrt(12.0), self._sd)

    # cached, because pyABC asks for one draw and one density at a time

    @cached_property
    def _between(self) -> tuple[Array, Array]:
        """Shares of the normal distributions below ``low`` and below ``high``; of uniform ones 0 and 1."""
        low, high = ndtr((self.low - self._mean) / self._sd), ndtr((self.high - self._mean) / self._sd)
        return np.where(self.uniform, 0.0, low), np.where(self.uniform, 1.0, high)

    @cached_property
    def _log_area(self) -> float:
        low, high = self._between
        normal = np.log(self._sd * np.sqrt(2 * np.pi) * (high - low))
        return float(np.where(self.uniform, np.log(self._high - self._low), normal).sum())

    # what stands in arrays where the other kind of distribution is, so that sums there are finite

    @cached_property
    def _mean(self) -> Array:
        return np.where(self.uniform, 0.0, self.mean)

    @cached_property
    def _sd(self) -> Array:
        return np.where(self.uniform, 1.0, self.sd)

    @cached_property
    def _low(self) -> Array:
        return np.where(self.uniform, self.low, 0.0)

    @cached_property
    def _high(self) -> Array:
        return np.where(self.uniform, self.high, 1.0)


def calibrated(parameters: Sequence[Parameter], values: Array, widening: float) -> Prior:
    """The paper's, from calibrated specimens ``[n, d]``: their mean, and ``widening`` times their standard deviation.

    Truncated to what is physically possible. Where there is one specimen, or all have the same value, the standard
    deviation is that of a uniform distribution over the parameter's range.
    """
    uniform = np.array([(parameter.maximum - parameter.minimum) / np.sqrt(12.0) for parameter in parameters])
    sd = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(len(parameters))
    sd = np.where(sd > 1e-6 * uniform, widening * sd, uniform)
    low = [np.nextafter(p.floor, np.inf) if p.exclusive else p.floor for p in parameters]
    high = [np.nextafter(p.ceiling, -np.inf) if np.isfinite(p.ceiling) else np.inf for p in parameters]
    names = tuple(parameter.name for parameter in parameters)
    return Prior(names, values.mean(axis=0), sd, np.array(low), np.array(high))


def of_ranges(parameters: Sequence[Parameter]) -> Prior:
    """Uniform over the parameters' ranges."""
    low, high = (np.array([getattr(one, end) for one in parameters]) for end in ("minimum", "maximum"))
    return Prior(tuple(one.name for one in parameters), (low + high) / 2, np.full(len(low), np.inf), low, high)


def of_others(parameters: Sequence[Parameter], values: Array, widening: float) -> Prior:
    """As :func:`calibrated`, from specimens ``[n, d]`` that are not inferred, and within the parameters' ranges.

    Uniform where most of their values lie on an end of the range, or are all the same: these say that the parameter
    could not be found, not where it is.
    """
    flat = of_ranges(parameters)
    near = ON_A_BOUND * (flat.high - flat.low)
    pinned = np.mean((values - flat.low <= near) | (flat.high - values <= near), axis=0) > 0.5
    sd = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(len(parameters))
    known = ~pinned & (sd > near)
    mean = np.where(known, np.clip(values.mean(axis=0), flat.low, flat.high), flat.mean)
    return Prior(flat.names, mean, np.where(known, widening * sd, np.inf), flat.low, flat.high)
