"""Least squares with derivatives that are renewed seldom ends where ordinary least squares does, in fewer runs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from sinew.tasks.fitting import few_runs
from sinew.tasks.fitting.few_runs import ENOUGH, least_squares_of_few, most_runs

TIME = np.linspace(0.0, 3.0, 60)


def relaxing(at):
    return 40.0 * (at[0] + at[1] * np.exp(-TIME / (0.1 + 2.0 * at[2])))


class Asked:
    """The misfit to a relaxation, and how often it was asked."""

    def __init__(self, target):
        self.target, self.runs = target, 0

    def residuals(self, at):
        self.runs += 1
        return relaxing(at) - self.target

    def derivatives(self, at):
        seen = self.residuals(at)
        return seen, np.stack([(self.residuals(at + step) - seen) / 1e-4 for step in 1e-4 * np.eye(3)], axis=1)


@settings(max_examples=60, deadline=None)
@given(
    truth=st.tuples(*[st.floats(0.05, 0.95)] * 3),
    start=st.tuples(*[st.floats(0.2, 0.8)] * 3),
    seed=st.integers(0, 99),
)
def test_it_ends_where_least_squares_does(truth, start, seed):
    noise = np.random.default_rng(seed).normal(0.0, 1.0, TIME.size)
    asked = Asked(relaxing(np.array(truth)) + noise)
    found = least_squares_of_few(asked.residuals, asked.derivatives, np.array(start))
    reference = least_squares(lambda at: relaxing(at) - asked.target, np.array(start), bounds=(0.0, 1.0))
    assert 2.0 * found.cost <= 2.0 * reference.cost + 3.0 * ENOUGH
    assert np.all((found.x >= 0.0) & (found.x <= 1.0))
    np.testing.assert_allclose(found.fun, relaxing(found.x) - asked.target)
    np.testing.assert_allclose(found.grad, found.jac.T @ found.fun)
    assert asked.runs < 100


def test_derivatives_follow_the_steps_that_tell_them():
    """After a step, they give its change exactly (Broyden); a tiny one shows the tolerance of a solver only."""
    here = np.array([0.4, 0.5, 0.3])
    seen, first = Asked(np.zeros(TIME.size)).derivatives(here)
    point = few_runs._Point(here, seen, first)
    for step in ([1e-9, 0.0, 0.0], [0.0, -1e-5, 1e-6]):
        assert point.after(np.array(step), seen + 0.1).slopes is first
    for step in ([0.02, 0.0, 0.01], [0.0, 0.03, 0.0]):
        there = point.after(np.array(step), relaxing(point.at + step))
        np.testing.assert_allclose(there.slopes @ step, there.seen - point.seen, atol=1e-9)
        np.testing.assert_array_equal(there.at, point.at + step)
        point = there
    assert np.abs(point.slopes - first).max() < 0.5 * np.abs(first).max()


class Nearly:
    """A relaxation like the model's but for a force that is too large, and how often one went back."""

    def __init__(self, target, wrong):
        self.target, self.wrong, self.kept, self.back = target, wrong, 0, 0

    def __call__(self, at):
        return np.array([self.wrong * relaxing(each) for each in at]) - self.target

    def keep(self):
        self.kept += 1

    def go_back(self):
        self.back += 1
        assert self.back <= self.kept


@pytest.mark.parametrize("wrong", [1.0, 1.1, 0.7])
def test_what_is_like_the_model_leads_to_its_minimum(wrong):
    """It need not be exact: it is corrected to be so at the last point."""
    truth = np.array([0.3, 0.6, 0.1])
    asked = Asked(relaxing(truth) + np.random.default_rng(1).normal(0.0, 1.0, TIME.size))
    reference = least_squares(lambda at: relaxing(at) - asked.target, truth, bounds=(0.0, 1.0))
    nearly = Nearly(asked.target, wrong)
    found = least_squares_of_few(asked.residuals, asked.derivatives, np.array([0.9, 0.1, 0.9]), nearly=nearly)
    assert 2.0 * found.cost <= 2.0 * reference.cost + ENOUGH
    if wrong == 1.0:
        assert (asked.runs, nearly.back) <= (2 * 4 + 3, 1), "one step, derivatives, and what little is left"
    assert asked.runs < 60


