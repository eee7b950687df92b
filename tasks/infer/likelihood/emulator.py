"""A cheap stand-in for the likelihood of one specimen, near its posterior.

Whitened errors change smoothly with the parameters: products of moduli and relaxation strengths enter them exactly to
second order, and times nearly so. So their few principal components are fitted by polynomials of second order in the
parameters. What stands for the sum of squares is then the sum of squares of these polynomials, and what is left out.
Chains are led by the emulator and corrected by the model itself (:mod:`sinew.tasks.infer.likelihood.chains`), so an
error of the emulator costs time, not truth.
"""

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.special import ndtr

from sinew.tasks.infer.likelihood.chart import FARTHEST, Chart, density, from_scores, on_cube, pull_back, to_scores
from sinew.tasks.simulate import Array

COMPONENTS = 40  # of the errors, at most
SLOPE_STEP = 1e-5
NEGLIGIBLE = 1e-3  # of a sum of squares: mean contribution of a component that is left out


@dataclass(frozen=True, eq=False)
class Emulator:
    """Polynomials of points ``[k]`` on the unit cube, standardised by ``centre`` and ``scale`` ``[k]``.

    ``coefficients`` ``[1 + k + k (k + 1) / 2, q]`` of ``q`` components; ``rest``: mean square of all others.
    """

    centre: Array
    scale: Array
    coefficients: Array
    rest: float

    def squares(self, at: Array) -> Array:
        """What the sums of squares ``[n]`` at points ``[n, k]`` are taken for."""
        components = _terms((at - self.centre) / self.scale) @ self.coefficients
        return np.asarray(np.square(components).sum(axis=1) + self.rest)

    def slopes(self, at: Array) -> Array:
        """Derivatives ``[n, k, q]`` of the components at points ``[n, k]``."""
        steps = SLOPE_STEP * np.eye(at.shape[1])
        ends = [_terms((at[:, np.newaxis] + side * steps - self.centre).reshape(-1, at.shape[1]) / self.scale)
                for side in (1, -1)]  # fmt: skip
        apart = (ends[0] - ends[1]) @ self.coefficients / (2.0 * SLOPE_STEP)
        return np.asarray(apart.reshape(*at.shape, -1))


def _terms(at: Array) -> Array:
    """All products ``[n, 1 + k + k (k + 1) / 2]`` of up to two of the ``k`` coordinates."""
    first, second = np.triu_indices(at.shape[1])
    return np.concatenate([np.ones((len(at), 1)), at, at[:, first] * at[:, second]], axis=1)


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


def emulator(at: Array, errors: Array, weight: Array) -> Emulator:
    """The emulator of ``errors`` ``[n, g]`` that were computed at points ``[n, k]``, fitted with ``weight`` ``[n]``."""
    weight = weight / weight.mean()
    centre = np.average(at, axis=0, weights=weight)
    scale = np.maximum(np.sqrt(np.average((at - centre) ** 2, axis=0, weights=weight)), 1e-9)
    root = np.sqrt(weight)[:, np.newaxis]
    weighted = root * errors
    variances, directions = np.linalg.eigh(weighted @ weighted.T)
    kept = np.flatnonzero(variances > NEGLIGIBLE * len(at))[-COMPONENTS:]
    components = root**-1 * directions[:, kept] * np.sqrt(variances[kept])
    coefficients = np.linalg.lstsq(root * _terms((at - centre) / scale), root * components, rcond=None)[0]
    rest = np.average(np.square(errors).sum(axis=1) - np.square(components).sum(axis=1), weights=weight)
    return Emulator(centre, scale, coefficients, float(rest))


@dataclass(frozen=True, eq=False)
class Scatter:
    """The scale of a posterior as scores (first) and in the coordinates of a ``chart`` (second).

    ``roots`` ``[2, k, k]`` of its covariances; ``lengths`` ``[2]``: longest good steps of a path, in standard
    deviations, which are short where a ridge is narrow and bent.
    """

    chart: Chart
    roots: Array
    lengths: Array


