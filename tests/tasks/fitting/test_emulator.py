"""Emulators of courses against functions whose values are known everywhere."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

from sinew.tasks.fitting.emulator import SDS, Emulator, LeftOut, taken_apart, trained, widening
from sinew.tasks.fitting.emulator import _process_without as process_without
from sinew.tasks.fitting.folds import folds_of
from sinew.tasks.fitting.gaussian_process import fitted
from sinew.tasks.simulate.growing import TURN
from sinew.tasks.simulate.plain_design import shares

TIME = np.linspace(0.0, 1.0, 12)


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(1):
        yield


def waves(at):
    """A smooth function ``[n, t]`` of three parameters that is no polynomial."""
    return np.sin(4.0 * at[:, [0]] * TIME) + at[:, [1]] * np.exp(-3.0 * at[:, [2]] * TIME)


def straight(at):
    return at[:, [0]] + 2.0 * at[:, [1]] * TIME - at[:, [2]] * at[:, [0]]


def kinked(at):
    return np.abs(at[:, [0]] - 0.37) * (1.0 + TIME) + 0.0 * at[:, [1]]


def of(function, count, seed=1):
    share = shares(3, count, seed, TURN)
    values = function(share)
    courses = taken_apart(values, np.full(TIME.size, values.std()))
    fits, left_out = trained(share, courses)
    return share, values, courses, fits, left_out


FRESH = np.random.default_rng(5).random((500, 3))


@pytest.mark.parametrize(("function", "count", "least"), [(waves, 64, 0.01), (kinked, 96, 0.2)])
def test_left_out_errors_are_those_of_points_that_were_never_seen(function, count, least):
    told, inside = [], []
    for seed in range(4):
        share, values, courses, fits, left_out = of(function, count, seed)
        mean, sd = Emulator(share, courses, fits).predict(FRESH)
        truth = function(FRESH)
        error = np.sqrt(np.mean((truth - mean) ** 2))
        told.append(np.sqrt(np.mean((values - left_out.mean) ** 2)) / error)
        inside.append(np.mean(np.abs(truth - mean) <= SDS * widening(values, left_out, 3) * sd))
        assert error < least * truth.std()
    assert 0.6 < np.median(told) < 3.0, "an eighth less runs, and points at the edges"
    assert 0.9 < np.mean(inside) <= 1.0


def test_intervals_hold_the_noise_of_a_solver():
    """Runs that differ by more than their parameters say: what is predicted of a run has that scatter, too."""
    inside, kinds = [], set()
    for seed in range(4):
        rng = np.random.default_rng(seed)

        def jittering(at, rng=rng):
            smooth = np.sin(5.0 * at[:, [0]]) * (1.0 + TIME) + at[:, [1]] * TIME
            return smooth + 0.15 * rng.standard_normal((len(at), 1))

        share, values, courses, fits, left_out = of(jittering, 96, seed)
        kinds |= {fit.kind for fit in fits}
        mean, sd = Emulator(share, courses, fits).predict(FRESH)
        inside.append(np.mean(np.abs(jittering(FRESH) - mean) <= SDS * widening(values, left_out, 3) * sd))
    assert "process" in kinds
    assert min(inside) > 0.85


def test_polynomials_are_chosen_for_polynomials_and_found_exactly():
    share, _, courses, fits, _ = of(straight, 64)
    assert {fit.kind for fit in fits} == {"chaos"}
    mean, _ = Emulator(share, courses, fits).predict(FRESH)
    np.testing.assert_allclose(mean, straight(FRESH), atol=1e-9)
    assert max(fit.error for fit in fits) < 1e-9


def test_a_process_is_chosen_for_a_kink():
    assert of(kinked, 96)[3][0].kind == "process"


def test_left_out_values_of_a_process_are_those_of_processes_without_them():
    share, _, courses, _, _ = of(waves, 40)
    scores, folds = courses.scores[:, 0], folds_of(40)
    mean, sd, theta = process_without(share, scores, folds, None)
    scale = scores.std()
    for out in folds:
        # the whole sample's centre and scale, as left-out values have them
        standard = (scores - scores.mean()) / scale
        kernel = fitted(share, scores[:, np.newaxis], np.array(theta), refit=False)[0].regressor
        known = kernel.kernel_(share[~out]) + kernel.alpha * np.eye((~out).sum())
        across = kernel.kernel_(share[out], share[~out])
        expected = across @ np.linalg.solve(known, standard[~out])
        spread = (
            kernel.kernel_(share[out]) - across @ np.linalg.solve(known, across.T) + kernel.alpha * np.eye(out.sum())
        )
        np.testing.assert_allclose(mean[out], scores.mean() + scale * expected, atol=1e-5 * scale)
        np.testing.assert_allclose(sd[out], scale * np.sqrt(np.diag(spread)), rtol=1e-3)


def test_an_emulator_is_made_again_from_its_fits():
    share, _, courses, fits, _ = of(waves, 64)
    one, again = (Emulator(share, courses, fits).predict(FRESH[:5]) for _ in range(2))
    np.testing.assert_array_equal(one[0], again[0])
    np.testing.assert_array_equal(one[1], again[1])


def test_what_does_not_vary_has_no_components():
    values = np.tile(TIME, (16, 1))
    courses = taken_apart(values, np.ones(TIME.size))
    fits, left_out = trained(shares(3, 16, 1, TURN), courses)
    assert not fits
    np.testing.assert_allclose(left_out.mean, values)
    mean, sd = Emulator(shares(3, 16, 1, TURN), courses, fits).predict(FRESH[:2])
    np.testing.assert_allclose(mean, values[:2])
    assert sd.max() < 1e-9
    assert widening(values, LeftOut(values, np.zeros(values.shape)), 3) == 1.0


@given(st.integers(0, 2**32 - 1), st.integers(2, 20), st.integers(1, 9))
def test_courses_are_put_together_again(seed, runs, points):
    rng = np.random.default_rng(seed)
    values, scale = rng.standard_normal((runs, points)) * 10.0 ** rng.integers(-5, 5), rng.uniform(0.5, 2.0, points)
    courses = taken_apart(values, scale)
    again = courses.centre + courses.scale * (courses.scores @ courses.directions)
    left = np.sqrt(np.mean((values - again) ** 2, axis=0))
    np.testing.assert_allclose(left, scale * courses.rest, atol=1e-12 * np.abs(values).max())


def test_intervals_are_wider_where_left_out_values_were_too_sure():
    rng = np.random.default_rng(1)
    values = rng.standard_normal((400, 5))
    for sd in (0.5, 2.0):
        found = LeftOut(np.zeros(values.shape), np.full(values.shape, sd))
        assert widening(values, found, 0) == pytest.approx(1.0 / sd, rel=0.05)
    few = LeftOut(np.zeros((20, 5)), np.ones((20, 5)))
    assert widening(values[:20], few, 8) > 1.3 * widening(values[:20], few, 0)
