"""Moves of a population with its specimens leave what they should leave."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import kstest

from sinew.tasks.infer.likelihood.chart import Chart, chart_of
from sinew.tasks.infer.likelihood.population import from_prior
from sinew.tasks.infer.likelihood.together import chances, moved_together
from tests.tasks.infer.likelihood.problem import SIZE, known

SPECIMENS, CHAINS = 4, 4000
CHART = chart_of(known(), np.zeros(SIZE))


@dataclass(frozen=True, eq=False)
class Seen:
    """What moves need to know of an explored specimen."""

    chart: Chart
    begin: np.ndarray


class Nothing:
    """A specimen without curves."""

    def squares(self, at):
        return np.zeros(len(at))


EXPLORED = [Seen(CHART, 0.5 * np.random.default_rng(1).standard_normal((50, SIZE)))] * SPECIMENS


def test_without_curves_the_prior_stays():
    """Geweke's test (2004) of the moves alone: the joint prior of population and specimens must stay as it is."""
    rng = np.random.default_rng(2)
    population = from_prior(rng, CHAINS, SIZE, SPECIMENS, heavy=False)
    root = np.linalg.cholesky(population.covariance())
    scores = population.mean + np.einsum("cij,ncj->nci", root, rng.standard_normal((SPECIMENS, CHAINS, SIZE)))
    within = (np.abs(scores) < 3.0).all(axis=(0, 2))
    scores = scores[:, within]
    population = replace(population, **{
        name: getattr(population, name)[within] for name in ("mean", "precision", "scales")
    }, weights=np.ones((SPECIMENS, within.sum())))  # fmt: skip
    begun, first = population, scores.copy()
    squares = np.zeros(scores.shape[:2])
    for number in [0, 1, 2] * 4:
        population = moved_together(rng, [Nothing()] * SPECIMENS, EXPLORED, scores, squares, population, number)
    assert (scores != first).any(axis=(0, 2)).mean() > 0.5
    for j in range(SIZE):
        assert kstest(population.mean[:, j], begun.mean[:, j]).pvalue > 0.001
        assert kstest(np.log(population.scales[:, j]), np.log(begun.scales[:, j])).pvalue > 0.001
        assert kstest(scores[0, :, j], first[0, :, j]).pvalue > 0.001
        assert kstest(scores[:, :, j].std(axis=0), first[:, :, j].std(axis=0)).pvalue > 0.001


def test_parameters_that_tell_specimens_apart_are_left_to_them():
    rng = np.random.default_rng(3)
    specimens = [
        Seen(CHART, middle + [0.05, 0.3, 1.0] * rng.standard_normal((200, SIZE)))
        for middle in 0.5 * rng.standard_normal((6, SIZE))
    ]
    found = chances(specimens)
    assert found[0] == 0.0
    assert found.sum() == pytest.approx(1.0)
    assert found[2] > found[1] > 0.0
    assert not chances([Seen(CHART, middle + 1e-3 * one.begin) for middle, one in zip(
        rng.standard_normal((6, SIZE)), specimens, strict=True
    )]).any()  # fmt: skip
