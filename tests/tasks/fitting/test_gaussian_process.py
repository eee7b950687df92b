"""Gaussian processes are those of scikit-optimize, faster."""

import numpy as np
import pytest

from sinew.tasks.fitting.gaussian_process import fitted
from tests.tasks.fitting.test_bayesian import curves


def test_the_process_is_that_of_scikit_optimize():
    rng = np.random.default_rng(0)
    points, at = rng.random((30, 4)), rng.random((5, 4))
    values = np.array([curves(point)[:, 20] for point in points])
    process, theta = fitted(points, values, None)
    assert theta.shape == (6,)
    assert process.mean(points) == pytest.approx(values, abs=0.05 * values.std())
    assert process.mean(at) == pytest.approx(np.array([curves(point)[:, 20] for point in at]), abs=0.2)
    alone, _ = fitted(points, values[:, :1], theta, refit=False)
    mean, sd = alone.regressor.predict(at, return_std=True)
    told = alone.mean_and_sd(at)
    assert told[0] == pytest.approx(alone.mean(at))
    assert told[0] == pytest.approx(alone.centre + alone.scale * mean)
    assert told[1] == pytest.approx(alone.scale * sd, rel=1e-3)
