"""Contrasts of populations: how often a difference of zero is called one, and power, against simulation."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import ttest_ind, ttest_rel

from sinew.tasks.compare.contrasts import (
    MOST_NEEDED,
    POWER,
    contrasts_of,
    detectable,
    interval,
    means_given,
    needed,
    power,
)
from sinew.tasks.infer.likelihood.population import drawn, from_prior
from sinew.tasks.infer.likelihood.scores import places

COUNT, COHORTS = 9, 1500


def posterior_means(values, rng):
    """Draws ``[s, c]`` of the population means of cohorts of known specimens, scores ``[n, c, 1]``, each by a chain."""
    population = from_prior(rng, values.shape[1], 1, COUNT, heavy=False)
    means = []
    for sweep in range(320):
        population = drawn(rng, values, population, heavy=False)
        if sweep >= 20:
            means.append(population.mean[:, 0])
    return np.array(means)


def test_differences_of_zero_are_called_different_as_often_as_is_said():
    rng = np.random.default_rng(1)
    values = 0.2 + 0.4 * rng.standard_normal((2, COUNT, COHORTS, 1))
    first, second = (posterior_means(each, rng) for each in values)
    found = [interval(difference, 0.95) for difference in (second - first).T]
    wrong = np.mean([not one.low <= 0.0 <= one.high for one in found])
    assert 0.03 <= wrong <= 0.07


def site(values, rng):
    """What an inference stores of specimens that it knows exactly, ``[n]``."""
    scores = np.broadcast_to(values[:, np.newaxis, np.newaxis], (values.size, 100, 1))
    chains = posterior_means(scores, rng).T
    draws = chains.shape
    return xr.Dataset(
        {
            "mean": (("chain", "draw", "parameter"), places(chains)[..., np.newaxis]),
            "spread": (("chain", "draw", "parameter"), np.full((*draws, 1), places(values).std(ddof=1))),
            "specimens": (
                ("chain", "draw", "specimen", "parameter"),
                np.broadcast_to(places(values)[:, np.newaxis], (*draws, values.size, 1)),
            ),
        },
        {"parameter": ["E_f"]},
    )


def test_specimens_of_the_same_donors_are_paired():
    rng = np.random.default_rng(2)
    donors = 0.5 * rng.standard_normal(COUNT)
    first = donors + 0.05 * rng.standard_normal(COUNT)
    second = donors + 0.15 + 0.05 * rng.standard_normal(COUNT)
    draws = {"a": site(first, rng), "b": site(second, rng)}
    names = [str(number) for number in range(COUNT)]

    def contrast(of_first, of_second):
        found = contrasts_of(draws, {"a": of_first, "b": of_second}, ["E_f"], 0.95, np.random.default_rng(3))
        assert len(found) == 1
        return found[0]

    paired = contrast(names, names)
    assert paired.paired
    assert paired.different
    test = ttest_rel(places(second), places(first)).confidence_interval(0.95)
    assert (paired.difference.low, paired.difference.high) == pytest.approx((test.low, test.high), abs=0.004)
    apart = contrast(names, [None] * COUNT)
    assert not apart.paired
    assert not apart.different
    assert apart.difference.high - apart.difference.low > 3 * (paired.difference.high - paired.difference.low)
    assert paired.needed < apart.needed
    for others in (["0", *names[:-1]], [*names[:-1], "another"]):  # twice the same; one without a partner
        assert not contrast(names, others).paired
        assert not contrast(others, names).paired


def test_means_of_known_values_have_students_interval():
    rng = np.random.default_rng(4)
    values = np.array([1.0, 2.0, 4.0, 3.5])
    draws = means_given(rng, np.broadcast_to(values[:, np.newaxis], (200_000, 4, 1)))[:, 0]
    low, high = np.quantile(draws, [0.025, 0.975])
    half = 3.1824 * values.std(ddof=1) / 2
    assert (low, high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.03)


@pytest.mark.parametrize("paired", [False, True])
def test_power_is_how_often_a_test_finds_a_difference(paired):
    rng = np.random.default_rng(5)
    first, second = rng.standard_normal((2, 20_000, 7))
    test = ttest_rel if paired else ttest_ind
    found = np.mean(test(second + 1.2, first, axis=1).pvalue < 0.05)
    assert power(1.2, 1.0, [7, 7], 0.05, paired=paired) == pytest.approx(found, abs=0.012)


@pytest.mark.parametrize("paired", [False, True])
def test_what_is_needed_and_detectable_has_the_power_that_is_said(paired):
    count = needed(0.9, 1.0, 0.05, paired=paired)
    assert power(0.9, 1.0, [count, count], 0.05, paired=paired) >= POWER
    assert power(0.9, 1.0, [count - 1, count - 1], 0.05, paired=paired) < POWER
    least = detectable(2.0, [6, 6], 0.05, paired=paired)
    assert power(least, 2.0, [6, 6], 0.05, paired=paired) == pytest.approx(POWER, abs=1e-6)
    assert needed(1e-3, 1.0, 0.05, paired=paired) is None
    assert needed(50.0, 1.0, 0.05, paired=paired) <= 3
    assert detectable(1.0, [1, 1], 0.05, paired=paired) is None
    assert detectable(1.0, [2, 2], 0.05, paired=paired) > detectable(1.0, [3, 3], 0.05, paired=paired)
    assert MOST_NEEDED == 1000, "the page says so"


def test_the_direction_of_a_difference_is_the_likelier_sign():
    found = interval(np.array([-1.0, 2.0, 3.0, 4.0]), 0.5)
    assert found.direction == 0.75
    assert interval(-np.array([-1.0, 2.0, 3.0, 4.0]), 0.5).direction == 0.75
    ratio = interval(np.log([0.5, 2.0, 2.0]), 0.9).exponential()
    assert ratio.mean == pytest.approx(2.0 ** (1 / 3))
