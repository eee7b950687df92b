"""Pairs of columns of a Sobol sequence fill their squares, also with few points."""

import numpy as np
import pytest
from scipy.stats import qmc

from sinew.tasks.simulate.pairing import pairs_of


@pytest.mark.parametrize("count", [2, 3, 8, 16])
def test_every_column_has_one_partner(count):
    assert sorted(column for pair in pairs_of(count) for column in pair) == list(range(2 * count))
    assert pairs_of(count) == pairs_of(count)


def scatter(pairs, count, points):
    """Largest standard deviation, over scrambles, of the mean square difference of two partners (its mean is 1)."""
    first, second = np.array(pairs).T
    found = []
    for seed in range(60):
        rows = qmc.Sobol(2 * count, scramble=True, seed=seed).random(points)
        found.append(6.0 * np.square(rows[:, first] - rows[:, second]).mean(axis=0))
    return np.std(found, axis=0).max()


@pytest.mark.parametrize(("count", "points", "most"), [(5, 16, 0.2), (16, 32, 0.35), (16, 128, 0.07), (16, 256, 0.05)])
def test_partners_scatter_less_than_those_in_order(count, points, most):
    in_order = [(j, j + count) for j in range(count)]
    chosen = scatter(pairs_of(count), count, points)
    assert chosen < most
    if points <= 64:
        assert scatter(in_order, count, points) > 0.6, "the first digits of two columns are the same"
