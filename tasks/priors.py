"""Priors of an inference: independent normal distributions, truncated to what is physically possible."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from pyabc.parameters import Parameter as Parameters
from pyabc.random_variables import DistributionBase, RVBase
from scipy.special import ndtr, ndtri

from tasks.model import Parameter
from tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Normals(DistributionBase):  # type: ignore[misc]
    """``names`` ``[d]`` with ``mean``, ``sd`` before truncation, ``low`` and ``high``, all ``[d]``."""

    names: tuple[str, ...]
    mean: Array
    sd: Array
    low: Array
    high: Array

    def rvs(self) -> Parameters:
        """One draw, from numpy's global generator as pyABC does."""
        share = np.random.random(len(self.names))
        return Parameters(dict(zip(self.names, self.quantiles(share).tolist(), strict=True)))

    def pdf(self, x: Mapping[Any, Any]) -> float:
        """The density of one draw."""
        values = np.array([x[name] for name in self.names])
        if (values < self.low).any() or (values > self.high).any():
            return 0.0
        apart = (values - self.mean) / self.sd
        return float(np.exp(-0.5 * (apart @ apart) - self._log_area))

    def quantiles(self, share: Array) -> Array:
        """Values ``[..., d]`` below which there are ``share`` ``[..., d]`` of the draws."""
        low, high = self._between
        values = self.mean + self.sd * ndtri(low + share * (high - low))
        return np.minimum(np.maximum(values, self.low), self.high)

    def get_parameter_names(self) -> list[str]:
        """As pyABC asks for them."""
        return sorted(self.names)

    # ---- found once: pyABC asks for one draw and one density at a time

    @cached_property
    def _between(self) -> tuple[Array, Array]:
        """Shares of the normal distributions below ``low`` and below ``high``."""
        return ndtr((self.low - self.mean) / self.sd), ndtr((self.high - self.mean) / self.sd)

    @cached_property
    def _log_area(self) -> float:
        low, high = self._between
        return float(np.log(self.sd * np.sqrt(2 * np.pi) * (high - low)).sum())


class Alike(RVBase):  # type: ignore[misc]
    """``count`` models with the same prior probability. SciPy's, which pyABC takes, costs 0.3 ms for each look."""

    def __init__(self, count: int) -> None:
        self.count = count

    def copy(self) -> "Alike":
        """One of the same kind."""
        return Alike(self.count)

    def rvs(self, *_: Any, **__: Any) -> int:
        """A model's number, from numpy's global generator as pyABC draws."""
        return int(np.random.randint(self.count))

    def pmf(self, x: int, *_: Any, **__: Any) -> float:
        """The probability of model ``x``."""
        return 1.0 / self.count if 0 <= x < self.count else 0.0

    def pdf(self, x: float, *_: Any, **__: Any) -> float:
        """There is none."""
        raise NotImplementedError

    def cdf(self, x: float, *_: Any, **__: Any) -> float:
        """The probability of a model up to ``x``."""
        return min(max(np.floor(x) + 1.0, 0.0), self.count) / self.count


def calibrated(parameters: Sequence[Parameter], values: Array, widening: float) -> Normals:
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
    return Normals(names, values.mean(axis=0), sd, np.array(low), np.array(high))