def test_where_too_little_is_known_steps_are_linear():
    asked = Asked(relaxing(np.array([0.3, 0.6, 0.1])))
    nearly = Nearly(asked.target, 1.0)
    nearly.__class__ = type("Unknown", (Nearly,), {"__call__": lambda *_: None})
    found = least_squares_of_few(asked.residuals, asked.derivatives, np.array([0.9, 0.1, 0.9]), nearly=nearly)
    assert found.cost < ENOUGH


@pytest.mark.parametrize("failure", [np.nan, 1e3])
def test_a_step_that_fails_is_a_step_too_far(failure):
    """Nothing is learned of residuals that are none; half the step is tried next."""
    asked = Asked(relaxing(np.array([0.3, 0.6, 0.1])))

    def failing(at):
        asked.runs += 1
        return np.full(TIME.size, failure) if np.abs(at - 0.3).max() > 0.45 else relaxing(at) - asked.target

    def derivatives_at(at):
        seen = failing(at)
        return seen, np.stack([(failing(at + step) - seen) / 1e-4 for step in 1e-4 * np.eye(3)], axis=1)

    found = least_squares_of_few(failing, derivatives_at, np.array([0.7, 0.1, 0.7]))
    assert found.cost < ENOUGH
    assert asked.runs <= most_runs(3)


def test_a_start_that_fails_is_refused():
    nothing = np.full(TIME.size, np.nan)
    with pytest.raises(ValueError, match="the residuals at the start are not finite"):
        least_squares_of_few(lambda _: nothing, lambda _: (nothing, np.zeros((TIME.size, 3))), np.full(3, 0.5))


def test_derivatives_are_those_near_the_end():
    """The last are found anew where the search ends, after however many renewals."""
    asked, renewed = Asked(relaxing(np.array([0.3, 0.6, 0.1]))), []

    def derivatives_at(at):
        renewed.append(at)
        return asked.derivatives(at)

    for renewals in (1, 2, 5):
        found = least_squares_of_few(asked.residuals, derivatives_at, np.array([0.9, 0.1, 0.9]), renewals=renewals)
        assert np.abs(renewed[-1] - found.x).max() < 0.01
        assert asked.runs <= most_runs(3, renewals)
        asked.runs = 0


def test_where_it_misleads_it_is_gone_back():
    """A step that makes things worse is not taken; the next is shorter."""
    asked = Asked(relaxing(np.array([0.3, 0.6, 0.1])))
    nearly = Nearly(asked.target, -1.0)
    start = np.array([0.5, 0.5, 0.5])
    found = least_squares_of_few(asked.residuals, asked.derivatives, start, nearly=nearly)
    assert nearly.back > 2
    assert found.cost <= 0.5 * np.sum((relaxing(start) - asked.target) ** 2) * (1.0 + 1e-12)
    np.testing.assert_allclose(found.fun, relaxing(found.x) - asked.target)


def test_derivatives_are_renewed_until_they_lead_no_further():
    asked, renewed = Asked(relaxing(np.array([0.3, 0.6, 0.1]))), []

    def derivatives_at(at):
        renewed.append(at)
        return asked.derivatives(at)

    found = least_squares_of_few(asked.residuals, derivatives_at, np.array([0.9, 0.1, 0.9]))
    assert found.cost < ENOUGH
    assert 1 < len(renewed) < 6
    assert asked.runs < 60
    assert asked.runs <= most_runs(3)


def test_other_bounds_and_fewer_renewals():
    asked, renewed = Asked(relaxing(np.array([1.4, 1.7, 0.2]))), []

    def derivatives_at(at):
        renewed.append(at)
        return asked.derivatives(at)

    found = least_squares_of_few(asked.residuals, derivatives_at, np.array([0.5, 0.5, 0.5]), (-1.5, 1.5), 4)
    assert len(renewed) <= 5
    assert found.x[1] == np.clip(found.x[1], -1.5, 1.5)
    assert found.x[0] > 1.0, "outside of a unit cube"
    assert asked.runs <= most_runs(3, 4)
    renewed.clear()
    least_squares_of_few(asked.residuals, derivatives_at, np.array([0.5, 0.5, 0.5]), (-1.5, 1.5), 1)
    assert len(renewed) == 2, "it would go on"
