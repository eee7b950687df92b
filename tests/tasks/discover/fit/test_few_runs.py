"""Least squares with derivatives that are renewed seldom ends where ordinary least squares does, in fewer runs."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.fit import few_runs
from sinew.tasks.discover.fit.few_runs import ENOUGH, least_squares_of_few
from sinew.tasks.discover.fit.fit import SOLVER_STEP, Candidate, Fitted, derivatives, fit, look_ahead, residuals, starts
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.discover.measure.conflict import conflict, rank
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Model
from tests.tasks.discover.own_model import OWN, TRUTH, OwnBar, pulled

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


def test_directions_that_only_a_tolerance_moves_are_not_seen():
    own, tissue = Candidate(OWN, solver=OwnBar()), Candidate(Model())
    assert (own.seen, tissue.seen, replace(tissue, solver=OwnBar()).seen) == (1e-3, 1e-8, 1e-8)
    slopes = np.random.default_rng(1).normal(0.0, 1.0, (50, 3)) * [300.0, 20.0, 0.01]
    assert (rank(slopes, own.seen), rank(slopes, tissue.seen)) == (2, 3)


def test_a_conflict_counts_what_the_solver_of_the_model_tells(lagging):
    at = np.full(3, 0.5)
    fitted = Fitted(at, 1.0, 1, np.ones(3), np.zeros(3))
    counted = []
    for seen in (0.9, 1e-3):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Candidate, "seen", seen)
            found = conflict(Candidate(OWN, solver=OwnBar()), lagging, fitted, [fitted, fitted])
        counted.append(found.freedom)
    assert counted[0] < counted[1]


def test_starts_of_a_model_of_ones_own_are_different():
    drawn = starts(Candidate(OWN, solver=OwnBar()), np.random.default_rng(1), 5)
    assert len({tuple(each) for each in drawn}) == 5
    assert drawn[0].tolist() == [0.5, 0.5, 0.5]


def test_derivatives_are_renewed_until_they_lead_no_further():
    asked, renewed = Asked(relaxing(np.array([0.3, 0.6, 0.1]))), []

    def derivatives_at(at):
        renewed.append(at)
        return asked.derivatives(at)

    found = least_squares_of_few(asked.residuals, derivatives_at, np.array([0.9, 0.1, 0.9]))
    assert found.cost < ENOUGH
    assert 1 < len(renewed) < 6
    assert asked.runs < 60


@pytest.fixture(scope="module")
def lagging():
    return Measured(pulled((), (), 0.05), Noise(0.05, 0.0))


def test_a_model_of_ones_own_is_fitted_by_its_own_runs(lagging):
    solver = OwnBar()
    own = Candidate(OWN, solver=solver)
    assert own.stand_in is own
    assert own.varied == ("E", "nu_m", "tau"), "no parameter is blind because of its name"
    found = fit(own, lagging, np.full(3, 0.5))
    low, high = own.bounds()
    np.testing.assert_allclose(low + (high - low) * found.at, TRUTH, rtol=0.03)
    assert found.loss / found.points == pytest.approx(1.0, abs=0.3)
    assert solver.runs[0] < 60


@pytest.mark.parametrize("name", ["machine-compliance", "time-lag", "grip-slip/force"])
def test_with_effects_around_it_the_fit_is_that_of_exact_least_squares(lagging, name):
    known = library_for([lagging.specimen])
    effect = next(form for each in known.values() for form in (each, *each.other_forms) if form.name == name)
    own = Candidate(OWN, (effect,), OwnBar())
    start = np.concatenate([np.full(3, 0.4), own.null() + 0.2 * (own.typical() - own.null())])
    found = fit(own, lagging, start)

    def loss(at):
        return residuals(own, lagging, at[np.newaxis], lagging.curves)[0]

    exact = least_squares(loss, np.clip(start, 1e-6, 1 - 1e-6), bounds=(0.0, 1.0), diff_step=1e-3)
    assert found.loss < 2.0 * exact.cost + 1.0


@pytest.mark.parametrize(("name", "value"), [("time-lag", 0.3), ("machine-compliance", 0.004)])
def test_what_an_effect_promises_is_what_its_fit_reaches(name, value):
    effect = library_for([pulled()])[name]
    measured = Measured(pulled((effect,), (value,)), Noise(0.05, 0.0))
    solver = OwnBar()
    bare = Candidate(OWN, solver=solver)
    alone = fit(bare, measured, np.full(3, 0.5))
    solver.runs[0] = 0
    promised, start = look_ahead(bare, alone.at, effect, measured)
    assert solver.runs[0] < 60
    reached = fit(bare.having(effect), measured, start)
    assert abs(promised - reached.loss) < 0.1 * (alone.loss - reached.loss)


def test_derivatives_are_those_of_the_solver(lagging):
    own = Candidate(OWN, (library_for([lagging.specimen])["machine-compliance"],), OwnBar())
    at = np.array([0.3, 0.5, 0.3, 0.4])
    _, slopes = derivatives(own, lagging, at, lagging.curves)
    step = 2.0 * SOLVER_STEP
    for k, move in enumerate(step * np.eye(4)):
        ends = residuals(own, lagging, np.array([at - move, at + move]), lagging.curves)
        central = (ends[1] - ends[0]) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, k], central, atol=0.03 * np.abs(central).max())
