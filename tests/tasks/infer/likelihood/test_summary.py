"""What chains are summarised to."""

import numpy as np
import pytest

from sinew.tasks.infer.likelihood.summary import Chains, convergence, interval


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


def test_chains_that_do_not_move_have_not_converged():
    """Their R-hat is no number, and their effective sample size says nothing."""
    rng = np.random.default_rng(1)
    moving = rng.standard_normal((4, 50, 2, 1))
    frozen = moving.copy()
    frozen[:, :, 1] = 0.5
    mean, spread = rng.standard_normal((2, 4, 50, 1))
    for specimens, converged in ((moving, True), (frozen, False)):
        found = convergence(Chains(specimens, specimens[..., 0], mean, spread, mean, np.ones((50, 1, 1))))
        assert np.isfinite(found.largest_rhat) == converged
        assert (found.largest_rhat < 1.2) == converged
