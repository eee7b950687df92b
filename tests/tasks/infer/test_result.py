"""Draws from the particles that an inference leaves."""

import numpy as np
import xarray as xr

from sinew.tasks.infer.result import draws


def test_draws_of_equal_weight_have_the_weighted_mean():
    values = np.arange(5.0)[:, np.newaxis]
    weight = np.array([0.0, 0.5, 0.25, 0.25, 0.0])
    particles = xr.Dataset(
        {
            "parameters": (("generation", "particle", "parameter"), values[np.newaxis]),
            "weight": (("generation", "particle"), weight[np.newaxis]),
        }
    )
    drawn = draws(particles, 400, (1,))[:, 0]
    assert np.bincount(drawn.astype(int), minlength=5).tolist() == [0, 200, 100, 100, 0]
