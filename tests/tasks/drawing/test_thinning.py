"""Thinned curves keep what an eye would see of all their points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.model import Protocol


def cyclic(rows: int, cycles: int) -> Protocol:
    time = np.linspace(0.0, 100.0, rows)
    return Protocol("cyclic", time, 1.0 - np.cos(2 * np.pi * cycles * time / 100.0))


def test_the_peak_and_the_valley_of_every_cycle_are_drawn():
    protocol = cyclic(20_001, 60)
    force = protocol.displacement_mm * np.linspace(1.0, 0.7, 20_001)
    keep = drawn_points(protocol, force, count=500)
    cycle = protocol.time_s * 60 / 100
    for number in range(1, 60):
        for turn, best in ((number - 0.5, np.max), (number, np.min)):
            inside = np.flatnonzero(np.abs(cycle - turn) < 0.5)
            assert best(force[np.intersect1d(inside, keep)]) == best(force[inside])


@given(st.integers(0, 9_999), st.integers(0, 9_999), st.sampled_from([1.0, -1.0]))
def test_a_spike_of_one_point_in_any_of_the_curves_is_drawn(first, second, sign):
    protocol = cyclic(10_000, 3)
    one, other = protocol.displacement_mm.copy(), np.zeros(10_000)
    one[first], other[second] = sign * 9.0, sign * 9.0
    assert {first, second} <= set(drawn_points(protocol, one, other, count=400))


@pytest.mark.parametrize("count", [60, 500, 2_000])
def test_there_are_no_more_points_than_asked_for_and_the_ends_are_among_them(count):
    protocol = cyclic(5_000, 7)
    keep = drawn_points(protocol, protocol.displacement_mm, np.sin(protocol.time_s), count=count)
    assert keep.size <= count
    assert (np.diff(keep) > 0).all()
    assert (keep[0], keep[-1]) == (0, 4_999)


def test_a_short_curve_is_drawn_whole_and_missing_values_hide_nothing():
    assert drawn_points(cyclic(50, 2), np.full(50, np.nan), count=50).tolist() == list(range(50))
    protocol = cyclic(5_000, 2)
    force = np.full(5_000, np.nan)
    force[[1234, 4321]] = -1.0, 1.0
    assert {1234, 4321} <= set(drawn_points(protocol, force, count=100))
    assert drawn_points(protocol, np.full(5_000, np.nan), count=100).size <= 100


def test_the_largest_displacement_is_kept():
    time = np.arange(5000.0)
    moved = np.minimum(time, 2400.0)
    moved[2403], moved[4000] = 2411.0, -3.0
    kept = drawn_points(Protocol("hold", time, moved), np.cos(time), count=500)
    assert {2403, 4000} <= set(kept.tolist())
    assert kept.size <= 500
