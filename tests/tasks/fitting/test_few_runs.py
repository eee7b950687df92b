"""Least squares with derivatives that are renewed seldom ends where ordinary least squares does, in fewer runs."""

import numpy as np
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
    rng, here = np.random.default_rng(4), np.array([0.4, 0.5, 0.3])
    rough = {here.tobytes(): relaxing(here)}

    def ask(at):
        return rough.setdefault(at.tobytes(), relaxing(at) + rng.normal(0.0, 0.002, TIME.size))

    first = Asked(np.zeros(TIME.size)).derivatives(here)[1]
    followed = few_runs._Followed(ask, here, ask(here), first)
    for step in ([1e-9, 0.0, 0.0], [0.0, -1e-5, 1e-6]):
        assert followed.residuals(here + step) is rough[(here + step).tobytes()]
        assert followed.slopes(here + step) is first
    for step in ([0.02, 0.0, 0.01], [0.0, 0.03, 0.0]):
        before, here = followed.residuals(here), here + step
        change = followed.residuals(here) - before
        np.testing.assert_allclose(followed.slopes(here) @ step, change, atol=1e-9)
    assert np.abs(followed.slopes(here) - first).max() < 0.5 * np.abs(first).max()


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
