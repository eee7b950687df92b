"""Intervals by profile likelihood: those of the curvature in a straight valley, and others where it bends or ends."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import Fitted, fit
from sinew.tasks.discover.fit.intervals import profiled
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.simulate.effects import simulate_with

FREE = ("E_f", "E_m", "g_2f")
TIME = np.linspace(0.0, 40.0, 401)
PROTOCOL = Protocol("ramp_hold", TIME, 0.5 * np.minimum(TIME, 1.0))
BAR = Specimen("s", 10.0, 4.0, 1.0)


def few_parameters() -> Model:
    model = Model()
    for parameter in model.parameters:
        if parameter.name not in FREE:
            value = parameter.reference
            model = model.with_parameter(replace(parameter, minimum=value, maximum=value))
    return model


def measured(
    slug: str, values: tuple[float, ...], seed: int = 1, sd: float = 1.0
) -> tuple[Candidate, Measured, Fitted]:
    """A bar with an effect and noise, and the fit of the model with that effect."""
    candidate = Candidate(few_parameters(), (library()[slug],))
    row = candidate.model.reference[np.newaxis]
    force = simulate_with(candidate.model, candidate.effects, BAR, PROTOCOL, row, np.array([values]))[0]
    noisy = force + sd * np.random.default_rng(seed).standard_normal(TIME.size)
    one = Measured(replace(BAR, curves=(Curve(PROTOCOL, noisy),)), Noise(sd, 0.0))
    start = np.concatenate([np.full(len(candidate.varied), 0.5), candidate.typical()])
    return candidate, one, fit(candidate, one, start)


def test_in_a_straight_valley_they_are_those_of_the_curvature():
    candidate, one, fitted = measured("toe-slack", (0.993,))
    found = profiled(candidate, one, fitted)
    half = 1.645 * fitted.uncertainty[-1]
    assert found.ends[0] == pytest.approx([fitted.at[-1] - half, fitted.at[-1] + half], abs=0.1 * half)
    assert found.fitted.loss <= fitted.loss


def test_ends_are_where_the_loss_has_risen_by_as_much_as_chance_does():
    candidate, one, fitted = measured("relaxation-mode", (0.6, 60.0))
    found = profiled(candidate, one, fitted)
    first = len(candidate.varied)
    for number, ends in enumerate(found.ends, first):
        for end in ends:
            start = found.fitted.at.copy()
            start[number] = end
            rise = fit(candidate, one, start, fixed=[number]).loss - found.fitted.loss
            if 1e-5 < end < 1.0 - 1e-5:
                assert rise == pytest.approx(2.706, abs=0.4)
            else:
                assert rise < 2.706 + 0.3, "the range ends before the interval does"


def test_a_fit_that_was_not_the_best_is_replaced():
    candidate, one, fitted = measured("toe-slack", (0.993,))
    aside = fitted.at.copy()
    aside[-1] -= 2.5 * fitted.uncertainty[-1]
    stuck = fit(candidate, one, aside, fixed=[aside.size - 1])
    astray = replace(stuck, uncertainty=fitted.uncertainty)
    found = profiled(candidate, one, astray)
    assert found.fitted.loss == pytest.approx(fitted.loss, abs=0.05)
    assert found.ends[0, 0] < fitted.at[-1] < found.ends[0, 1]


@pytest.mark.thorough
def test_they_hold_the_truth_as_often_as_they_say():
    """A strength and a time that make up for each other: 40 parameters, of which 36 are expected inside."""
    truth = (0.6, 60.0)
    inside = 0
    for seed in range(20):
        candidate, one, fitted = measured("relaxation-mode", truth, seed)
        found = profiled(candidate, one, fitted)
        low, high = (bound[-2:] for bound in candidate.bounds())
        for k, value in enumerate(truth):
            ends = low[k] + (high[k] - low[k]) * found.ends[k]
            inside += ends[0] <= value <= ends[1]
    assert 31 <= inside <= 40  # beyond two and a half standard deviations of 40 draws with 0.9
