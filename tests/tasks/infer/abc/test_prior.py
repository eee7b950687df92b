"""Priors: their draws have their density, within their ends, whatever they are made from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import kstest, uniform

from sinew.tasks.infer.abc.prior import Prior, calibrated, of_others, of_ranges
from sinew.tasks.model.parameters import TENDON

FREE = TENDON[:3]
LOW, HIGH = (np.array([getattr(one, end) for one in FREE]) for end in ("minimum", "maximum"))
MIDDLE, WIDTH = (LOW + HIGH) / 2, HIGH - LOW


def values(*places):
    """Calibrated values at the same places of all ranges."""
    return np.array([LOW + WIDTH * place for place in places])


@given(st.floats(0.05, 3.0), st.floats(0.0, 1.0), st.booleans())
def test_the_density_is_one_in_all(sd, mean, flat):
    prior = Prior(("a",), np.array([mean]), np.array([np.inf if flat else sd]), np.array([0.0]), np.array([1.0]))
    area, _ = quad(lambda x: prior.density(np.array([x])), 0.0, 1.0)
    assert area == pytest.approx(1.0, rel=1e-6)
    assert prior.density(np.array([1.1])) == 0.0


def test_a_prior_of_ranges_is_uniform_over_them():
    prior = of_ranges(FREE)
    drawn = prior.quantiles(np.random.default_rng(1).random((4000, 3)))
    for j in range(3):
        assert kstest(drawn[:, j], uniform(LOW[j], WIDTH[j]).cdf).pvalue > 0.01
    np.testing.assert_allclose(prior.spread, WIDTH / np.sqrt(12))
    assert prior.density(MIDDLE) == pytest.approx(1 / np.prod(WIDTH))


def test_a_prior_of_others_stays_within_the_ranges_where_the_papers_does_not():
    near_the_end = values(0.6, 0.8, 0.98)
    shares = np.random.default_rng(1).random((4000, 3))
    drawn = of_others(FREE, near_the_end, 2.0).quantiles(shares)
    assert (drawn >= LOW).all()
    assert (drawn <= HIGH).all()
    assert drawn.mean(axis=0) == pytest.approx(LOW + 0.64 * WIDTH, rel=0.1)
    assert (calibrated(FREE, near_the_end, 2.0).quantiles(shares) > HIGH).any()


@pytest.mark.parametrize("places", [(1.0, 1.0, 0.999), (0.0, 0.0, 0.5), (0.4, 0.4, 0.4), (0.3,)])
def test_a_parameter_that_calibrations_pin_or_that_has_no_spread_is_uniform(places):
    prior = of_others(FREE, values(*places), 2.0)
    assert prior.uniform.all()
    np.testing.assert_allclose(prior.mean, MIDDLE)


def test_one_parameter_may_be_uniform_beside_normal_ones():
    found = values(0.4, 0.5, 0.7)
    found[:, 1] = HIGH[1]
    prior = of_others(FREE, found, 2.0)
    assert prior.uniform.tolist() == [False, True, False]
    drawn = prior.quantiles(np.random.default_rng(2).random((4000, 3)))
    assert kstest(drawn[:, 1], uniform(LOW[1], WIDTH[1]).cdf).pvalue > 0.01
    assert np.isfinite(prior.density(MIDDLE))
