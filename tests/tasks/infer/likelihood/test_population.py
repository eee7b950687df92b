"""The population of a site: its draws against what is known exactly."""

import numpy as np
import pytest
from scipy.stats import kstest, norm
from scipy.stats import t as student_t

from sinew.tasks.infer.likelihood.population import (
    SPREAD_DF,
    SPREAD_SCALE,
    Population,
    drawn,
    from_prior,
    moments,
    specimens_of,
    wishart,
)
from sinew.tasks.infer.likelihood.scores import places

SIZE = 3


def spreads(population):
    return np.sqrt(np.diagonal(population.covariance(), axis1=1, axis2=2))


def test_wishart_has_its_mean():
    scale = np.array([[2.0, 0.5], [0.5, 1.0]])
    draws = wishart(np.random.default_rng(0), 7.0, np.broadcast_to(np.linalg.inv(scale), (40_000, 2, 2)))
    np.testing.assert_allclose(draws.mean(axis=0), 7.0 * scale, rtol=0.02)


def test_spreads_of_the_prior_are_half_t_and_correlations_uniform():
    population = from_prior(np.random.default_rng(1), 4000, SIZE, 1, heavy=False)
    covariance, spread = population.covariance(), spreads(population)
    assert kstest(spread[:, 0] / SPREAD_SCALE, lambda x: 2 * student_t.cdf(x, SPREAD_DF) - 1).pvalue > 0.001
    correlation = covariance[:, 0, 1] / spread[:, 0] / spread[:, 1]
    assert kstest(correlation, "uniform", args=(-1, 2)).pvalue > 0.001


@pytest.mark.parametrize("heavy", [False, True])
def test_draws_in_turn_of_specimens_and_population_keep_the_prior(heavy):
    """Geweke's test (2004): without data, drawing each given the other must leave the prior as it is."""
    rng = np.random.default_rng(2)
    count, chains = 4, 3000
    population = from_prior(rng, chains, SIZE, count, heavy=heavy)
    weights = np.ones((count, chains)) if not heavy else population.weights
    for _ in range(3):
        root = np.linalg.cholesky(population.precision).transpose(0, 2, 1)
        apart = np.linalg.solve(root[np.newaxis], rng.standard_normal((count, chains, SIZE, 1)))[..., 0]
        scores = population.mean + apart / np.sqrt(weights)[..., np.newaxis]
        population = drawn(rng, scores, population, heavy=heavy)
        weights = population.weights
    assert kstest(population.mean[:, 0], norm.cdf).pvalue > 0.001
    assert (
        kstest(spreads(population)[:, 1] / SPREAD_SCALE, lambda x: 2 * student_t.cdf(x, SPREAD_DF) - 1).pvalue > 0.001
    )
    if heavy:
        assert kstest(population.weights[0], "gamma", args=(2.0, 0.0, 0.5)).pvalue > 0.001


def test_the_mean_of_known_specimens_is_as_sure_as_by_students_test():
    rng = np.random.default_rng(3)
    chains, count = 2000, 9
    values = 0.3 + 0.5 * rng.standard_normal((count, SIZE))
    scores = np.repeat(values[:, np.newaxis], chains, axis=1)
    population = from_prior(rng, chains, SIZE, count, heavy=False)
    means = []
    for step in range(60):
        population = drawn(rng, scores, population, heavy=False)
        if step >= 20:
            means.append(population.mean)
    low, high = np.quantile(np.concatenate(means), [0.025, 0.975], axis=0)
    best = 2 * student_t.ppf(0.975, count - 1) * values.std(axis=0, ddof=1) / np.sqrt(count)
    np.testing.assert_allclose((high - low) / best, 1.0, atol=0.12)


def test_the_prior_of_one_specimen_is_that_of_the_others():
    """With the covariance integrated out: against draws of covariances."""
    rng = np.random.default_rng(4)
    count, chains = 5, 2
    scores = rng.standard_normal((count, chains, SIZE))
    scales = np.full((chains, SIZE), 0.7)
    given = Population(np.zeros((chains, SIZE)), np.zeros((chains, SIZE, SIZE)), scales, np.ones((count, chains)))
    prior = given.of_one(2, scores)
    others = np.delete(scores[:, 0], 2, axis=0)
    scatter = others.T @ others + np.diag(2 * SPREAD_DF / scales[0])
    covariances = np.linalg.inv(wishart(rng, SPREAD_DF + SIZE - 1 + 4, np.broadcast_to(scatter, (60_000, SIZE, SIZE))))
    points = np.array([[0.1, 0.2, -0.3], [1.0, -1.0, 0.5]])
    density = [
        np.mean(np.exp(-0.5 * np.einsum("j,cjk,k->c", x, np.linalg.inv(covariances), x))
                / np.sqrt(np.linalg.det(covariances)))
        for x in points
    ]  # fmt: skip
    losses = [prior.losses(np.array([x, x]))[0] for x in points]
    assert losses[1] - losses[0] == pytest.approx(-2 * np.log(density[1] / density[0]), abs=0.05)


@pytest.mark.parametrize("heavy", [False, True])
def test_moments_are_those_of_specimens(heavy):
    rng = np.random.default_rng(5)
    chains = 200_000
    population = Population(
        np.full((chains, 1), 0.6), np.full((chains, 1, 1), 1 / 0.8**2), np.ones((chains, 1)), np.ones((1, chains))
    )
    points = places(specimens_of(rng, population, heavy=heavy))
    mean, sd = moments(np.array(0.6), np.array(0.8), heavy=heavy)
    assert mean == pytest.approx(points.mean(), abs=0.004)
    assert sd == pytest.approx(points.std(), abs=0.006)
