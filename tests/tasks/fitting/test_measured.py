"""Curves as fits see them: fewer points, the same likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.data.noise import Noise
from sinew.tasks.data.virtual import autoregressive
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import Fitted, errors, fit, residuals, spreads
from sinew.tasks.fitting.measured import Measured, groups, measured_of_each, remark_on_few, thinned
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate.effects import simulate_with


def specimen(rng, effects=(), values=(), ar1=0.5, sd=1.0):
    bare = Specimen("s", 10.0, 4.0, 1.0)
    model = Model()
    parameters = np.array([[p.minimum + 0.4 * (p.maximum - p.minimum) for p in model.parameters]])
    parameters[:, model.names.index("alpha_f")] = 900.0
    curves = []
    for make in STANDARD:
        protocol = make(10.0, 10.0)
        force = simulate_with(model, effects, bare, protocol, parameters, np.array([values]))[0]
        noise = np.empty(force.size)
        noise[0] = rng.standard_normal()
        for t in range(1, force.size):
            noise[t] = ar1 * noise[t - 1] + np.sqrt(1 - ar1**2) * rng.standard_normal()
        curves.append(Curve(protocol, force + sd * noise))
    return Specimen("s", 10.0, 4.0, 1.0, tuple(curves))


@pytest.mark.parametrize("make", STANDARD)
@pytest.mark.parametrize("rate_hz", [2.0, 10.0, 100.0])
def test_groups_are_in_order_and_hold_every_point(make, rate_hz):
    protocol = make(10.0, rate_hz)
    first = groups(protocol)
    assert first[0] == 0
    assert (np.diff(first) > 0).all()
    assert first.size < 10_000
    if make is not STANDARD[2]:
        assert first.size < 0.25 * protocol.time_s.size or rate_hz == 2.0


def test_where_the_displacement_wobbles_points_are_kept():
    protocol = STANDARD[0](10.0, 10.0)
    wobbly = protocol.displacement_mm + 1e-3 * np.sin(np.arange(protocol.time_s.size))
    assert groups(Protocol("wobbly", protocol.time_s, wobbly)).size > 0.99 * protocol.time_s.size


def test_thinned_residuals_are_sums_of_whitened_errors():
    rng = np.random.default_rng(1)
    one = Measured(specimen(rng), Noise(1.0, 0.5))
    candidate = Candidate(Model(), (library()["toe-slack"],))
    at = np.full((1, candidate.size), 0.45)
    for curve in one.curves:
        first = groups(curve.protocol)
        white = errors(candidate, one, at, [curve])[0]
        sums = np.add.reduceat(white, first) / np.sqrt(np.diff(first, append=white.size))
        thin = residuals(candidate, one, at, [curve])[0]
        assert np.abs(thin - sums).max() < 1e-3 * np.abs(sums).max()


@settings(max_examples=20, deadline=None)
@given(st.floats(-0.4, 0.95), st.integers(0, 2**32 - 1))
def test_whitened_noise_is_white(ar1, seed):
    rng = np.random.default_rng(seed)
    one = specimen(rng, ar1=ar1)
    bare = Specimen("s", 10.0, 4.0, 1.0)
    curve = one.curves[1]
    model = Model()
    parameters = np.array([[p.minimum + 0.4 * (p.maximum - p.minimum) for p in model.parameters]])
    parameters[:, model.names.index("alpha_f")] = 900.0
    force = simulate_with(model, (), bare, curve.protocol, parameters, np.zeros((1, 0)))[0]
    noise = Curve(curve.protocol, curve.force_N - force)
    white = thinned(noise, {"force": Noise(1.0, ar1)}).quantities["force"].target
    assert np.mean(white**2) == pytest.approx(1.0, abs=6 * np.sqrt(2 / white.size))
    assert abs(np.mean(white[1:] * white[:-1])) < 6 / np.sqrt(white.size)


def test_a_fit_finds_an_effect_and_says_how_well():
    effect = library()["toe-slack"]
    one = Measured(specimen(np.random.default_rng(2), (effect,), (0.991,)), Noise(1.0, 0.5))
    candidate = Candidate(Model(), (effect,))
    found = fit(candidate, one, np.concatenate([np.full(candidate.size - 1, 0.4), candidate.typical()]))
    assert isinstance(found, Fitted)
    low, high = candidate.bounds()
    value, spread = (low + (high - low) * found.at)[-1], ((high - low) * found.uncertainty)[-1]
    assert abs(value - 0.991) < 4 * spread < 0.004
    freedom = found.points - candidate.size
    assert found.loss == pytest.approx(freedom, abs=5 * np.sqrt(2 * freedom))
    held = fit(candidate, one, np.concatenate([found.at[:-1], [0.2]]), fixed=[found.at.size - 1])
    assert held.at[-1] == 0.2
    assert held.uncertainty[-1] == 0.0
    assert held.loss > found.loss + 10


def test_without_data_everything_is_possible():
    assert spreads(np.zeros((5, 2))) == pytest.approx(np.full(2, np.sqrt(1 / 12)))


def several(rng, gaps=3):
    """A specimen whose width was measured at every third point, and its noise."""
    one, sd = specimen(rng), {"lateral_strain": 2e-3}
    curves = []
    for curve in one.curves:
        seen = -0.3 * curve.protocol.displacement_mm / 10.0
        seen = seen + 2e-3 * rng.standard_normal(seen.size)
        seen[np.arange(seen.size) % gaps > 0] = np.nan
        curves.append(replace(curve, others={"lateral_strain": seen}))
    return replace(one, curves=tuple(curves), noise={"force": 1.0} | sd)


def test_what_is_compared_beside_the_force_is_whitened_by_its_own_noise_where_it_was_measured():
    (one,) = measured_of_each([several(np.random.default_rng(4))])
    assert one.others["lateral_strain"].sd_N == 2e-3
    assert abs(one.others["lateral_strain"].ar1) < 0.1
    alone = Measured(one.specimen, one.noise)
    for name, thin in one.thinned.items():
        curve = next(each for each in one.curves if each.name == name)
        still = {"force": np.zeros((1, thin.rows.size)), "lateral_strain": np.zeros((1, thin.rows.size))}
        forces = alone.thinned[name].residuals(still)
        both = thin.residuals(still)[0]
        np.testing.assert_array_equal(both[: forces.size], forces[0])
        away = curve.others["lateral_strain"][np.isfinite(curve.others["lateral_strain"])] / 2e-3
        white = one.whitened(curve, {key: np.zeros((1, curve.force_N.size)) for key in still})[0]
        assert white.size == curve.force_N.size + away.size
        assert np.mean(white[curve.force_N.size :] ** 2) == pytest.approx(np.mean(away**2), rel=0.1)
        forces_at, widths_at = one.by_row(curve, white)
        np.testing.assert_array_equal(forces_at, white[: curve.force_N.size])
        np.testing.assert_array_equal(np.isfinite(widths_at), np.isfinite(curve.others["lateral_strain"]))
        np.testing.assert_array_equal(widths_at[np.isfinite(widths_at)], white[curve.force_N.size :])
    every = np.concatenate([np.zeros(0), *one.places.values()])
    assert sorted(every) == list(range(sum(thin.size for thin in one.thinned.values())))


def test_residuals_of_a_quantity_that_is_right_are_white():
    (one,) = measured_of_each([several(np.random.default_rng(5))])
    right = {}
    for name, thin in one.thinned.items():
        moved = thin.protocol.displacement_mm[np.newaxis]
        right[name] = thin.residuals({"force": 0.0 * moved, "lateral_strain": -0.03 * moved})[0]
    left = np.concatenate(list(right.values()))[one.places["lateral_strain"]]
    assert np.mean(left**2) == pytest.approx(1.0, abs=6 * np.sqrt(2 / left.size))


def test_noise_of_the_force_that_is_known_is_taken():
    one = several(np.random.default_rng(6))
    (given,), (seen,) = measured_of_each([one], 2.5), measured_of_each([one])
    assert given.noise == Noise(2.5, seen.noise.ar1)


def test_a_quantity_that_was_hardly_measured_in_a_part_of_a_curve_has_hardly_any_residuals_there():
    (one,) = measured_of_each([several(np.random.default_rng(7))])
    curve = one.curves[0]
    for count in (0, 1, 2):
        seen = np.full(curve.force_N.size, np.nan)
        seen[:count] = 2e-3
        cut = one.having((replace(curve, others={"lateral_strain": seen}),))
        (thin,) = cut.thinned.values()
        assert thin.quantities["lateral_strain"].target.size == count
        still = {name: np.zeros((1, thin.rows.size)) for name in cut.quantities}
        assert np.isfinite(thin.residuals(still)).all()


def test_what_stands_in_the_same_group_is_summed_over_the_quantities():
    (one,) = measured_of_each([several(np.random.default_rng(8))])
    for name, thin in one.thinned.items():
        squares = np.random.default_rng(9).uniform(size=thin.size)
        found = thin.by_group(squares)
        assert found.sum() == pytest.approx(squares.sum())
        assert found.size == thin.quantities["force"].target.size
        alone = Measured(one.specimen, one.noise).thinned[name]
        force = squares[: alone.size]
        np.testing.assert_array_equal(alone.by_group(force), force)
        first = thin.quantities["lateral_strain"].groups[0]
        assert found[first] == pytest.approx(force[first] + squares[alone.size])


def test_specimens_share_the_correlation_of_what_was_measured_beside_the_force():
    long, short = several(np.random.default_rng(10), gaps=1), several(np.random.default_rng(11), gaps=40)
    correlated = []
    for curve in long.curves:
        noise = 2e-3 * autoregressive(np.random.default_rng(12), curve.force_N.size, 0.6)
        correlated.append(replace(curve, others={"lateral_strain": -0.03 * curve.protocol.displacement_mm + noise}))
    every = measured_of_each([replace(long, curves=tuple(correlated)), short])
    found = {one.others["lateral_strain"].ar1 for one in every}
    assert len(found) == 1
    assert found.pop() == pytest.approx(0.6, abs=0.05)


def test_noise_of_few_points_is_told_unless_it_is_given():
    (one,) = measured_of_each([several(np.random.default_rng(13), gaps=400)])
    told = remark_on_few([one], ["force"])
    assert told == "the noise of lateral_strain is estimated from 21 points; measured.lateral_strain.noise can give it"
    assert remark_on_few([one], ["lateral_strain"]) == ""
    assert remark_on_few(measured_of_each([several(np.random.default_rng(13))]), []) == ""
