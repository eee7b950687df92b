"""What is said of a fit: its noise, what the curves determine, and what a calibration costs at most."""

from types import SimpleNamespace

import numpy as np
import pytest

from sinew.tasks.calibrate.method import above_noise, confounded, explained, most_evaluations, noise_floor
from sinew.tasks.calibrate.settings import Settings
from tests.tasks.calibrations import fit_of


@pytest.mark.parametrize(
    ("sd", "total", "floor"),
    [
        ([1.0, 2.0], 3.5, 3.0),
        ([1.0, 2.0], 2.5, 3.0),
        ([1.0, 2.0], 2.3, None),  # the model follows what was taken for noise
        ([1.0, float("nan")], 3.5, None),
        ([1.0, 2.0], float("nan"), None),
    ],
)
def test_the_noise_is_that_of_all_curves_unless_the_model_follows_it(sd, total, floor):
    assert noise_floor([SimpleNamespace(sd_N=each) for each in sd], total) == floor


@pytest.mark.parametrize(("total", "floor", "above"), [(3.0, 2.0, 0.5), (3.0, None, None), (None, 2.0, None)])
def test_above_the_noise_is_a_part_of_the_noise(total, floor, above):
    assert above_noise(total, floor) == above


def test_confounded_are_pairs_of_determined_parameters_with_errors_in_common():
    correlation = np.array([[1.0, 0.5, -0.96, 0.99], [0.5, 1.0, 0.94, 0.99], [-0.96, 0.94, 1.0, 0.99], [0.99] * 4])
    (pair,) = confounded(["a", "b", "c", "wide"], np.array([0.1, 0.2, 0.24, 0.26]), correlation)
    assert (pair.parameters, pair.correlation) == (["c", "a"], -0.96)


@pytest.mark.parametrize(
    ("methods", "most"),
    [
        (["bayesian"], 20 + 4),
        (["hybrid"], 100 + 4),
        (["bayesian", "hybrid"], 100 + 4),
        (["least_squares"], 100 + 4),
        (["bayesian", "hybrid", "least_squares"], 200 + 4),
    ],
)
def test_the_most_evaluations_are_those_of_all_methods_and_of_the_derivatives(methods, most):
    settings = Settings.model_validate({"methods": methods, "evaluations": 100, "bayesian": {"evaluations": 20}})
    assert most_evaluations(settings, 3) == most


def test_r2_is_the_share_of_the_variance_that_is_explained():
    force = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    model = force + np.array([0.1, -0.1, 0.1, -0.1, 0.0])
    rmse = float(np.sqrt(np.mean((force - model) ** 2)))
    total, left = np.sum((force - force.mean()) ** 2), np.sum((force - model) ** 2)
    assert explained(force, rmse) == pytest.approx(1 - left / total)
    assert explained(force, float(force.std())) == pytest.approx(0.0)
    assert explained(np.full(5, 2.0), 0.1) is None


def test_an_error_in_percent_of_the_peak():
    fit = fit_of({"a": 1.0}, rmse_N={"relax": 2.0, "still": 0.1}, peak_N={"relax": 80.0, "still": 0.0})
    assert fit.percent_of_peak("relax") == pytest.approx(2.5)
    assert np.isnan(fit.percent_of_peak("still"))
