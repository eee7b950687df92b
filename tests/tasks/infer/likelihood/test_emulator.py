"""The emulator of a likelihood, and walks on it, against a posterior that is known exactly."""

import numpy as np
import pytest
from scipy.special import ndtr

from sinew.tasks.infer.likelihood.chart import chart_of
from sinew.tasks.infer.likelihood.emulator import Prior, emulator, scatter_of, walk
from sinew.tasks.model.parameters import own_parameter

SIZE = 3
CHART = chart_of(tuple(own_parameter(f"p{j}", "1", 0.0, 1.0) for j in range(SIZE)))
MATRIX = np.random.default_rng(1).normal(size=(12, SIZE)) * [8.0, 4.0, 0.5]
CENTRE = np.array([0.4, 0.6, 0.5])


def errors(at):
    """Errors that are products of up to two parameters."""
    return (at - CENTRE) @ MATRIX.T + 3.0 * (at[:, :1] - 0.4) * (at[:, 1:2] - 0.6) + np.arange(12) / 6


def known():
    at = np.random.default_rng(2).uniform(size=(60, SIZE))
    return emulator(at, errors(at), np.ones(len(at)))


def test_polynomials_of_second_order_are_emulated_exactly():
    at = np.random.default_rng(4).uniform(size=(9, SIZE))
    np.testing.assert_allclose(known().squares(at), np.square(errors(at)).sum(axis=1), rtol=1e-6)


def test_slopes_of_components_are_those_of_the_errors():
    at = np.array([[0.3, 0.5, 0.6]])
    steps = 1e-5 * np.eye(SIZE)
    exact = (errors(at + steps) - errors(at - steps)) / 2e-5
    found = known().slopes(at)[0]
    np.testing.assert_allclose(found @ found.T, exact @ exact.T, rtol=1e-4)


@pytest.mark.parametrize("power", [0.0, 7.0])
def test_walks_draw_from_the_posterior(power):
    """Against importance sampling of the same density: means and standard deviations agree."""
    rng = np.random.default_rng(5)
    chains, model = 400, known()
    prior = Prior(np.full((chains, SIZE), 0.2), np.broadcast_to(np.diag([1.0, 0.5, 2.0]), (chains, SIZE, SIZE)), power)
    wide = 1.5 * rng.standard_normal((200_000, SIZE))
    wide = wide[np.abs(wide).max(axis=1) < 4.0]
    every = Prior(np.full(wide.shape, 0.2), np.broadcast_to(prior.precision[0], (len(wide), SIZE, SIZE)), power)
    log = -0.5 * (model.squares(ndtr(wide)) + every.losses(wide)) + 0.5 * np.square(wide / 1.5).sum(axis=1)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ wide
    sd = np.sqrt(weight @ (wide - mean) ** 2)
    scatter = scatter_of(model, CHART, mean + sd * rng.standard_normal((200, SIZE)))
    at = np.clip(mean + sd * rng.standard_normal((chains, SIZE)), -3.9, 3.9)
    drawn = []
    for _ in range(30):
        at = walk(rng, model, scatter, prior, at, 4)
        drawn.append(at)
    found = np.concatenate(drawn[5:])
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.06 * sd.max())
    np.testing.assert_allclose(found.std(axis=0), sd, rtol=0.06)


def test_equal_random_numbers_give_equal_walks():
    model, prior = known(), Prior(np.zeros((4, SIZE)), np.broadcast_to(np.eye(SIZE), (4, SIZE, SIZE)))
    begin = np.zeros((4, SIZE))
    scatter = scatter_of(model, CHART, 0.2 * np.random.default_rng(6).standard_normal((50, SIZE)))
    ends = [walk(np.random.default_rng(7), model, scatter, prior, begin, 3) for _ in range(2)]
    np.testing.assert_array_equal(*ends)
    assert not np.array_equal(ends[0], begin)
