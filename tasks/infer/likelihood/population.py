"""The population of a site: specimens scatter normally, with any correlations, as normal scores.

A score z stands for the point u = Phi(z) of the unit cube, Phi being the normal distribution: bounds are infinitely far
away, and standard normal scores are uniform between them. A specimen's scores x are N(m, C); or, with heavy tails,
Student's t with 4 degrees of freedom, as a normal distribution of covariance C / w with w ~ Gamma(2, 2). Priors:

========================  =============================================================================================
mean m                    independent N(0, 1): uniform over the ranges
covariance C              Huang and Wand (2013, Bayesian Analysis 8, 439): every spread half-t with 2 degrees of freedom
                          and scale 0.5, every correlation uniform on (-1, 1)
========================  =============================================================================================

The half-t's density falls as 1/spread near its scale, so intervals of well determined means are close to those of
Student's t test. All conditional distributions are standard ones, from which :func:`drawn` draws in turn (Gibbs).
Arrays hold ``c`` chains of ``k`` parameters.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr
from scipy.stats import t as student_t

from sinew.tasks.infer.likelihood.emulator import Prior
from sinew.tasks.simulate import Array

MEAN_SD = 1.0
SPREAD_DF, SPREAD_SCALE = 2.0, 0.5
TAIL_DF = 4.0
NODES = 41  # of the quadrature over a population


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
        apart = np.sqrt(self.weights)[:, :, np.newaxis] * (scores - self.mean)
        apart = np.delete(apart, number, axis=0)
        scatter = np.einsum("ncj,nck->cjk", apart, apart)
        scatter[:, np.arange(size), np.arange(size)] += 2.0 * SPREAD_DF / self.scales
        precision = self.weights[number][:, np.newaxis, np.newaxis] * np.linalg.inv(scatter)
        return Prior(self.mean, precision, SPREAD_DF + size - 1.0 + count)

    def covariance(self) -> Array:
        """``[c, k, k]``, of the normal distribution or of the t distribution's core."""
        return np.asarray(np.linalg.inv(self.precision))


def drawn(rng: np.random.Generator, scores: Array, before: Population, *, heavy: bool) -> Population:
    """The next draw of a population, given its specimens' ``scores`` ``[n, c, k]``."""
    count, chains, size = scores.shape
    diagonal = np.arange(size)
    weights = before.weights
    apart = scores - before.mean
    if heavy:
        distances = np.einsum("ncj,cjk,nck->nc", apart, before.precision, apart)
        weights = rng.gamma((TAIL_DF + size) / 2, 2.0 / (TAIL_DF + distances))
    scatter = np.einsum("nc,ncj,nck->cjk", weights, apart, apart)
    scatter[:, diagonal, diagonal] += 2.0 * SPREAD_DF / before.scales
    precision = wishart(rng, SPREAD_DF + size - 1.0 + count, scatter)
    rate = SPREAD_DF * precision[:, diagonal, diagonal] + 1.0 / SPREAD_SCALE**2
    scales = 1.0 / rng.gamma((SPREAD_DF + size) / 2, 1.0 / rate)
    known = weights.sum(axis=0)[:, np.newaxis, np.newaxis] * precision
    known[:, diagonal, diagonal] += 1.0 / MEAN_SD**2
    pull = np.einsum("cjk,ck->cj", precision, np.einsum("nc,nck->ck", weights, scores))
    root = np.linalg.cholesky(known)
    noise = rng.standard_normal((chains, size))
    mean = np.linalg.solve(known, pull[..., np.newaxis])[..., 0]
    mean += np.linalg.solve(root.transpose(0, 2, 1), noise[..., np.newaxis])[..., 0]
    return Population(mean, precision, scales, weights)


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
    mean = MEAN_SD * rng.standard_normal((chains, size))
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
    at = ndtr(mean[..., np.newaxis] + spread[..., np.newaxis] * nodes)
    centre = at @ weights
    variance = np.maximum(np.square(at) @ weights - centre**2, 0.0)
    return centre, np.sqrt(variance)
