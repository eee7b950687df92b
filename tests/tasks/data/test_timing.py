"""Times that a person tells: by a rate, or by a speed along the way of the motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.timing import Timing

MOTION = np.array([1.0, 1.5, 3.0, 2.0])


def test_times_by_a_rate_count_rows():
    assert Timing(rate_hz=4.0).times(MOTION).tolist() == [0.0, 0.25, 0.5, 0.75]


def test_times_by_a_speed_follow_the_way_there_and_back():
    assert Timing(speed=0.5).times(MOTION).tolist() == [0.0, 1.0, 4.0, 6.0]


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20), st.floats(0.01, 100))
def test_times_by_a_speed_give_the_speed_back(motion, speed):
    times = Timing(speed=speed).times(np.array(motion))
    assert times[0] == 0.0
    assert np.diff(times) * speed == pytest.approx(np.abs(np.diff(motion)), abs=1e-9)


def test_whether_anything_is_told():
    assert not Timing().given
    assert Timing(rate_hz=1).given
    assert [str(Timing(rate_hz=100)), str(Timing(speed=0.05))] == ["--rate-hz 100", "--speed 0.05"]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), 1e-310])
@pytest.mark.parametrize("option", ["rate_hz", "speed"])
def test_what_is_no_rate_is_refused(option, value):
    with pytest.raises(BadInput, match=f"--{option.replace('_', '-')}: .*; expected a number from 1e-06"):
        Timing(**{option: value})


def test_a_rate_and_a_speed_together_are_refused():
    with pytest.raises(BadInput, match="--speed: given together with --rate-hz"):
        Timing(rate_hz=1.0, speed=1.0)
