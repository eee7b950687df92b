"""Priors of an inference: independent normal distributions, truncated to what is physically possible."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pyabc.parameters import Parameter as Parameters
from pyabc.random_variables import DistributionBase
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

    def pdf(self, x: Parameters) -> float:
        """The density of one draw."""
        values = np.array([x[name] for name in self.names])
        if ((values < self.low) | (values > self.high)).any():
            return 0.0
        inside = np.log(self._share(self.high) - self._share(self.low))
        density = -0.5 * ((values - self.mean) / self.sd) ** 2 - np.log(self.sd * np.sqrt(2 * np.pi)) - inside
        return float(np.exp(density.sum()))

    def quantiles(self, share: Array) -> Array:
        """Values ``[..., d]`` below which there are ``share`` ``[..., d]`` of the draws."""
        low, high = self._share(self.low), self._share(self.high)
        return np.clip(self.mean + self.sd * ndtri(low + share * (high - low)), self.low, self.high)

    def get_parameter_names(self) -> list[str]:
        """As pyABC asks for them."""
        return sorted(self.names)

    def _share(self, values: Array) -> Array:
        return ndtr((values - self.mean) / self.sd)


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
