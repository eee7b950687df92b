"""Fits with another solver than the embedded simulator follow that solver's forces."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import WIDTH, Fitted, covariance, fit, gentle, spreads, together
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.simulate import Simulated
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.tendon import TendonTemplate
from sinew.tasks.simulate.uniaxial import Uniaxial

SOFTER = 0.95


@dataclass(frozen=True)
class Softer(FEBio):
    """A solver whose bar is a little softer than the embedded one."""

    def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
        done = Uniaxial().simulate(model, specimen, protocol, parameters)
        return Simulated(SOFTER * done.force_N, done.status, done.messages)


@pytest.fixture(scope="module")
def measured():
    model, rng = Model(), np.random.default_rng(5)
    bare = Specimen("one", 10.0, 8.0, 4.0)
    curves = []
    for make in (one_step, cyclic):
        protocol = make(bare.length_mm, 4.0)
        force = Uniaxial().simulate(model, bare, protocol, model.reference[np.newaxis]).force_N[0]
        curves.append(Curve(protocol, force + rng.normal(0.0, 1.0, force.size)))
    return Measured(Specimen("one", 10.0, 8.0, 4.0, tuple(curves)), Noise(1.0, 0.0))


def test_a_fit_ends_where_the_solver_fits(measured):
    embedded = Candidate(Model())
    with_solver = Candidate(Model(), solver=Softer("none", "none", TendonTemplate(""), Path()))
    middle = np.full(embedded.size, 0.5)
    own, softer = fit(embedded, measured, middle), fit(with_solver, measured, middle)
    assert softer.loss == pytest.approx(own.loss, abs=3.0), "both fit to the noise"
    values = [embedded.rows(found.at[np.newaxis])[0][0] for found in (own, softer)]
    names = list(Model().names)
    ratio = values[1][names.index("E_f")] / values[0][names.index("E_f")]
    assert ratio == pytest.approx(1.0 / SOFTER, rel=0.02)


def test_what_a_solver_cannot_run_is_far_away_and_never_not_a_number(measured):
    @dataclass(frozen=True)
    class Broken(FEBio):
        def simulate(self, model, specimen, protocol, parameters, *, stresses=False):
            shape = (len(parameters), protocol.time_s.size)
            return Simulated(np.full(shape, np.nan), np.ones(len(parameters), np.int8), ("it broke",) * len(parameters))

    broken = Candidate(Model(), solver=Broken("none", "none", TendonTemplate(""), Path()))
    found = fit(broken, measured, np.full(15, 0.5))
    assert np.isfinite(found.at).all()
    assert found.loss > 1e6


@pytest.mark.parametrize(("below", "pressed"), [(-2.0, False), (0.5, False), (4.0, True)])
@pytest.mark.parametrize("name", ["E_f", "E_m", "g_2f", "tau_2f"])
def test_a_bound_counts_where_the_data_press_a_parameter_against_it(measured, name, below, pressed):
    wide = Candidate(Model())
    free = fit(wide, measured, gentle(wide))
    number = wide.varied.index(name)
    low, high = (bound[number] for bound in wide.bounds())
    top = low + (high - low) * (free.at[number] - below * free.uncertainty[number])

    own = [replace(each, maximum=top) if each.name == name else each for each in Model().parameters]
    tight = Candidate(replace(Model(), parameters=tuple(own)))
    found = fit(tight, measured, free.at)

    assert found.pressed[number] == pressed
    assert found.at_bound[number] or not pressed
    rise = found.loss - free.loss
    assert found.pull[number] > rise / 2 if pressed else rise < 0.5


def test_a_fit_is_the_same_after_it_was_kept_as_numbers(measured):
    wide = Candidate(Model())
    found = fit(wide, measured, gentle(wide))
    again = Fitted.of(found.numbers())
    assert (again.loss, again.points) == (found.loss, found.points)
    for kept, made in ((again.at, found.at), (again.uncertainty, found.uncertainty), (again.pull, found.pull)):
        np.testing.assert_array_equal(kept, made)


@pytest.mark.parametrize(
    ("number", "value"),
    [(0, -1.0), (0, np.nan), (1, -1.0), (1, 2.5), (2, -0.1), (3, 1.1), (3, np.nan)],
    ids=["loss", "no loss", "points", "part of a point", "below", "above", "nowhere"],
)
def test_numbers_of_no_fit_are_told_from_those_of_one(number, value):
    numbers = Fitted(np.array([0.0, 1.0]), 3.0, 7, np.array([0.1, 5.0]), np.array([0.0, 9.0])).numbers()
    assert Fitted.possible(numbers)
    numbers[number] = value
    assert not Fitted.possible(numbers)


def test_what_slopes_say_of_the_parameters():
    slopes = np.random.default_rng(3).normal(size=(50, 4)) * np.array([1.0, 10.0, 100.0, 0.0])
    expected = np.linalg.inv(slopes.T @ slopes + WIDTH * np.eye(4))
    assert np.allclose(covariance(slopes), expected, rtol=1e-10, atol=1e-14)
    assert spreads(slopes)[3] == pytest.approx(WIDTH**-0.5)


def test_slopes_towards_where_the_model_fails_leave_a_spread():
    """Two columns of such slopes are alike, and their squares leave nothing of the width to rounding."""
    slopes = np.zeros((50, 3))
    slopes[:, :2] = 1e12
    found = spreads(slopes)
    assert np.isfinite(found).all()
    assert found[:2] == pytest.approx((2.0 * WIDTH) ** -0.5)  # each may be anything, their sum is known
    assert found[2] == pytest.approx(WIDTH**-0.5)


def test_residuals_and_slopes_of_a_point_are_found_together_and_once():
    asked = []

    def both(at):
        asked.append(at.tolist())
        return at + 1.0, at * 2.0

    loss, slope = together(both)
    point = np.array([0.25, 0.5])
    assert loss(point).tolist() == [1.25, 1.5] and slope(point).tolist() == [0.5, 1.0]
    assert asked == [[0.25, 0.5]]
    point[0] = 0.75  # least squares may use its array again
    assert slope(point).tolist() == [1.5, 1.0] and loss(point).tolist() == [1.75, 1.5]
    assert asked == [[0.25, 0.5], [0.75, 0.5]]
