"""What chains are summarised to."""

import numpy as np
import pytest

from sinew.tasks.infer.likelihood.summary import interval


def test_an_interval_is_the_shortest_one():
    draws = np.random.default_rng(0).standard_normal(100_000)
    assert interval(draws, -10.0, 10.0) == pytest.approx((-1.96, 1.96), abs=0.06)
    low, high = interval(draws**2, -5.0, 100.0)
    assert (low, high) == pytest.approx((0.0, 3.84), abs=0.06)


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_end_near_a_bound_reaches_it(sign):
    """A parameter that is as good as on a bound is within its interval even if no draw is there."""
    draws = sign * (0.001 + np.random.default_rng(1).exponential(size=50_000))
    bounds = sorted((0.0, sign * 100.0))
    assert 0.0 in interval(draws, *bounds)
    away = sign * (0.5 + np.random.default_rng(1).exponential(size=50_000))
    assert 0.0 not in interval(away, *bounds)
