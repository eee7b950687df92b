"""Bands of curves and their coverage, against known answers."""

import functools

import numpy as np
import pytest
import xarray as xr
from scipy.special import ndtr

from sinew.tasks.data.noise import noise_of
from sinew.tasks.data.sites import by_site
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model
from sinew.tasks.predict import method
from sinew.tasks.predict.method import bands_of, coverage, next_curve, noise_level, one_more, pointwise, simultaneous
from sinew.tasks.predict.settings import Settings
from sinew.tasks.simulate.evaluation import kept_points
from sinew.tasks.simulate.uniaxial import Uniaxial


def test_the_band_of_a_new_curve_is_the_textbook_one_where_asinh_is_a_line():
    """Mean 0 and values far below the bend: t(0.975, 4) = 2.7764 for five curves."""
    curves = np.zeros((5, 2))
    curves[:, 0] = 1000.0
    curves[:, 1] = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    low, high = next_curve(curves, 0.0, 0.95)
    reach = 2.776445 * np.std(curves[:, 1], ddof=1) * np.sqrt(1.2)
    assert (low[1], high[1]) == pytest.approx((-reach, reach), rel=1e-4)
    assert (low[0], high[0]) == pytest.approx((1000.0, 1000.0)), "curves that agree leave nothing but noise"
    low, high = next_curve(curves, 2.0, 0.95)
    assert (low[0], high[0]) == pytest.approx((1000 - 3.919928, 1000 + 3.919928))
    assert high[1] == pytest.approx(np.hypot(reach, 3.919928), rel=1e-4)


@pytest.mark.parametrize("members", [3, 5, 8])
@pytest.mark.parametrize("kind", ["factors", "newtons"])
def test_the_band_of_a_new_curve_holds_as_many_as_it_says(members, kind):
    """Tendons that differ by factors, or by a force; one is left out, and measured with noise."""
    rng = np.random.default_rng(5)
    along = np.abs(np.sin(np.linspace(0.3, 9.0, 40))) * 800.0 + 20.0
    held = []
    for _ in range(500):
        by = rng.normal(0, 0.25, (members + 1, 1))
        curves = along * np.exp(by) if kind == "factors" else along + 150.0 * by
        measured = curves[0] + rng.normal(0, 5.0, 40)
        low, high = next_curve(curves[1:], 5.0, 0.95)
        held.append(np.mean((measured >= low) & (measured <= high)))
    assert 0.925 <= np.mean(held) <= 0.975


def inside_of_new(specimen, others, parameters):
    """The share of a specimen's measured points inside the band that the others give, for each of its curves."""
    rows = np.array([[parameters[other.name]["parameters"][name] for name in Model().names] for other in others])
    shares = []
    for curve in specimen.curves:
        keep = kept_points(curve.protocol, 96)
        simulated = Uniaxial().simulate(Model(), specimen, curve.protocol, rows).force_N[:, keep]
        noise = noise_level(others, curve.name)
        low, high = next_curve(simulated, noise, 0.95)
        shares.append(np.mean((curve.force_N[keep] >= low) & (curve.force_N[keep] <= high)))
    return shares


def test_the_band_of_a_new_tendon_covers_those_left_out(monkeypatch):
    """All 27 virtual tendons with their true parameters: about 95 % of the measured points, each once."""
    monkeypatch.setattr(method, "noise_of", functools.cache(noise_of))  # asked for once with each of the others
    specimens, truth = virtual_cohort(seed=2503, per_site=9, rate_hz=1.0)
    sites = {
        site: [
            inside_of_new(specimen, [other for other in members if other is not specimen], truth["specimens"])
            for specimen in members
        ]
        for site, members in by_site(specimens).items()
    }
    covered = {site: np.mean(shares) for site, shares in sites.items()}
    assert {np.shape(shares) for shares in sites.values()} == {(9, 3)}
    assert 0.92 <= np.mean(list(covered.values())) <= 0.98, covered
    assert all(0.85 <= share <= 1.0 for share in covered.values()), covered


def smooth(rng, count):
    """Curves that scatter by factors, and wander smoothly about their shape."""
    t = np.linspace(0.0, 1.0, 60)
    waves = np.array([np.sin((j + 1) * np.pi * t) / (j + 1) for j in range(5)])
    along = 800.0 * np.abs(np.sin(9.0 * t)) + 20.0
    return along * np.exp(rng.normal(0, 0.2, (count, 1))) + 40.0 * rng.standard_normal((count, 5)) @ waves


def test_whole_curves_lie_inside_the_band_as_often_as_it_says():
    """Over 60 bands of 400 curves each, with 200 new ones for each: a standard deviation of about 0.2 %."""
    rng = np.random.default_rng(2)
    whole, points = [], []
    for _ in range(60):
        low, high = simultaneous(smooth(rng, 400), 0.95)
        curves = smooth(rng, 200)
        inside = (curves >= low) & (curves <= high)
        whole.append(inside.all(axis=1).mean())
        points.append(inside.mean())
    assert 0.935 <= np.mean(whole) <= 0.965
    assert np.mean(points) > 0.98, "a band for whole curves is wider than a pointwise one"


