"""Walks on an emulator: Hamiltonian Monte Carlo (Neal 2011) in the coordinates of a chart."""

from dataclasses import dataclass

import numpy as np

from sinew.tasks.infer.likelihood.chart import Chart
from sinew.tasks.infer.likelihood.compiled import STEPS
from sinew.tasks.infer.likelihood.compiled import paths as walked
from sinew.tasks.simulate import Array

SHORTER = 0.5  # the shortest part of a step
SMALLEST = 0.1  # precision of coordinates that steps are proportioned to


@dataclass(frozen=True, eq=False)
class Prior:
    """The prior of ``c`` chains: multivariate t, or normal where ``power`` is 0.

    With q the squared distance from ``centre`` ``[c, k]`` by ``precision`` ``[c, k, k]``, minus twice the log density
    is ``power`` log(1 + q), or q.
    """

    centre: Array
    precision: Array
    power: float = 0.0

    def losses(self, at: Array) -> Array:
        """Minus twice the log densities ``[c]`` at ``[c, k]``, up to a constant."""
        apart = at - self.centre
        squares = np.einsum("cj,cjk,ck->c", apart, self.precision, apart)
        return np.asarray(self.power * np.log1p(squares) if self.power else squares)

    @property
    def core(self) -> Array:
        """The inverses ``[c, k, k]`` of the squared scale: of a t distribution's core, or of the covariance."""
        return np.asarray((self.power - self.centre.shape[1]) * self.precision if self.power else self.precision)


def walk(rng: np.random.Generator, chart: Chart, prior: Prior, begin: Array, paths: int, length: float) -> Array:
    """Where chains ``[c, k]`` of scores come to in ``paths`` of Hamiltonian Monte Carlo.

    Their target is the emulator's likelihood times the ``prior``. Every chain takes steps of up to ``length`` standard
    deviations of its posterior near the centre of the chart. A path begins somewhere in the middle, and its end is
    drawn from all its points within the ranges, in proportion to their densities (Betancourt 2017, arXiv:1701.02434,
    appendix A), because a path along an end of a range is outside at times.
    """
    chains, size = begin.shape
    momenta = rng.standard_normal((paths, chains, size))
    lengths = length * np.exp(rng.uniform(float(np.log(SHORTER)), 0.0, size=(paths, chains)))
    backward = rng.integers(STEPS + 1, size=(paths, chains))
    chances = rng.random((paths, chains, 2, STEPS))
    arrays = (prior.centre, prior.precision, scales(chart, prior), begin, momenta, lengths)
    whole = (np.ascontiguousarray(one, dtype=np.float64) for one in arrays)
    return np.asarray(walked(chart.compiled, prior.power, *whole, backward, chances))


def scales(chart: Chart, prior: Prior) -> Array:
    """Roots ``[c, k, k]`` of the covariances of coordinates near the centre of a chart, with another prior."""
    inverse = np.linalg.inv(chart.root)
    values, vectors = np.linalg.eigh(chart.precision + inverse.T @ (prior.core - np.eye(len(inverse))) @ inverse)
    return np.asarray(vectors / np.sqrt(np.maximum(values, SMALLEST))[:, np.newaxis, :])
