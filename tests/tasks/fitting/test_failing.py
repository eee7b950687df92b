"""The region in which a model fails, learned from its runs."""

import numpy as np
import pytest

from sinew.tasks.fitting.failing import FEWEST, failing
from sinew.tasks.simulate.growing import TURN
from sinew.tasks.simulate.plain_design import shares

SHARE = shares(2, 96, 2, TURN)
FRESH = np.random.default_rng(3).random((1000, 2))


@pytest.mark.parametrize(
    "fails", [lambda at: at.sum(axis=1) > 1.5, lambda at: np.hypot(*(at - 0.3).T) < 0.2], ids=["corner", "inside"]
)
def test_a_region_is_learned(fails):
    found = failing(SHARE, fails(SHARE))
    expected = found.probability(FRESH) > 0.5
    assert np.mean(expected == fails(FRESH)) > 0.95
    assert found.caught > 0.6
    assert found.mistaken < 0.05


def test_a_few_failures_are_the_same_everywhere():
    failed = np.arange(len(SHARE)) < FEWEST - 1
    found = failing(SHARE, failed)
    np.testing.assert_array_equal(found.probability(FRESH), failed.mean())
    assert np.isnan(found.caught)
    assert failing(SHARE, np.zeros(len(SHARE), dtype=bool)).probability(FRESH[:1]) == 0.0