def scatter_of(known: Emulator, chart: Chart, scores: Array) -> Scatter:
    """The scatter of draws ``[n, k]`` as scores."""
    unit = ndtr(scores)
    roots = [_root_of_covariance(points) for points in (scores, chart.coordinates(scores))]
    some = slice(None, None, max(1, len(unit) // LOOKED_AT))
    on_scores = known.slopes(unit[some]) * density(scores[some])[:, :, np.newaxis]
    on_chart = np.einsum("nij,niq->njq", chart.slopes(scores[some]), on_scores)
    lengths = [_length(root, each) for root, each in zip(roots, (on_scores, on_chart), strict=True)]
    return Scatter(chart, np.array(roots), np.array(lengths))


def _root_of_covariance(points: Array) -> Array:
    covariance = np.cov(points, rowvar=False).reshape(points.shape[1], -1)
    scale = np.sqrt(np.diag(covariance)) + 1e-12
    return np.asarray(scale[:, np.newaxis] * np.linalg.cholesky(covariance / np.outer(scale, scale) + 1e-9 * np.eye(
        len(covariance))))  # fmt: skip


def _length(root: Array, slopes: Array) -> float:
    """The longest stable step, given slopes ``[n, k, q]`` of the components: near nearly all points."""
    along = np.einsum("jk,njq->nkq", root, slopes)
    stiffest = np.linalg.norm(along, ord=2, axis=(1, 2))
    return float(min(LONGEST, 1.0 / max(np.quantile(stiffest, 0.9), 1e-9)))


def walk(rng: np.random.Generator, known: Emulator, scatter: Scatter, prior: Prior, begin: Array, paths: int) -> Array:
    """Where chains ``[c, k]`` of scores come to in ``paths`` of Hamiltonian Monte Carlo (Neal 2011).

    Their target is the emulator's likelihood times the ``prior``; ``scatter`` gives the directions and scales. Each
    path runs either in scores or in the coordinates of the chart. Lengths of steps vary, because a prior may be
    narrower than the likelihood. All paths are alike, so the chain of them is reversible.
    """
    chains, size = begin.shape
    momenta = rng.standard_normal((paths, chains, size))
    charted = (rng.random((paths, chains)) < CHARTED).astype(np.int64)
    lengths = scatter.lengths[charted] * np.exp(rng.uniform(float(np.log(SHORTER)), 0.0, size=(paths, chains)))
    limits = -np.log(rng.random((paths, chains)))
    steps = int(np.clip(np.ceil(PATH / scatter.lengths.max()), FEWEST_STEPS, MOST_STEPS))
    known_arrays = (known.centre, known.scale, known.coefficients, prior.centre, prior.precision)
    whole = (np.ascontiguousarray(one, dtype=np.float64) for one in (*known_arrays, scatter.roots, begin))
    return np.asarray(_paths(prior.power, steps, scatter.chart.arrays, *whole, momenta, lengths, limits, charted))


CHARTED = 0.75  # of the paths
LOOKED_AT = 60  # draws of which the narrowest direction is found
LONGEST, SHORTER = 0.5, 0.2  # step, in standard deviations of the posterior, and the shortest part of it
PATH, FEWEST_STEPS, MOST_STEPS = 2.0, 8, 64  # length of a path, in standard deviations, and its steps

_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc"})


@_compiled
def _likelihood(centre, scale, coefficients, at, slope, z, components):  # type: ignore[no-untyped-def]
    """Half the emulator's sum of squares at ``at`` on the unit cube, and its ``slope``; the others are scratch."""
    size, count = z.size, components.size
    for j in range(size):
        z[j] = (at[j] - centre[j]) / scale[j]
    components[:] = coefficients[0]
    row = 1
    for j in range(size):
        for q in range(count):
            components[q] += z[j] * coefficients[row, q]
        row += 1
    for i in range(size):
        for j in range(i, size):
            product = z[i] * z[j]
            for q in range(count):
                components[q] += product * coefficients[row, q]
            row += 1
    energy = 0.0
    for q in range(count):
        energy += 0.5 * components[q] * components[q]
    row = 1
    for j in range(size):
        slope[j] = 0.0
        for q in range(count):
            slope[j] += components[q] * coefficients[row, q]
        row += 1
    for i in range(size):
        for j in range(i, size):
            total = 0.0
            for q in range(count):
                total += components[q] * coefficients[row, q]
            slope[i] += total * z[j]
            slope[j] += total * z[i]
            row += 1
    for j in range(size):
        slope[j] /= scale[j]
    return energy


@_compiled
def _prior(power, mean, precision, at, slope):  # type: ignore[no-untyped-def]
    """Half the prior's loss at scores ``at``, and its ``slope`` there."""
    squares = 0.0
    for i in range(at.size):
        total = 0.0
        for j in range(at.size):
            total += precision[i, j] * (at[j] - mean[j])
        slope[i] = total
        squares += total * (at[i] - mean[i])
    if power > 0.0:
        for j in range(at.size):
            slope[j] *= power / (1.0 + squares)
        return 0.5 * power * np.log1p(squares)
    return 0.5 * squares


@_compiled
def _energy(  # type: ignore[no-untyped-def]
    power, centre, scale, coefficients, mean, precision, chart, charted, at, slope, scratch, components
):
    """Minus the log posterior density of ``at``, up to a constant, and its ``slope``; infinite where there are none.

    ``at`` is in the coordinates of the chart where ``charted``, else as scores. ``scratch``, whose second row
    are then the scores, and ``components`` are overwritten.
    """
    unit, scores, of_prior, stretch = scratch[0], scratch[1], scratch[2], scratch[4]
    if charted:
        if not to_scores(*chart, at, scores):
            return np.inf
    else:
        scores[:] = at
        if np.abs(at).max() >= FARTHEST:
            return np.inf
    for j in range(at.size):
        unit[j], stretch[j] = on_cube(scores[j])
    energy = _likelihood(centre, scale, coefficients, unit, slope, scratch[3], components)
    energy += _prior(power, mean, precision, scores, of_prior)
    for j in range(at.size):
        slope[j] = slope[j] * stretch[j] + of_prior[j]
    if charted:
        energy += pull_back(*chart, scores, slope)
    return energy


@_compiled
def _kick(momentum, scatter, slope, length):  # type: ignore[no-untyped-def]
    """Change a momentum by a force, which is minus the ``slope`` along the columns of ``scatter``."""
    for j in range(momentum.size):
        total = 0.0
        for i in range(momentum.size):
            total += scatter[i, j] * slope[i]
        momentum[j] -= length * total


@_compiled
def _paths(  # type: ignore[no-untyped-def]
    power, steps, chart, centre, scale, coefficients, mean, precision, roots, begin, momenta, lengths, limits, charted
):
    paths, chains, size = momenta.shape
    ends = begin.copy()
    scratch, components = np.empty((5, size)), np.empty(coefficients.shape[1])
    at, slope = np.empty(size), np.empty(size)
    for chain in range(chains):
        m, p = mean[chain], precision[chain]
        for path in range(paths):
            on_chart, momentum, length = charted[path, chain] == 1, momenta[path, chain].copy(), lengths[path, chain]
            scatter = roots[charted[path, chain]]
            at[:] = ends[chain]
            scratch[1] = ends[chain]
            if on_chart:
                from_scores(*chart, ends[chain], at)
            here = _energy(power, centre, scale, coefficients, m, p, chart, on_chart, at, slope, scratch, components)
            here += 0.5 * np.sum(momentum * momentum)
            there = here
            _kick(momentum, scatter, slope, 0.5 * length)
            for step in range(steps):
                for i in range(size):
                    for j in range(size):
                        at[i] += length * scatter[i, j] * momentum[j]
                there = _energy(
                    power, centre, scale, coefficients, m, p, chart, on_chart, at, slope, scratch, components
                )
                if not there < np.inf:
                    break
                _kick(momentum, scatter, slope, length if step < steps - 1 else 0.5 * length)
            if there + 0.5 * np.sum(momentum * momentum) - here < limits[path, chain]:
                for j in range(size):
                    ends[chain, j] = scratch[1, j]
    return ends
