"""The model's error: none where the model is right, and truth within reach where it is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.fitting.roughness import Roughness
from sinew.tasks.infer.likelihood.discrepancy import ModelError, QuantityError, lengths_of, model_error
from sinew.tasks.infer.likelihood.scores import places
from tests.tasks.infer.likelihood.specimens import fitted, target


@pytest.mark.thorough
def test_where_the_model_is_right_there_is_next_to_no_error():
    wider = []
    for number in range(2):
        bare, truth = target(number)
        found = model_error(bare, (1,))
        assert found.misfit == pytest.approx(1.0, abs=0.1)
        assert found.size < 0.6
        wider.append(fitted(replace(bare, whitening=found.white), truth)[2] / fitted(bare, truth)[2])
    assert np.mean(wider) < 1.3


@pytest.mark.parametrize(("effect", "screw"), [("", 0.01), pytest.param("friction", 0.0, marks=pytest.mark.thorough)])
def test_where_the_model_is_wrong_posteriors_are_wider(effect, screw):
    without, beside, left = [], [], []
    for number in range(2):
        bare, truth = target(number, effect, screw)
        found = model_error(bare, (1,))
        assert found.misfit > 1.5
        assert found.size > 1.0
        best, away, _ = fitted(replace(bare, whitening=found.white), truth)
        without.append(fitted(bare, truth)[1])
        beside.append(away)
        left.append(best.squares / bare.points)
    assert np.sqrt(np.mean(np.square(without))) > 5.0
    assert np.sqrt(np.mean(np.square(beside))) < 3.5
    assert np.sqrt(left) == pytest.approx(np.ones(2), abs=0.1)


def test_white_errors_are_those_of_the_whole_covariance():
    rng = np.random.default_rng(2)
    rough = Roughness(1.5, 0.8, (6, 4))
    directions, _ = np.linalg.qr(rng.standard_normal((10, 2)))
    spreads = np.array([3.0, 0.5])
    one = QuantityError(rough, directions, 1.0 - 1.0 / np.sqrt(1.0 + spreads**2))
    error = ModelError((one,), (np.arange(10),), 2.0, 3.0, np.zeros(1))
    back = np.linalg.inv(rough.white(np.eye(10)).T)  # from errors without the rough part
    covariance = back @ (np.eye(10) + (directions * spreads**2) @ directions.T) @ back.T
    white = error.white(np.eye(10)).T
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(10), atol=1e-8)


def test_curves_have_as_many_errors_as_groups():
    bare, truth = target(0)
    assert sum(lengths_of(bare.measured)) == bare.errors(places(truth)[np.newaxis]).shape[1]
