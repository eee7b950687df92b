"""Polynomial chaos, where its coefficients are known, and where its indices are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.fitting.chaos import NORM, basis, exponents_up_to, polynomials


def points(count, size=3, seed=0):
    return np.random.default_rng(seed).random((count, size))


@given(size=st.integers(1, 5), degree=st.integers(1, 5))
def test_exponents_are_all_those_within_the_norm(size, degree):
    found = exponents_up_to(size, degree)
    every = np.stack(np.meshgrid(*[np.arange(degree + 1)] * size), axis=-1).reshape(-1, size)
    within = every[(every**NORM).sum(axis=1) <= degree**NORM * (1 + 1e-9)]
    assert {tuple(row) for row in found} == {tuple(row) for row in within}
    assert not found[0].any()


def test_polynomials_are_orthonormal():
    nodes, weights = np.polynomial.legendre.leggauss(8)
    grid = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    weight = np.outer(weights, weights).ravel() / 4
    values = polynomials((grid + 1) / 2, exponents_up_to(2, 4))
    np.testing.assert_allclose(values.T @ (weight[:, np.newaxis] * values), np.eye(values.shape[1]), atol=1e-12)


def test_a_sparse_sum_is_found_again():
    exponents = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 0, 1]])
    coefficients = np.array([5.0, 2.0, 1.0, 0.5])
    share = points(60)
    outcome = polynomials(share, exponents) @ coefficients
    found = basis(share, outcome)
    assert found.unexplained < 1e-10
    at = {tuple(each): value for each, value in zip(found.exponents, found.coefficients(share, outcome), strict=True)}
    for each, value in zip(exponents, coefficients, strict=True):
        assert at.pop(tuple(each)) == pytest.approx(value)
    assert np.allclose(list(at.values()), 0.0, atol=1e-6)


@pytest.mark.parametrize("count", [40, 120])
def test_what_is_left_unexplained_is_what_new_points_show(count):
    """Leave-one-out against 20,000 new points; a function with a corner, which polynomials approach slowly."""

    def function(at):
        return np.abs(4 * at[:, 0] - 2) + at[:, 1] * at[:, 2]

    ratios = []
    new = points(20_000, seed=99)
    for seed in range(8):
        share = points(count, seed=seed)
        outcome = function(share)
        found = basis(share, outcome)
        predicted = polynomials(new, found.exponents) @ found.coefficients(share, outcome)
        ratios.append(found.unexplained / (np.mean((predicted - function(new)) ** 2) / function(new).var()))
    assert 0.5 < np.median(ratios) < 2.5


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_the_unit_of_an_outcome_does_not_matter(unit):
    share = points(64)
    outcome = np.exp(share[:, 0]) * (1.0 + share[:, 1] ** 3) + share[:, 2]
    one, other = basis(share, outcome), basis(share, unit * outcome)
    np.testing.assert_array_equal(one.exponents, other.exponents)
    assert other.unexplained == pytest.approx(one.unexplained)


def test_noise_is_not_explained():
    share = points(100)
    found = basis(share, np.random.default_rng(1).standard_normal(100))
    assert found.unexplained > 0.8