def test_bands_of_many_draws_hold_the_noise_and_whole_curves():
    rng = np.random.default_rng(4)
    drawn, new = smooth(rng, 400), smooth(rng, 500)
    measured = new + rng.normal(0, 30.0, new.shape)
    bands = bands_of({"hdi": drawn[:3], "draws": drawn, "new": drawn}, 30.0, 0.95, from_population=True)
    inside = {name: (measured >= low) & (measured <= high) for name, (low, high) in bands.items()}
    assert inside["draws"].mean() < inside["new"].mean(), "it knows no noise"
    assert 0.93 <= inside["new"].mean() <= 0.97
    assert 0.92 <= inside["whole"].all(axis=1).mean() <= 0.98
    assert inside["new"].all(axis=1).mean() < 0.8
    again = bands_of({"hdi": drawn[:3], "draws": drawn, "new": drawn}, 30.0, 0.95, from_population=True)
    np.testing.assert_array_equal(again["whole"], bands["whole"])
    few = bands_of({"hdi": drawn[:3], "draws": drawn, "new": drawn[:8]}, 30.0, 0.95, from_population=False)
    assert few["whole"] is None and few["new"] is not None
    many = bands_of({"hdi": drawn[:3], "draws": drawn, "new": drawn}, 30.0, 0.95, from_population=False)
    assert many["whole"] is None, "a hundred other specimens are no draws of a population"


@pytest.mark.parametrize(("count", "there"), [(38, False), (39, True), (99, True)])
def test_few_draws_of_a_population_are_no_band_of_95_percent(count, there):
    drawn = smooth(np.random.default_rng(5), count)
    bands = bands_of({"hdi": drawn[:3], "draws": drawn, "new": drawn}, 0.0, 0.95, from_population=True)
    assert (bands["new"] is not None) == there
    assert bands["whole"] is None


@pytest.mark.parametrize("count", [39, 40, 100, 400])
def test_one_more_draw_of_a_skewed_population_lies_in_the_band_as_often_as_it_says(count):
    """Over 400 bands of lognormal draws: the share of one more inside, with a standard deviation of 0.2 % or less."""
    rng = np.random.default_rng(6)
    low, high = one_more(np.exp(rng.standard_normal((count, 400))), 0.95)
    inside = ndtr(np.log(high)) - ndtr(np.log(low))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.006)


def test_a_band_of_two_of_three_simulations_is_none():
    drawn = smooth(np.random.default_rng(7), 40)
    assert (
        bands_of({"hdi": drawn[:2], "draws": drawn, "new": drawn[:0]}, 0.0, 0.95, from_population=False)["hdi"] is None
    )


def test_a_specimen_with_its_own_noise_is_enough():
    (specimen, *_), _ = virtual_cohort(seed=2503, per_site=1, rate_hz=1.0)
    assert noise_level([specimen], specimen.curves[0].name) > 0.0


def test_a_band_of_equal_curves_is_their_curve():
    low, high = simultaneous(np.tile(np.array([0.0, 3.0]), (200, 1)), 0.95)
    np.testing.assert_allclose(low, [0.0, 3.0])
    np.testing.assert_allclose(high, [0.0, 3.0])


def test_pointwise_bounds_leave_out_the_same_on_both_sides():
    low, high = pointwise(np.arange(101.0)[:, np.newaxis] * [1.0, -2.0], 0.95)
    assert (low[0], high[0]) == pytest.approx((2.5, 97.5))
    assert (low[1], high[1]) == pytest.approx((-195.0, -5.0))


def test_each_point_counts_once_and_a_band_that_is_not_given_not_at_all():
    nothing = np.full(4, np.nan)
    bands = {"hdi_low": np.zeros(4), "hdi_high": np.array([1.0, 1.0, 1.0, 0.4]), "draws_low": nothing}
    bands |= {"draws_high": nothing, "new_low": np.array([0, 0, 0, np.nan]), "new_high": np.array([9, 9, 0.1, np.nan])}
    bands |= {"whole_low": bands["hdi_low"], "whole_high": bands["hdi_high"]}
    dataset = xr.Dataset(
        {"measured": ("point", np.full(4, 0.5)), **{name: ("point", values) for name, values in bands.items()}},
        {"protocol": ("point", ["pull", "pull", "hold", "hold"]), "specimen": ("point", ["a", "b", "a", "b"])},
    )
    found = coverage(dataset)
    assert found["hdi"].all == 0.75
    assert found["hdi"].protocols == {"pull": 1.0, "hold": 0.5}
    assert found["hdi"].specimens == {"a": 1.0, "b": 0.5}
    assert found["hdi"].curves == 0.75, "four curves of a point each"
    assert (found["draws"].all, found["draws"].points, found["draws"].curves) == (None, 0, None)
    assert (found["new"].all, found["new"].points) == (pytest.approx(2 / 3), 3)


@pytest.mark.parametrize(
    ("told", "quick", "new"),
    [
        ({}, True, 400), ({}, False, 40), ({"draws": 10}, False, 39), ({"probability": 0.99}, False, 199),
        ({"probability": 0.999}, True, 1999), ({"probability": 0.9998}, True, 9999), ({"new": 7}, True, 7),
    ],
)  # fmt: skip
def test_new_specimens_are_as_many_as_their_band_needs(told, quick, new):
    assert Settings(**told).of_new(quick=quick) == new
