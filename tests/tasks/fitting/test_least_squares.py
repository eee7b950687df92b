"""The fit on problems whose answer is known: linear, nonlinear, at a bound, with failures, and on a tendon."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.fitting.fits import FitSession, exchanged, uncertainty, weighing_of
from sinew.tasks.fitting.least_squares import Fit, Seen, Weighing, least_squares
from sinew.tasks.model import TENDON, Model
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial

TIMES = np.linspace(0, 1, 200)


def drive(fit, curve, measured, fails=lambda point: False) -> Fit:
    """Run a fit against ``curve(point)``; every point of the curve is kept."""
    asked = next(fit)
    try:
        while True:
            forces = np.array([np.full(TIMES.size, np.nan) if fails(point) else curve(point) for point in asked])
            rmse = np.sqrt(np.mean((forces - measured) ** 2, axis=1))
            asked = fit.send(Seen(rmse[:, np.newaxis], (forces,)))
    except StopIteration as end:
        return end.value


WEIGHING = Weighing((TIMES.size,), (np.ones(TIMES.size),))


def exponential(point):
    return 5 * point[0] * np.exp(-4 * point[1] * TIMES) + point[2]


def test_the_truth_is_found_from_afar():
    truth = np.array([0.7, 0.3, 0.45])
    noise = 0.01 * np.random.default_rng(1).normal(size=TIMES.size)
    fit = drive(least_squares(np.array([0.1, 0.9, 0.9]), WEIGHING, 500), exponential, exponential(truth) + noise)
    assert fit.converged
    assert fit.at == pytest.approx(truth, abs=0.01)
    assert fit.objective[0] <= np.sqrt(np.mean(noise**2))
    totals = [total for _, total in fit.trace]
    assert totals == sorted(totals, reverse=True)


def test_the_interval_is_that_of_the_least_squares_theory():
    truth = np.array([0.7, 0.3, 0.45])
    sd = 0.05
    rng = np.random.default_rng(2)
    start = np.full(3, 0.5)
    fits = [
        drive(least_squares(start, WEIGHING, 500), exponential, exponential(truth) + rng.normal(0, sd, TIMES.size))
        for _ in range(200)
    ]
    found = np.array([fit.at for fit in fits])
    said = np.median([uncertainty(fit.jacobians, fit.objective, WEIGHING, [1.0])[0] for fit in fits], axis=0)
    assert said == pytest.approx(found.std(axis=0, ddof=1), rel=0.15)


def test_an_answer_outside_of_the_bounds_ends_on_the_bound():
    fit = drive(least_squares(np.full(3, 0.5), WEIGHING, 500), exponential, exponential(np.array([1.4, 0.3, 0.45])))
    assert fit.at[0] == 1.0
    assert fit.converged


def test_points_that_fail_are_gone_round():
    truth = np.array([0.7, 0.3, 0.45])
    fit = drive(least_squares(np.full(3, 0.5), WEIGHING, 900), exponential, exponential(truth), lambda p: p[1] > 0.5)
    assert fit.at == pytest.approx(truth, abs=0.01)
    assert drive(least_squares(np.full(3, 0.9), WEIGHING, 500), exponential, exponential(truth), lambda p: True) is None


def test_the_budget_holds():
    fit = drive(least_squares(np.full(3, 0.01), WEIGHING, 20), exponential, exponential(np.array([0.9, 0.9, 0.9])))
    assert not fit.converged
    assert fit.trace[-1][0] <= 20


@pytest.mark.parametrize(
    "free", [("E_f", "tau_2f", "tau_2m", "tau_3f", "tau_3m"), ("tau_3f", "tau_3m"), ("E_f", "E_m")]
)
def test_starts_with_exchanged_relaxation_times(free):
    """One of each pair is fast and the other slow, in every way; where a parameter is fixed, its pair stays out."""
    parameters = tuple(p if p.name in free else replace(p, minimum=1.0, maximum=1.0, reference=1.0) for p in TENDON)
    model = Model(parameters)
    specimens, _ = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)
    session = FitSession(None, model, SpecimenEvaluation(model, specimens[0], Uniaxial(), 96))
    size = len(free)
    jacobians = tuple(np.random.default_rng(i).normal(size=(size, 96)) for i in range(3))
    found = list(exchanged(session, Fit(np.full(size, 0.4), np.ones(3), (), jacobians, False)))
    assert len(found) == (4 if size == 5 else 0)
    at = {parameter.name: i for i, parameter in enumerate(model.free)}
    for pair in (("tau_2f", "tau_2m"), ("tau_3f", "tau_3m")) if found else ():
        ends = [tuple(np.round(point[[at[name] for name in pair]], 2).tolist()) for point in found]
        assert sorted(ends) == [(0.05, 0.95)] * 2 + [(0.95, 0.05)] * 2
    assert all(((point >= 0) & (point <= 1)).all() for point in found)


def test_a_virtual_tendon_is_fitted_down_to_its_noise():
    specimens, truth = virtual_cohort(seed=1, per_site=1, rate_hz=20.0)
    evaluation = SpecimenEvaluation(Model(), specimens[2], Uniaxial(), 96)
    made = truth["specimens"][specimens[2].name]["parameters"]
    floor = evaluation(np.array([[made[name] for name in evaluation.model.names]])).values["objective"].sum()

    fit = least_squares(np.full(16, 0.5), weighing_of(evaluation), 600)
    asked = next(fit)
    try:
        while True:
            outcome = evaluation(from_unit(evaluation.model, asked)).values
            forces = tuple(outcome[f"force_{curve.name}"] for curve in specimens[2].curves)
            asked = fit.send(Seen(outcome["objective"], forces))
    except StopIteration as end:
        found = end.value
    assert found.objective.sum() < 1.01 * floor
    sd, _ = uncertainty(found.jacobians, found.objective, weighing_of(evaluation), [1.86] * 3)
    by_name = dict(zip(evaluation.model.names, sd, strict=True))
    assert by_name["nu_m"] == pytest.approx(12**-0.5), "the force says nothing of it"
    assert by_name["E_f"] < 0.05
