"""Noise of known level and correlation is found again, on top of signals that move, hold and cycle."""

from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.noise import (
    MOST_SPLINES,
    Noise,
    _pieces,
    noise_of,
    noise_of_all,
    noise_of_each,
    refuse_none,
    remark_on_others,
)
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Curve, Protocol, Specimen


def noisy(moved: np.ndarray, signal: np.ndarray, sd: float, ar1: float, seed: int) -> Curve:
    rng = np.random.default_rng(seed)
    noise = np.empty(signal.size)
    noise[0] = rng.normal(0, sd)
    for i in range(1, signal.size):
        noise[i] = ar1 * noise[i - 1] + rng.normal(0, sd * np.sqrt(1 - ar1**2))
    time_s = np.arange(signal.size) / 100
    return Curve(Protocol("pull", time_s, moved), signal + noise)


@pytest.mark.parametrize("ar1", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("shape", ["ramp and hold", "cycles"])
def test_known_noise_is_found_again(shape, ar1):
    t = np.arange(6_000 if shape == "ramp and hold" else 20_000) / 100
    moved = np.minimum(t / 7, 1) if shape == "ramp and hold" else 0.5 * (1 - np.cos(t / 3))
    signal = 300 * moved**1.5 * np.exp(-np.maximum(t - 7, 0) / 80)
    found = [noise_of(noisy(moved, signal, 1.5, ar1, seed)) for seed in range(4)]
    assert np.mean([noise.sd_N for noise in found]) == pytest.approx(1.5, rel=0.05)
    assert np.mean([noise.ar1 for noise in found]) == pytest.approx(ar1, abs=0.06)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_a_slow_rate_does_not_take_ramps_for_noise(rate_hz):
    """All curves of a specimen together: those that hold know, those with few points to each ramp say little."""
    specimens, truth = virtual_cohort(seed=5, per_site=2, rate_hz=rate_hz)
    found = [noise_of_all(specimen.curves) for specimen in specimens]
    ratios = [n.sd_N / truth["specimens"][s.name]["noise_sd_N"] for n, s in zip(found, specimens, strict=True)]
    assert np.all(np.abs(np.array(ratios) - 1) < 0.15)
    assert np.mean([noise.ar1 for noise in found]) == pytest.approx(0.3, abs=0.1)


def test_cycles_of_few_points_take_the_noise_of_the_holds_beside_them():
    specimens, truth = virtual_cohort(seed=5, per_site=1, rate_hz=2.0)
    for specimen in specimens:
        for curve in specimen.curves:
            made = truth["specimens"][specimen.name]["noise_sd_N"]
            assert noise_of(curve, specimen.curves).sd_N == pytest.approx(made, rel=0.2), curve.name
    cycles = next(curve for curve in specimen.curves if curve.name == "cyclic")
    assert noise_of(cycles).sd_N > 10.0 * made, "alone, their toe is taken for noise"


def test_noise_that_grows_with_the_force_is_told_apart():
    t = np.arange(4000) / 10
    moved = np.interp(t, [0, 5, 200, 210], [0, 1, 1, 3])
    signal = 100 * moved * np.exp(-t / 500)
    rng = np.random.default_rng(3)
    for additive, proportional in ((0.8, 0.0), (0.2, 0.01)):
        noise = np.hypot(additive, proportional * signal) * rng.standard_normal(t.size)
        found = noise_of_all([Curve(Protocol("pull", t, moved), signal + noise)])
        assert found.proportional == pytest.approx(proportional, abs=0.002)
        assert found.sd_at(np.array([200.0]))[0] == pytest.approx(np.hypot(additive, proportional * 200), rel=0.1)


@pytest.mark.parametrize("proportional", [0.0, 0.01])
def test_specimens_of_one_machine_have_levels_and_growth_of_their_own(proportional):
    t = np.arange(3000) / 10
    moved = np.interp(t, [0, 5, 150, 160], [0, 1, 1, 3])
    rng = np.random.default_rng(4)
    groups = []
    for level in (1.0, 2.0):
        signal = 100 * level * moved * np.exp(-t / 500)
        noise = level * np.hypot(0.2, proportional * signal / level) * rng.standard_normal(t.size)
        groups.append([Curve(Protocol("pull", t, moved), signal + noise)])
    found = noise_of_each(groups)
    assert [noise.ar1 for noise in found] == pytest.approx([0.0, 0.0], abs=0.06)
    for noise, level in zip(found, (1.0, 2.0), strict=True):
        forces = level * np.array([80.0, 250.0])
        assert noise.sd_at(forces) == pytest.approx(np.hypot(0.2 * level, proportional * forces), rel=0.1)
        assert (noise.proportional > 0.0) == (proportional > 0.0)


def test_a_virtual_specimen_has_the_noise_that_was_put_on():
    specimens, truth = virtual_cohort(seed=5, per_site=1, rate_hz=15.0)
    for specimen in specimens:
        made = truth["specimens"][specimen.name]
        for curve in specimen.curves:
            noise = noise_of(curve)
            assert noise.sd_N == pytest.approx(made["noise_sd_N"], rel=0.1)
            assert noise.ar1 == pytest.approx(made["noise_ar1"], abs=0.08)


def test_a_curve_without_noise_and_one_that_is_too_short():
    t = np.arange(500) / 100
    assert noise_of(Curve(Protocol("pull", t, t), 3 * t)).sd_N == pytest.approx(0, abs=1e-9)
    short = Curve(Protocol("pull", t[:10], t[:10]), t[:10])
    assert np.isnan(noise_of(short).sd_N)
    rng = np.random.default_rng(1)
    long = Curve(Protocol("pull", t, t), 3 * t + 0.5 * rng.standard_normal(t.size))
    assert noise_of(short, [short, long]) == noise_of(long)


def test_forces_of_nothing_but_zeros_have_no_noise():
    t = np.arange(500) / 100
    nothing = Curve(Protocol("pull", t, t), np.zeros(t.size))
    assert noise_of(nothing) == noise_of_each([[nothing]])[0] == Noise(0.0, 0.0)
    rng = np.random.default_rng(1)
    rough = [[Curve(Protocol("pull", t, t), 3 * t + rng.standard_normal(t.size))] for _ in range(2)]
    assert noise_of_each([rough[0], [nothing], rough[1]]) == [
        *noise_of_each(rough)[:1], Noise(0.0, 0.0), *noise_of_each(rough)[1:]
    ]  # fmt: skip


def test_specimens_of_few_points_have_the_noise_of_the_others():
    t = np.arange(600) / 10
    rng = np.random.default_rng(1)
    long = [[Curve(Protocol("pull", t, t), 3 * t + sd * rng.standard_normal(t.size))] for sd in (0.1, 0.2, 0.4)]
    few = [Curve(Protocol("pull", t[:8], t[:8]), 3 * t[:8])]
    alone = noise_of_each(long)
    found = noise_of_each([long[0], few, *long[1:]])
    assert [found[0], *found[2:]] == alone
    assert found[1].sd_N == sorted(one.sd_N for one in alone)[1]
    assert found[1].ar1 == alone[0].ar1
    assert np.isnan(noise_of_each([few, few])[0].sd_N)
    specimens = [Specimen(name, 10.0, 8.0, 4.0, tuple(curves)) for name, curves in (("a", long[0]), ("b", few))]
    remark = remark_on_others(specimens, [found[0], found[1]])
    assert remark == "too few points to estimate the noise of b; the median of the others is used"
    assert remark_on_others(specimens[:1], alone[:1]) == ""


@pytest.mark.parametrize(("sd_N", "expected"), [(0.0, "measured curves"), (np.nan, "curves of more points, of this")])
def test_curves_without_noise_are_refused_where_misfit_is_told_in_times_of_it(sd_N, expected):
    with pytest.raises(BadInput, match=f"a/1: no noise can be seen in its curves; expected {expected}"):
        refuse_none(Noise(sd_N, 0.0), Path("a/1"))
    refuse_none(Noise(1e-9, 0.0), Path("a/1"))


def test_a_long_ramp_has_no_more_splines_than_a_computer_solves():
    """Their normal equations are dense: with one more for every 400 points, 2,000,000 points would take hours."""
    t = np.arange(200_000) / 1000
    rough = 50.0 * t + np.cumsum(np.random.default_rng(1).standard_normal(t.size))  # rises: it does not break
    for finer in (1, 16):
        (piece,) = _pieces(Curve(Protocol("pull", t, t), rough), finer)
        assert 300 < piece.splines.shape[1] <= MOST_SPLINES


def test_gaps_do_not_change_the_level():
    specimens, truth = virtual_cohort(seed=5, per_site=1, rate_hz=10.0)
    for one in specimens:
        level = truth["specimens"][one.name]["noise_sd_N"]
        rows = (np.arange(curve.force_N.size) for curve in one.curves)
        seen = [np.where(at % 4 == 0, curve.force_N, np.nan) for at, curve in zip(rows, one.curves, strict=True)]
        gaps = [Curve(curve.protocol, values) for curve, values in zip(one.curves, seen, strict=True)]
        assert noise_of_all(gaps, proportional=False).sd_N == pytest.approx(level, rel=0.15)
    assert np.isnan(noise_of(Curve(gaps[0].protocol, np.full(gaps[0].force_N.size, np.nan))).sd_N)


def test_jerks_where_the_machine_turns_are_no_noise():
    """A start that overshoots, and a corner at the turn that no spline follows, as on a real machine."""
    t = np.arange(1700) / 50
    moved = np.interp(t, [0, 17, 34], [0, 40, 0])
    signal = 0.8 * (moved / 40) ** 0.6 - 0.15 * (t > 17) * (1 - np.exp(-np.maximum(t - 17, 0) / 0.05))
    signal[1:5] += (0.05, 0.03, -0.02, 0.01)
    for ar1 in (0.0, 0.5):
        found = [noise_of(noisy(moved, signal, 0.0015, ar1, seed)) for seed in range(6)]
        assert np.mean([noise.sd_N for noise in found]) == pytest.approx(0.0015, rel=0.1)
        assert np.mean([noise.ar1 for noise in found]) == pytest.approx(ar1, abs=0.15)


def test_a_rupture_is_no_noise():
    t = np.arange(3000) / 50
    signal = 100 * np.minimum(t / 40, 1) ** 1.5 * np.where(t < 40, 1, 0.05) + 8 * np.sin(t * 2) * (t < 40)
    found = [noise_of(noisy(t, signal, 0.2, 0.3, seed)) for seed in range(6)]
    assert np.mean([noise.sd_N for noise in found]) == pytest.approx(0.2, rel=0.2)


def test_what_follows_a_break_is_no_noise():
    """Too few points for splines that follow the break, as in the export of a machine that records slowly."""
    t = np.arange(83.0)
    signal = 3000 * (t / 67) ** 1.5 * np.where(t > 67, 0.55, 1.0)
    found = [noise_of(noisy(t, signal, 2.0, 0.0, seed)).sd_N for seed in range(6)]
    assert np.mean(found) == pytest.approx(2.0, rel=0.25)


def test_noise_of_high_correlation_is_not_taken_for_the_course_of_the_force():
    t = np.arange(6000) / 50
    found = [noise_of(noisy(t, 3 * t, 1.5, 0.97, seed)) for seed in range(6)]
    assert np.mean([noise.sd_N for noise in found]) == pytest.approx(1.5, rel=0.15)
    assert np.mean([noise.ar1 for noise in found]) == pytest.approx(0.97, abs=0.02)


def test_a_pause_of_the_recording_within_a_ramp():
    t = np.concatenate([np.arange(200), np.arange(2800, 3000)]) / 50
    curve = noisy(t, 3 * t, 0.2, 0.0, 1)
    found = noise_of(Curve(Protocol("pull", t, t), curve.force_N))
    assert found.sd_N == pytest.approx(0.2, rel=0.15)
