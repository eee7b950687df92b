"""The figures of a posterior."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.infer.abc.figures import density
from tests.tasks.posteriors import posterior_of


def test_a_density_stays_within_the_ends_of_a_uniform_prior():
    rng = np.random.default_rng(1)
    values, weight = rng.uniform(0.0, 1.0, 2000), np.full(2000, 1 / 2000)
    grid = np.linspace(-0.5, 1.5, 2001)
    found = density(values, weight, grid, (0.0, 1.0))
    assert found[(grid < 0) | (grid > 1)].max() == 0.0
    assert np.trapezoid(found, grid) == pytest.approx(1.0, abs=0.01)
    assert found[(grid >= 0) & (grid <= 1)] == pytest.approx(1.0, abs=0.15)
    free = density(values, weight, grid)
    assert free[grid < 0].max() > 0.3
    assert np.trapezoid(free, grid) == pytest.approx(1.0, abs=0.01)


def test_ends_are_those_of_a_uniform_prior():
    marginal = posterior_of(["d/1"], ["E_f"], [200.0]).parameters["E_f"]
    uniform = replace(marginal, prior="uniform", prior_mean=5.0, prior_sd=np.sqrt(12.0) / 6.0)
    assert uniform.within == pytest.approx((4.0, 6.0))
    assert replace(uniform, prior="normal").within == (-np.inf, np.inf)
