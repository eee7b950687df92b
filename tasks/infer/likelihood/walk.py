"""Walks on an emulator: Hamiltonian Monte Carlo (Neal 2011) in the coordinates of a chart."""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from sinew.tasks.infer.likelihood.chart import Chart, around, moved
from sinew.tasks.infer.likelihood.emulator import polynomials
from sinew.tasks.infer.likelihood.scores import FARTHEST, place
from sinew.tasks.simulate import Array

SHORTER = 0.5  # the shortest part of a step
SMALLEST = 0.1  # precision of coordinates that steps are proportioned to
STEPS = 7  # of a path


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
    return np.asarray(_paths(chart.compiled, prior.power, *whole, backward, chances))


def scales(chart: Chart, prior: Prior) -> Array:
    """Roots ``[c, k, k]`` of the covariances of coordinates near the centre of a chart, with another prior."""
    inverse = np.linalg.inv(chart.root)
    values, vectors = np.linalg.eigh(chart.precision + inverse.T @ (prior.core - np.eye(len(inverse))) @ inverse)
    return np.asarray(vectors / np.sqrt(np.maximum(values, SMALLEST))[:, np.newaxis, :])


_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc"})


@_compiled
def _energy(known, power, mean, precision, scores, derivatives, slope):  # type: ignore[no-untyped-def]
    """Minus the log posterior density of coordinates at ``scores``, up to a constant, and its ``slope`` there.

    ``derivatives`` ``[k, k]`` of coordinates by scores.
    """
    centre, scale, coefficients, of_scores, _, bends = known
    size, count = scores.size, coefficients.shape[1]
    unit, stretch, bent, by_scores = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    components, slopes = np.empty(count), np.empty((size, count))
    inverse = np.linalg.inv(derivatives)
    for j in range(size):
        unit[j], stretch[j], bent[j] = place(scores[j])
    polynomials(centre, scale, coefficients, unit, components, slopes)
    squares = 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += precision[i, j] * (scores[j] - mean[j])
        by_scores[i] = total
        squares += total * (scores[i] - mean[i])
    energy = np.linalg.slogdet(derivatives)[1] + (0.5 * power * np.log1p(squares) if power > 0.0 else 0.5 * squares)
    for q in range(count):
        energy += 0.5 * components[q] * components[q]
    for i in range(size):
        if power > 0.0:
            by_scores[i] *= power / (1.0 + squares)
        total = 0.0
        for q in range(count):
            total += slopes[i, q] * components[q]
        volume = 0.0
        for a in range(size):  # the slope of the volume: the trace of the inverse times how derivatives change
            bend = 0.0
            for b in range(size):
                bend += bends[a, i, b] * inverse[b, a]
            total += stretch[a] * bend
        for b in range(size):
            volume += bent[i] / stretch[i] * (derivatives[i, b] - of_scores[i, b]) * inverse[b, i]
        by_scores[i] += stretch[i] * total + volume
    for b in range(size):
        slope[b] = 0.0
        for a in range(size):
            slope[b] += inverse[b, a] * by_scores[a]
    return energy


@_compiled
def _kicked(momentum, root, slope, length):  # type: ignore[no-untyped-def]
    """A momentum changed by a force, which is minus the ``slope`` along the columns of ``root``."""
    return momentum - length * (root.T @ slope)


@_compiled
def _farthest(scores):  # type: ignore[no-untyped-def]
    """The place in ``scores`` of the one that is farthest beyond an end of its range, -1 where none is."""
    found, beyond = -1, FARTHEST
    for j in range(scores.size):
        if abs(scores[j]) > beyond:
            found, beyond = j, abs(scores[j])
    return found


@_compiled
def _turned_back(momentum, root, derivatives, number):  # type: ignore[no-untyped-def]
    """A momentum reflected on the surface of equal scores of parameter ``number`` (Betancourt 2011)."""
    normal = root.T @ np.linalg.inv(derivatives)[:, number].copy()
    return momentum - 2.0 * np.dot(momentum, normal) / np.dot(normal, normal) * normal


@_compiled
def _paths(known, power, mean, precision, roots, begin, momenta, lengths, backward, chances):  # type: ignore[no-untyped-def]
    paths, chains, size = momenta.shape
    ends = begin.copy()
    start, at, slope = np.empty(size), np.empty(size), np.empty(size)
    for chain in range(chains):
        m, p, root = mean[chain], precision[chain], roots[chain]
        for path in range(paths):
            start[:] = ends[chain]
            total, first = 1.0, 0.0
            for way in range(2):
                momentum = momenta[path, chain] if way == 0 else -momenta[path, chain]
                steps = backward[path, chain] if way == 1 else STEPS - backward[path, chain]
                here, length, inside = start.copy(), lengths[path, chain], True
                slopes = around(known, here, at)
                wanted = at.copy()
                energy = _energy(known, power, m, p, here, slopes, slope)
                first = energy + 0.5 * np.sum(momentum * momentum)
                for step in range(steps):
                    if inside:
                        momentum = _kicked(momentum, root, slope, 0.5 * length)
                    wanted += length * (root @ momentum)
                    if not moved(known, here, at, slopes, wanted):
                        break
                    outside = _farthest(here)
                    inside = outside < 0
                    if not inside:
                        momentum = _turned_back(momentum, root, slopes, outside)
                        continue
                    energy = _energy(known, power, m, p, here, slopes, slope)
                    momentum = _kicked(momentum, root, slope, 0.5 * length)
                    weight = np.exp(first - energy - 0.5 * np.sum(momentum * momentum))
                    total += weight
                    if chances[path, chain, way, step] * total < weight:
                        ends[chain] = here
    return ends
