"""Coordinates of a specimen's posterior: there and back, and their derivatives."""

import numpy as np
import pytest

from sinew.tasks.infer.likelihood.chart import chart_of, pull_back, to_scores
from sinew.tasks.model import Model
from sinew.tasks.model.parameters import own_parameter

TISSUE = Model().free
OWN = (own_parameter("stiffness", "MPa", 1.0, 5.0), own_parameter("g_1f", "1", 0.0, 2.0))


def scores(count, size):
    return np.clip(1.2 * np.random.default_rng(3).standard_normal((count, size)), -3.5, 3.5)


@pytest.mark.parametrize("parameters", [TISSUE, OWN], ids=["tissue", "own"])
def test_there_and_back(parameters):
    chart = chart_of(parameters)
    here = scores(20, len(parameters))
    for one, at in zip(here, chart.coordinates(here), strict=True):
        back = np.zeros(len(parameters))
        assert to_scores(*chart.arrays, at, back)
        np.testing.assert_allclose(back, one, atol=1e-8)


def test_beyond_the_farthest_score_there_is_nothing():
    chart = chart_of(OWN)
    far = chart.coordinates(np.array([[4.1, 0.0]]))[0]
    assert not to_scores(*chart.arrays, far, np.zeros(2))


@pytest.mark.parametrize("parameters", [TISSUE, OWN], ids=["tissue", "own"])
def test_slopes_are_those_of_differences(parameters):
    chart, size = chart_of(parameters), len(parameters)
    here = scores(1, size)
    at = chart.coordinates(here)[0]
    steps = 1e-6 * np.maximum(1.0, np.abs(at))
    for j, step in enumerate(steps):
        ends = []
        for side in (-1.0, 1.0):
            moved, back = at.copy(), here[0].copy()
            moved[j] += side * step
            to_scores(*chart.arrays, moved, back)
            ends.append(back)
        np.testing.assert_allclose((ends[1] - ends[0]) / (2 * step), chart.slopes(here)[0][:, j], atol=1e-5, rtol=1e-4)


def test_the_volume_is_that_of_the_slopes():
    chart = chart_of(TISSUE)
    first, second = scores(2, len(TISSUE))
    volumes = [pull_back(*chart.arrays, one, np.zeros(len(TISSUE))) for one in (first, second)]
    logs = [-np.linalg.slogdet(chart.slopes(one[np.newaxis])[0])[1] for one in (first, second)]
    assert volumes[0] - volumes[1] == pytest.approx(logs[0] - logs[1], abs=1e-8)
