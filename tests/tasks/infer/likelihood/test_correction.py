"""Weights of draws, against normal distributions of which all is known."""

from dataclasses import fields

import numpy as np
import pytest

from sinew.tasks.infer.likelihood.chains import CHAINS, Block
from sinew.tasks.infer.likelihood.correction import Draws, draws_of, resampled, weighted

COUNT = 4000


def shifted(shift):
    """Draws ``[m, n]`` of standard normal distributions, and their weights where the model's are shifted ones."""
    at = np.random.default_rng(1).standard_normal((COUNT, len(shift)))
    return at, weighted((at - shift) ** 2, at**2)


def test_weighted_draws_stand_for_the_model():
    shift = np.array([0.3, -0.2, 0.0])
    at, found = shifted(shift)
    assert found.weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(found.weights @ at, shift, atol=0.05)
    assert found.efficiency == pytest.approx(np.exp(-np.sum(shift**2)), abs=0.03)
    assert found.tail < 0.5
    numbers = resampled(np.random.default_rng(2), found.weights)
    np.testing.assert_allclose(at[numbers].mean(axis=0), shift, atol=0.05)


def test_no_mean_is_farther_away_than_is_told():
    shift = np.array([0.05, 0.03])
    at, found = shifted(shift)
    differences = np.abs(found.weights @ at - at.mean(axis=0)) / at.std(axis=0)
    assert differences.max() <= found.apart
    assert found.apart == pytest.approx(np.sqrt(np.expm1(np.sum(shift**2))), rel=0.1)


def test_equal_likelihoods_have_equal_weights():
    squares = np.random.default_rng(3).random((50, 2))
    found = weighted(squares + 7.0, squares)
    np.testing.assert_allclose(found.weights, 1 / 50)
    assert found.apart == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_array_equal(resampled(np.random.default_rng(4), found.weights), np.arange(50))


def test_nearly_equal_likelihoods_have_a_tail_that_is_no_worry():
    rng = np.random.default_rng(5)
    squares = rng.random((100, 1))
    assert weighted(squares + 1e-9 * rng.random((100, 1)), squares).tail < 0.7


def test_where_the_model_fails_a_draw_has_no_weight():
    squares = np.zeros((40, 2))
    exact = squares.copy()
    exact[3, 1] = np.inf
    found = weighted(exact, squares)
    assert found.weights[3] == 0.0
    assert found.weights.sum() == pytest.approx(1.0)
    assert found.apart == pytest.approx(np.sqrt(40 / 39 - 1))
    assert 3 not in resampled(np.random.default_rng(6), found.weights)


def test_a_model_that_fails_everywhere_leaves_nothing():
    found = weighted(np.full((20, 1), np.inf), np.zeros((20, 1)))
    assert found.weights.sum() == 0.0
    assert found.tail == np.inf
    assert found.efficiency == 0.0
    assert found.apart == np.inf


def test_a_heavy_tail_is_seen():
    at = np.random.default_rng(7).standard_normal((COUNT, 1))
    found = weighted(np.log1p(np.square(at)), 4.0 * at**2)  # a Cauchy distribution, from one that is far too narrow
    assert found.tail > 0.7


def test_draws_are_of_the_chain_whose_turn_it_is():
    sweeps, n, k = 6, 2, 3
    start = np.arange(sweeps * CHAINS, dtype=float).reshape(sweeps, CHAINS)
    blocks = []
    for first in (0, 3):  # two blocks of three sweeps
        part = start[first : first + 3]
        of_specimens = np.broadcast_to(part[..., None, None], (3, CHAINS, n, k))
        of_population = np.broadcast_to(part[..., None], (3, CHAINS, k))
        correlation = np.broadcast_to(np.arange(first, first + 3.0)[:, None, None], (3, k, k))
        blocks.append(
            Block(None, of_specimens, of_specimens[..., 0], *[of_population] * 3, correlation, np.ones(n))  # type: ignore[arg-type]
        )
    found = draws_of([blocks, blocks])
    assert len(found) == 6
    np.testing.assert_array_equal(found.mean[:3, 0], [start[t, t % CHAINS] for t in (3, 4, 5)])
    np.testing.assert_array_equal(found.scores[:, 1, 2], found.mean[:, 0])
    np.testing.assert_array_equal(found.correlation[:3, 0, 0], [3, 4, 5])
    picked = found.at(np.array([4, 0]))
    assert {one.name: getattr(picked, one.name).shape[0] for one in fields(Draws)} == dict.fromkeys(
        (one.name for one in fields(Draws)), 2
    )
