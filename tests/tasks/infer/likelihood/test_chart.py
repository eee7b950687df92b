"""Coordinates of a specimen's posterior: there and back, their volumes, and how nearly normal they are."""

import numpy as np
import pytest
from scipy.optimize import minimize

from sinew.tasks.infer.likelihood.chart import chart_of
from sinew.tasks.infer.likelihood.emulator import emulator
from sinew.tasks.infer.likelihood.scores import places
from tests.tasks.infer.likelihood.problem import SIZE, known

CHART = chart_of(known(), np.zeros(SIZE))
SOME = 0.5 * np.random.default_rng(3).standard_normal((20, SIZE))


def determinants(function, scores):
    """Of the derivatives of a map of scores ``[n, k]``."""
    steps = 1e-5 * np.eye(SIZE)
    slopes = np.array([(function(scores + step) - function(scores - step)) / 2e-5 for step in steps])
    return np.linalg.slogdet(slopes.transpose(1, 2, 0))[1]


def test_there_and_back():
    steps = 0.3 * np.random.default_rng(4).standard_normal(SOME.shape)
    ends, volumes = CHART.displaced(SOME, steps)
    assert np.isfinite(volumes).all()
    np.testing.assert_allclose(CHART.coordinates(ends) - CHART.coordinates(SOME), steps, atol=1e-6)
    back, others = CHART.displaced(ends, -steps)
    np.testing.assert_allclose(back, SOME, atol=1e-6)
    np.testing.assert_allclose(others, -volumes, atol=1e-6)


def test_volumes_are_determinants():
    steps = np.full(SOME.shape, 0.3)
    ends, volumes = CHART.displaced(SOME, steps)
    apart = determinants(CHART.coordinates, ends) - determinants(CHART.coordinates, SOME)
    np.testing.assert_allclose(volumes, apart, atol=1e-6)


def test_far_steps_lead_nowhere_and_leave_scores_as_they_were():
    ends, volumes = CHART.displaced(SOME, np.full(SOME.shape, 1e3))
    assert np.isnan(volumes).all()
    np.testing.assert_array_equal(ends, SOME)


@pytest.mark.parametrize("number", range(SIZE))
def test_one_score_slides_to_where_it_is_wanted_and_others_follow(number):
    def slide(scores):
        return CHART.slid(scores, number, 0.1 + 1.2 * scores[:, number])[0]

    ends, volumes = CHART.slid(SOME, number, 0.1 + 1.2 * SOME[:, number])
    np.testing.assert_allclose(ends[:, number], 0.1 + 1.2 * SOME[:, number], atol=1e-12)
    np.testing.assert_allclose(volumes + np.log(1.2), determinants(slide, SOME), atol=1e-5)
    apart = CHART.coordinates(ends) - CHART.coordinates(SOME)
    assert np.linalg.matrix_rank(apart, tol=1e-5) == 1


def test_the_centre_is_the_likeliest_point():
    def loss(scores):
        return float(CHART.known.squares(places(scores)[np.newaxis])[0] + scores @ scores)

    best = minimize(loss, np.zeros(SIZE), tol=1e-12).x
    np.testing.assert_allclose(CHART.coordinates(best[np.newaxis])[0], 0.0, atol=1e-3)


def test_coordinates_of_a_straight_problem_are_standard_normal():
    """Where components are linear in the scores: the squares of coordinates are those of components and scores."""
    scores = np.random.default_rng(5).standard_normal((200, 2))
    errors = np.concatenate([3.0 * scores[:, :1] + scores[:, 1:], 2.0 * scores[:, 1:]], axis=1) / 50.0
    near = 0.5 + scores / 100.0  # scores as good as linear in places
    chart = chart_of(emulator(near, 50.0 * errors, np.ones(200)), np.zeros(2))
    here = 0.01 * np.random.default_rng(6).standard_normal((5, 2))
    both = chart.known.squares(places(here)) + np.square(here).sum(axis=1)
    found = np.square(chart.coordinates(here)).sum(axis=1)
    np.testing.assert_allclose(found - found[0], both - both[0], rtol=1e-3, atol=1e-5)


def test_precision_is_that_of_draws():
    draws = 0.3 * np.random.default_rng(7).standard_normal((4000, SIZE))
    covariance = np.cov(CHART.coordinates(draws), rowvar=False)
    np.testing.assert_allclose(CHART.fitted(draws).precision @ covariance, np.eye(SIZE), atol=0.05)
