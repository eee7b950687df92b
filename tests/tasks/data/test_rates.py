"""How fast tests were loaded."""

import numpy as np
import pytest

from sinew.tasks.data.rates import loading_speeds, rate_words
from sinew.tasks.model import Protocol


def protocol(*points: tuple[float, float], step_s: float = 0.1) -> Protocol:
    """A displacement (mm) between these times (s) and displacements."""
    times, moved = zip(*points, strict=True)
    time_s = np.arange(0.0, times[-1] + step_s / 2, step_s)
    return Protocol("test", time_s, np.interp(time_s, times, moved))


def test_the_speed_of_a_ramp_does_not_depend_on_the_hold_behind_it():
    ramp = protocol((0, 0), (10, 0.6), (100, 0.6))
    assert loading_speeds(ramp) == pytest.approx((0.06, 0.06), rel=0.02)
    assert rate_words(ramp, 10.0) == "0.006 1/s"
    assert rate_words(ramp, None) == "0.06 mm/s"


def test_a_ramp_that_ends_between_two_samples_has_its_own_speed():
    ramp = protocol((0, 0), (1.62, 0.162), (20, 0.162))
    assert loading_speeds(ramp) == pytest.approx((0.1, 0.1), rel=1e-6)
    faster = protocol((0, 0), (0.1, 0.005), (2.0, 0.195))
    assert loading_speeds(faster) == pytest.approx((0.0975, 0.0975), rel=1e-6), "nothing is before it"
    slower = protocol((0, 0), (1.9, 0.19), (2.0, 0.195))
    assert loading_speeds(slower) == pytest.approx((0.0975, 0.0975), rel=1e-6), "nor behind it"


def test_several_speeds_are_told_from_the_slowest_to_the_fastest():
    cycles = protocol((0, 0), (10, 1), (20, 0), (22, 1), (32, 0), (42, 1))
    assert rate_words(cycles, 10.0) == "0.01 to 0.05 1/s"


def test_a_compression_is_loaded_too_and_a_small_way_is_none():
    assert rate_words(protocol((0, 0), (10, -1)), 10.0) == "0.01 1/s"
    small = protocol((0, 0), (10, 1), (11, 0.95), (12, 1.0), (22, 0))
    assert rate_words(small, 10.0) == "0.01 1/s"


def test_what_never_moves_has_no_speed():
    assert rate_words(protocol((0, 5), (10, 5)), 10.0) == ""
