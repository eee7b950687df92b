"""Priors as pyABC takes them: draws and densities agree."""

import numpy as np
import pyabc
import pytest
from scipy import stats

from sinew.tasks.infer.abc.pyabc_priors import Alike, Normals


def test_a_prior_draws_what_its_density_says():
    truncated = Normals(
        ("a", "b"), np.array([0.2, 5.0]), np.array([1.0, 2.0]), np.array([0.0, 4.0]), np.array([np.inf, 6.0])
    )
    expected = [stats.truncnorm(-0.2, np.inf, 0.2, 1.0), stats.truncnorm(-0.5, 0.5, 5.0, 2.0)]
    share = np.random.default_rng(1).random((2000, 2))
    drawn = truncated.quantiles(share)
    for column, law in zip(drawn.T, expected, strict=True):
        assert stats.kstest(column, law.cdf).pvalue > 0.01
    point = pyabc.Parameter(a=0.7, b=4.5)
    assert truncated.pdf(point) == pytest.approx(expected[0].pdf(0.7) * expected[1].pdf(4.5))
    assert truncated.pdf(pyabc.Parameter(a=-0.1, b=4.5)) == 0.0


def test_models_alike_are_what_pyabc_takes_for_them():
    own, pyabcs = Alike(3), pyabc.RV("randint", 0, 3)
    for model in (-1, 0, 1, 2, 3):
        assert own.pmf(model) == pytest.approx(pyabcs.pmf(model))
        assert own.cdf(model + 0.5) == pytest.approx(pyabcs.cdf(model + 0.5))
    state = np.random.get_state()
    np.random.seed(5)
    drawn = [own.copy().rvs() for _ in range(600)]
    np.random.set_state(state)
    assert stats.chisquare(np.bincount(drawn, minlength=3)).pvalue > 0.01
