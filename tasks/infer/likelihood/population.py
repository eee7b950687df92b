"""The population of a site and its priors: specimens scatter normally, with any correlations, as normal scores.

A specimen's scores x (:mod:`sinew.tasks.infer.likelihood.scores`) are N(m, C) within the ends of the ranges; or, with
heavy tails, Student's t with 4 degrees of freedom, as a normal distribution of covariance C / w with w ~ Gamma(2, 2).
Priors:

========================  =============================================================================================
mean m                    independent N(0, 1): uniform over the ranges
covariance C              Huang and Wand (2013, Bayesian Analysis 8, 439): every spread half-t with 2 degrees of freedom
                          and scale 0.5, every correlation uniform on (-1, 1)
========================  =============================================================================================

The half-t's density falls as 1/spread near its scale, so intervals of well determined means are close to those of
Student's t test. All conditional distributions are standard ones, from which :func:`drawn` draws in turn (Gibbs).
Arrays hold ``c`` chains of ``k`` parameters.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student_t

from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.infer.likelihood.walk import Prior
from sinew.tasks.simulate import Array

SPREAD_DF, SPREAD_SCALE = 2.0, 0.5
TAIL_DF = 4.0
NODES = 41  # of the quadrature over a population
TRIES, SHORTEST, LONGEST = 2, 0.3, 4.0  # of Metropolis' rule for a scale: number, and steps of its logarithm


@dataclass(frozen=True, eq=False)
class Population:
    """``c`` draws of a population.

    ``mean`` ``[c, k]``, ``precision`` ``[c, k, k]`` and ``scales`` ``[c, k]`` (auxiliary, of the prior) of
    scores; ``weights`` ``[n, c]`` of each specimen, all 1 without heavy tails.
    """

    mean: Array
    precision: Array
    scales: Array
    weights: Array

    def of_one(self, number: int, scores: Array) -> Prior:
        """The prior of specimen ``number``, given the mean and all other specimens of ``scores`` ``[n, c, k]``.

        The covariance is integrated out, as what is drawn of it would hold the specimen where it is.
        """
        count, _, size = scores.shape
        others = np.delete(self.apart_from_mean(scores), number, axis=0)
        scatter = _scatter(others, self.scales)
        precision = self.weights[number][:, np.newaxis, np.newaxis] * np.linalg.inv(scatter)
        return Prior(self.mean, precision, SPREAD_DF + size - 1.0 + count)

    def log_density(self, scores: Array) -> Array:
        """Of mean, logarithms of scales and ``scores`` ``[n, c, k]``: ``[c]``, up to a constant.

        The covariance is integrated out.
        """
        count, _, size = scores.shape
        scatter = _scatter(self.apart_from_mean(scores), self.scales)
        logs = np.log(self.scales).sum(axis=1)
        found = -0.5 * (SPREAD_DF + size - 1.0 + count) * np.linalg.slogdet(scatter)[1]
        found -= 0.5 * (SPREAD_DF + size) * logs + (1.0 / self.scales).sum(axis=1) / SPREAD_SCALE**2
        return np.asarray(found - 0.5 * np.square(self.mean).sum(axis=1))

    def apart_from_mean(self, scores: Array) -> Array:
        """How far ``scores`` ``[n, c, k]`` are from the mean, in proportion to the roots of the weights."""
        return np.asarray(np.sqrt(self.weights)[..., np.newaxis] * (scores - self.mean))

    def covariance(self) -> Array:
        """``[c, k, k]``, of the normal distribution or of the t distribution's core."""
        return np.asarray(np.linalg.inv(self.precision))


def drawn(rng: np.random.Generator, scores: Array, before: Population, *, heavy: bool) -> Population:
    """The next draw of a population, given its specimens' ``scores`` ``[n, c, k]``.

    What was drawn of the covariance before is not used: a specimen moves with the covariance integrated out
    (:meth:`Population.of_one`), so it holds no longer (van Dyk and Park 2008, J. Am. Stat. Assoc. 103, 790).
    """
    count, chains, size = scores.shape
    diagonal = np.arange(size)
    weights = before.weights
    weighted = before.apart_from_mean(scores)
    scales = _scales(rng, weighted, before.scales)
    precision = wishart(rng, SPREAD_DF + size - 1.0 + count, _scatter(weighted, scales))
    if heavy:
        apart = scores - before.mean
        distances = np.einsum("ncj,cjk,nck->nc", apart, precision, apart)
        weights = rng.gamma((TAIL_DF + size) / 2, 2.0 / (TAIL_DF + distances))
    known = weights.sum(axis=0)[:, np.newaxis, np.newaxis] * precision
    known[:, diagonal, diagonal] += 1.0
    pull = np.einsum("cjk,ck->cj", precision, np.einsum("nc,nck->ck", weights, scores))
    root = np.linalg.cholesky(known)
    noise = rng.standard_normal((chains, size))
    mean = np.linalg.solve(known, pull[..., np.newaxis])[..., 0]
    mean += np.linalg.solve(root.transpose(0, 2, 1), noise[..., np.newaxis])[..., 0]
    return Population(mean, precision, scales, weights)


def with_new_covariance(rng: np.random.Generator, scores: Array, population: Population) -> Population:
    """A population with a covariance drawn anew, given where its specimens' ``scores`` ``[n, c, k]`` are now.

    Specimens, means and scales have moved with the covariance integrated out since the last one was drawn: with that
    one they are no joint draw.
    """
    count, _, size = scores.shape
    scatter = _scatter(population.apart_from_mean(scores), population.scales)
    return replace(population, precision=wishart(rng, SPREAD_DF + size - 1.0 + count, scatter))


