"""The error of simulated curves: where something was measured only."""

import numpy as np

from sinew.tasks.simulate import rmse_of


def test_points_that_were_not_measured_do_not_count():
    simulated = np.array([[1.0, 2.0, 3.0], [0.0, 0.0, np.nan]])
    found = rmse_of(simulated, np.array([0.0, np.nan, 3.0]))
    assert found[0] == np.sqrt(0.5)
    assert np.isnan(found[1])


def test_a_curve_without_measurement_has_no_error():
    assert np.isnan(rmse_of(np.ones((2, 3)), np.full(3, np.nan))).all()
