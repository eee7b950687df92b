"""Walks on an emulator, against importance sampling of the same density."""

import numpy as np
import pytest

from sinew.tasks.infer.likelihood.chart import chart_of
from sinew.tasks.infer.likelihood.compiled import FARTHEST
from sinew.tasks.infer.likelihood.scores import inside, places
from sinew.tasks.infer.likelihood.walk import Prior, scales, walk
from tests.tasks.infer.likelihood.problem import CENTRE, SIZE, known

AT_AN_END = np.array([0.0, 0.6, 1.1])  # of two ranges


@pytest.mark.parametrize("centre", [CENTRE, AT_AN_END], ids=["within", "at an end"])
@pytest.mark.parametrize("power", [pytest.param(0.0, marks=pytest.mark.thorough), 7.0])
def test_walks_draw_from_the_posterior(power, centre):
    rng = np.random.default_rng(5)
    chains, model = 400, known(centre)
    prior = Prior(np.full((chains, SIZE), 0.2), np.broadcast_to(np.diag([1.0, 0.5, 2.0]), (chains, SIZE, SIZE)), power)
    wide = 1.7 * rng.standard_normal((400_000, SIZE))
    wide = wide[inside(wide)]
    every = Prior(np.full(wide.shape, 0.2), np.broadcast_to(prior.precision[0], (len(wide), SIZE, SIZE)), power)
    log = -0.5 * (model.squares(places(wide)) + every.losses(wide)) + 0.5 * np.square(wide / 1.7).sum(axis=1)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ wide
    sd = np.sqrt(weight @ (wide - mean) ** 2)
    at = np.clip(mean + sd * rng.standard_normal((chains, SIZE)), -0.99 * FARTHEST, 0.99 * FARTHEST)
    chart, drawn = chart_of(model, np.zeros(SIZE)), []
    for _ in range(30):
        at = walk(rng, chart, prior, at, 3, 0.4)
        drawn.append(at)
    found = np.concatenate(drawn[5:])
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.06 * sd.max())
    np.testing.assert_allclose(found.std(axis=0), sd, rtol=0.06)
    assert inside(found).all()


def test_equal_random_numbers_give_equal_walks():
    prior = Prior(np.zeros((4, SIZE)), np.broadcast_to(np.eye(SIZE), (4, SIZE, SIZE)))
    chart, begin = chart_of(known(), np.zeros(SIZE)), np.zeros((4, SIZE))
    ends = [walk(np.random.default_rng(7), chart, prior, begin, 3, 0.4) for _ in range(2)]
    np.testing.assert_array_equal(*ends)
    assert not np.array_equal(ends[0], begin)


def test_steps_are_shorter_where_a_prior_is_narrow():
    chart = chart_of(known(), np.zeros(SIZE))
    wide, narrow = (
        scales(chart, Prior(np.zeros((1, SIZE)), factor * np.eye(SIZE)[np.newaxis]))[0] for factor in (1.0, 400.0)
    )
    np.testing.assert_allclose(wide @ wide.T, np.eye(SIZE), atol=1e-9)
    covariance = np.linalg.inv(chart.root.T @ chart.root + 399.0 * np.eye(SIZE))
    np.testing.assert_allclose(narrow @ narrow.T, chart.root @ covariance @ chart.root.T, atol=1e-9)