def _scatter(apart: Array, scales: Array) -> Array:
    """The inverse scale ``[c, k, k]`` of the precision's Wishart distribution: squares ``apart``, and the prior's."""
    diagonal = np.arange(apart.shape[2])
    scatter = np.einsum("ncj,nck->cjk", apart, apart)
    scatter[:, diagonal, diagonal] += 2.0 * SPREAD_DF / scales
    return np.asarray(scatter)


def _scales(rng: np.random.Generator, apart: Array, before: Array) -> Array:
    """The next scales ``[c, k]``, given what specimens are ``apart`` ``[n, c, k]`` from the mean, with the covariance
    integrated out: by Metropolis' rule for one parameter after another.

    Given the covariance instead, spreads would creep, the more so the more parameters there are.
    """
    count, chains, size = apart.shape
    power = SPREAD_DF + size - 1.0 + count
    scales = before.copy()
    columns = apart.transpose(1, 2, 0)  # [c, k, n]
    lengths = np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST), size=(TRIES, size, chains)))
    steps, limits = lengths * rng.standard_normal((TRIES, size, chains)), np.log(rng.random((TRIES, size, chains)))
    gram = np.eye(count) + np.einsum("cj,cjn,cjm->cnm", scales / (2.0 * SPREAD_DF), columns, columns)
    inverse = np.linalg.inv(gram)
    for tries, limit in zip(steps, limits, strict=True):
        for j in range(size):
            here, column = scales[:, j], columns[:, j]
            there = here * np.exp(tries[j])
            along = np.einsum("cnm,cm->cn", inverse, column)
            own = np.einsum("cn,cn->c", along, column) / (2.0 * SPREAD_DF)
            grown = 1.0 + (there - here) * own  # the determinant of the matrix
            ratio = 0.5 * (count - 1.0) * tries[j] - (1.0 / there - 1.0 / here) / SPREAD_SCALE**2
            moved = limit[j] < ratio - 0.5 * power * np.log(grown)
            factor = np.where(moved, (there - here) / (2.0 * SPREAD_DF) / grown, 0.0)
            inverse -= factor[:, np.newaxis, np.newaxis] * along[:, :, np.newaxis] * along[:, np.newaxis]
            scales[:, j] = np.where(moved, there, here)
    return scales


def wishart(rng: np.random.Generator, df: float, inverse_scale: Array) -> Array:
    """Draws ``[c, k, k]`` of Wishart distributions whose scales are the inverses of ``[c, k, k]`` (Bartlett)."""
    chains, size, _ = inverse_scale.shape
    bartlett = np.zeros((chains, size, size))
    diagonal, below = np.arange(size), np.tril_indices(size, -1)
    bartlett[:, diagonal, diagonal] = np.sqrt(rng.chisquare(df - diagonal, size=(chains, size)))
    bartlett[:, below[0], below[1]] = rng.standard_normal((chains, below[0].size))
    root = np.linalg.solve(np.linalg.cholesky(inverse_scale).transpose(0, 2, 1), bartlett)
    return np.asarray(root @ root.transpose(0, 2, 1))


def from_prior(rng: np.random.Generator, chains: int, size: int, specimens: int, *, heavy: bool) -> Population:
    """``c`` draws of the prior of a population."""
    scales = 1.0 / rng.gamma(0.5, SPREAD_SCALE**2, size=(chains, size))
    inverse = np.zeros((chains, size, size))
    inverse[:, np.arange(size), np.arange(size)] = 2.0 * SPREAD_DF / scales
    precision = wishart(rng, SPREAD_DF + size - 1.0, inverse)
    mean = rng.standard_normal((chains, size))
    weights = rng.gamma(TAIL_DF / 2, 2.0 / TAIL_DF, size=(specimens, chains)) if heavy else np.ones((specimens, chains))
    return Population(mean, precision, scales, weights)


def specimens_of(rng: np.random.Generator, population: Population, *, heavy: bool) -> Array:
    """Scores ``[c, k]`` of one new specimen from each draw of a population."""
    root = np.linalg.cholesky(population.precision).transpose(0, 2, 1)
    apart = np.linalg.solve(root, rng.standard_normal((*population.mean.shape, 1)))[..., 0]
    if heavy:
        apart /= np.sqrt(rng.gamma(TAIL_DF / 2, 2.0 / TAIL_DF, size=(len(apart), 1)))
    return np.asarray(population.mean + apart)


def moments(mean: Array, spread: Array, *, heavy: bool) -> tuple[Array, Array]:
    """Mean and standard deviation on the unit cube of populations with ``mean`` and ``spread`` as scores.

    All of one shape; by quadrature.
    """
    if heavy:
        nodes = student_t.ppf((np.arange(NODES) + 0.5) / NODES, TAIL_DF)
        weights = np.full(NODES, 1.0 / NODES)
    else:
        nodes, weights = np.polynomial.hermite_e.hermegauss(NODES)
        weights = weights / weights.sum()
    at = places(mean[..., np.newaxis] + spread[..., np.newaxis] * nodes)
    centre = at @ weights
    variance = np.maximum(np.square(at) @ weights - centre**2, 0.0)
    return centre, np.sqrt(variance)
