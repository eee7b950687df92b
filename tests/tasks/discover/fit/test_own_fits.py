"""Fits of a model of the user's own: with few runs of its solver, whose derivatives are its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import SOLVER_STEP, Fitted, derivatives, fit, look_ahead, residuals, starts
from sinew.tasks.discover.fit.sizes import library_for
from sinew.tasks.discover.measure.conflict import conflict, rank
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Model
from tests.tasks.discover.own_model import OWN, TRUTH, OwnBar, pulled


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
