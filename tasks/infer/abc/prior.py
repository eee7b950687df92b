"""The prior of an inference: independent normal distributions, truncated to what is physically possible."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Prior:
    """``names`` ``[d]`` with ``mean``, ``sd`` before truncation, ``low`` and ``high``, all ``[d]``."""

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
        values = self.mean + self.sd * ndtri(low + share * (high - low))
        return np.minimum(np.maximum(values, self.low), self.high)

    # cached, because pyABC asks for one draw and one density at a time

    @cached_property
    def _between(self) -> tuple[Array, Array]:
        """Shares of the normal distributions below ``low`` and below ``high``."""
        return ndtr((self.low - self.mean) / self.sd), ndtr((self.high - self.mean) / self.sd)

    @cached_property
    def _log_area(self) -> float:
        low, high = self._between
        return float(np.log(self.sd * np.sqrt(2 * np.pi) * (high - low)).sum())


def calibrated(parameters: Sequence[Parameter], values: Array, widening: float) -> Prior:
    """From calibrated specimens ``[n, d]``: their mean, and ``widening`` times their standard deviation.

    Where there is one specimen, or all have the same value, the standard deviation is that of a uniform distribution
    over the parameter's range.
    """
    uniform = np.array([(parameter.maximum - parameter.minimum) / np.sqrt(12.0) for parameter in parameters])
    sd = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(len(parameters))
    sd = np.where(sd > 1e-6 * uniform, widening * sd, uniform)
    low = [np.nextafter(p.floor, np.inf) if p.exclusive else p.floor for p in parameters]
    high = [np.nextafter(p.ceiling, -np.inf) if np.isfinite(p.ceiling) else np.inf for p in parameters]
    names = tuple(parameter.name for parameter in parameters)
    return Prior(names, values.mean(axis=0), sd, np.array(low), np.array(high))
