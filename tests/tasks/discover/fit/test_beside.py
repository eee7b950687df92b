"""Fits beside a discrepancy: a smooth error does not bend the parameters, and a true effect is worth its evidence."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover.fit.beside import Beside, far_or_white, first_sizes, fit_beside, promise_beside
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import FAR, Fitted, extended, fit, gentle
from sinew.tasks.fitting.discrepancies import discrepancies_of
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Model, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step

NOISE = Noise(1.0, 0.0)
SIZE = Specimen("one", 10.0, 8.0, 4.0)
WRONG_N = 8.0  # of a smooth error that no effect describes


def measured_with(slack, wrong):
    """A specimen with slack fibres, and measured forces that the model cannot have."""
    model, rng = Model(), np.random.default_rng(4)
    effect = library()["toe-slack"]
    candidate = Candidate(model, (effect,))
    at = np.concatenate([gentle(Candidate(model)), [candidate.unit("slack_stretch", slack)]])
    curves = []
    for make in (one_step, cyclic):
        protocol = make(SIZE.length_mm, 4.0)
        force = candidate.forces(SIZE, protocol, at[np.newaxis])[0]
        strain = protocol.displacement_mm / SIZE.length_mm
        noise = NOISE.sd_N * autoregressive(rng, force.size, NOISE.ar1)
        curves.append(Curve(protocol, force + wrong * np.sin(250.0 * strain) + noise))
    return Measured(Specimen(SIZE.name, 10.0, 8.0, 4.0, tuple(curves)), NOISE), at


def bare_beside(measured):
    bare = Candidate(Model())
    alone = fit(bare, measured, gentle(bare))
    return bare, fit_beside(bare, measured, alone.at, first_sizes(bare, measured, alone.at))


def worth(measured, slug):
    """Twice the log evidence that an effect adds, and what was promised."""
    bare, before = bare_beside(measured)
    effect = library()[slug]
    known = extended(bare, before.fitted.at, effect, measured).at
    promised, start, sizes = promise_beside(bare, before, effect, measured, known)
    found = fit_beside(bare.having(effect), measured, start, sizes)
    return before.evidence - found.evidence, before.evidence - promised, found


def test_where_the_model_fails_is_far_although_a_discrepancy_is_smooth():
    """A discrepancy as large as the error makes most of a constant residual its own."""
    measured, _ = measured_with(0.985, WRONG_N)
    _, before = bare_beside(measured)
    white = discrepancies_of(measured).whitening(before.sizes)
    failed = np.full(sum(each.size for each in measured.thinned.values()), FAR)
    assert np.sum(white(failed) ** 2) < 0.1 * np.sum(failed**2)
    assert (far_or_white(white, failed) == FAR).all()
    seen = np.linspace(-1.0, 1.0, failed.size)
    assert (far_or_white(white, seen) == white(seen)).all()


def test_a_true_effect_is_worth_more_than_others_beside_an_error():
    measured, at = measured_with(0.985, WRONG_N)
    true, promised, found = worth(measured, "toe-slack")
    other, _, _ = worth(measured, "time-lag")
    assert true > 100.0
    assert promised > 0.5 * true
    assert other < 0.3 * true
    assert found.fitted.at[-1] == pytest.approx(at[-1], abs=0.1)


def test_an_error_alone_makes_no_effect_worth_naming():
    measured, _ = measured_with(1.0, WRONG_N)
    for slug in ("toe-slack", "time-lag"):
        assert worth(measured, slug)[0] < 50.0


def test_without_an_error_the_discrepancy_is_small():
    measured, _ = measured_with(1.0, 0.0)
    _, found = bare_beside(measured)
    assert np.exp(found.sizes).max() < 0.3
    assert found.fitted.loss == pytest.approx(found.fitted.points, rel=0.2)


def test_a_fit_is_the_same_after_it_was_kept_as_numbers():
    made = Beside(-3.5, np.array([0.1, 0.2, 0.3]), fit(*bare_and_measured()))
    again = Beside.of(made.numbers(), 3)
    assert again.evidence == made.evidence
    np.testing.assert_array_equal(again.sizes, made.sizes)
    np.testing.assert_array_equal(again.fitted.numbers(), made.fitted.numbers())


def bare_and_measured():
    bare = Candidate(Model())
    return bare, measured_with(1.0, 0.0)[0], gentle(bare)


@pytest.mark.parametrize(("number", "value"), [(0, np.nan), (1, np.inf), (2, 9e14), (3, np.nan), (4, -1.0), (6, 1.5)])
def test_numbers_of_no_fit_are_told_from_those_of_one(number, value):
    """In this order: evidence, three sizes, loss, points, and where the fit ended."""
    fitted = Fitted(np.array([0.2, 0.8]), 3.0, 7, np.array([0.1, 0.1]), np.zeros(2))
    numbers = Beside(-3.5, np.array([0.1, 0.2, 0.3]), fitted).numbers()
    assert Beside.possible(numbers, 3)
    numbers[number] = value
    assert not Beside.possible(numbers, 3)
