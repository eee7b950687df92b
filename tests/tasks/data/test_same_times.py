"""Rows that have the same time: at the start of a test, or a few later."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import check_times
from sinew.tasks.data.same_times import again, before_clock, behind_clock, is_coarse, spread
from tests.tasks.data.one_test_file import FORCE, TIME, WAY, changed, read


def numbers(time_s, moved=WAY, force=FORCE):
    return np.column_stack([time_s, moved, force])


def test_they_are_those_before_the_last_with_the_first_time():
    assert before_clock(numbers(TIME)) == 0
    later = np.maximum(TIME - 0.2, 0.0)
    still = changed(WAY, slice(0, 3), 0.0), changed(FORCE, slice(0, 3), [0.0, 0.01, 0.0])
    assert before_clock(numbers(later, *still)) == 2
    assert before_clock(numbers(np.zeros(TIME.size))) == 0, "no clock at all"


def test_where_something_moves_or_there_are_many_the_clock_is_coarse():
    later = np.maximum(TIME - 0.1, 0.0)
    assert before_clock(numbers(later)) == 0, "it moves by a twentieth of the way"
    waits = np.maximum(TIME - 1.0, 0.0)
    still = changed(WAY, slice(0, 11), 0.0), changed(FORCE, slice(0, 11), 0.0)
    assert before_clock(numbers(waits, *still)) == 0, "a quarter of all rows"


def test_a_load_may_be_that_of_another_state_of_the_machine_before_the_clock_runs():
    later = np.maximum(TIME - 0.2, 0.0)
    still = changed(WAY, slice(0, 3), 0.0), changed(FORCE, slice(0, 3), [9.0, 9.1, 0.0])
    assert before_clock(numbers(later, *still)) == 2
    assert before_clock(numbers(changed(later, 20, later[19]), *still)) == 0, "the clock is coarse"


def test_few_rows_at_the_end_whose_clock_is_back_are_left_out(tmp_path):
    for ends, behind in (([0.0], 1), ([0.5], 0), ([TIME[0]], 1)):
        assert behind_clock(numbers(changed(TIME, slice(40 - len(ends), 40), ends))) == behind
    long = np.arange(1000.0)
    measured = np.zeros((1000, 2))
    for behind, found in ((10, 10), (11, 0)):
        assert behind_clock(np.column_stack([changed(long, slice(1000 - behind, 1000), 0.0), measured])) == found
    assert behind_clock(numbers(np.zeros(40))) == 0 and behind_clock(numbers(TIME)) == 0
    assert behind_clock(numbers(changed(TIME + 5.0, 39, 0.0))) == 1, "zero is before the first time"
    assert behind_clock(numbers(TIME - 5.0)) == 0, "times before zero"
    found = read(tmp_path, changed(TIME, 39, 0.0))
    check_times(found)
    assert (len(found.rows), found.notes) == (39, ("the last row has the time 0 s again, and is left out",))


def test_a_test_begins_with_the_last_of_them(tmp_path):
    later = np.maximum(TIME - 0.1, 0.0)
    found = read(tmp_path, later, changed(WAY, 1, 0.0), changed(FORCE, slice(0, 2), [0.3, 0.2]))
    check_times(found)
    assert found.numbers[:2].tolist() == [[0.0, 0.0, 0.2], [0.1, 0.1, 0.5]]
    assert found.notes == ("the first 2 rows have the same time, 0 s: the test begins with the last of them",)
    with pytest.raises(BadInput, match=r"times repeat in 1 of 40 rows, first in row 5; expected --same-times spread"):
        check_times(read(tmp_path, changed(TIME, 3, 0.2)))


LONG = np.arange(400) / 10


def long_test(*repeated: int, moved: float = 0.0):
    """A test of 400 rows, some of which repeat the time of the row before."""
    time_s = LONG.copy()
    for row in repeated:
        time_s[row:] -= 0.1
    way = LONG / 40
    for row in repeated:
        way[row] = way[row - 1] + moved
    return time_s, way, 50.0 * way


def test_a_few_rows_with_the_time_of_the_row_before_are_left_out_and_said(tmp_path):
    found = read(tmp_path, *long_test(100, 300))
    check_times(found)
    assert len(found.rows) == len(found.numbers) == 398
    assert {102, 302}.isdisjoint(found.rows)
    assert {101, 103, 301, 303} <= set(found.rows)
    assert found.notes == ("2 of 400 rows repeat the time stamp before them and are left out: 102, 302",)


@pytest.mark.parametrize(
    "test", [long_test(100, 101), long_test(100, moved=0.2), long_test(*range(50, 350, 50)), long_test(100)[:2]]
)
def test_rows_that_move_or_follow_each_other_or_are_many_are_not(test):
    """Two in a row, one that moves by 2 % of the way, or six of 400; the last is as a clock that goes back once."""
    time_s, way, *force = test
    if not force:
        time_s[200:] -= 30.0
    assert again(numbers(time_s, way, 50.0 * way)).size == 0


def test_equal_times_are_spread_up_to_the_next_step_of_the_clock():
    assert is_coarse(np.array([0.0, 1.0, 1.0])) and not is_coarse(np.zeros(3)) and not is_coarse(np.arange(3.0))
    assert not is_coarse(np.array([0.0, 1.0, 1.0, 0.5])), "it goes back"
    assert spread(np.array([0.0, 1.0, 1.0, 2.0])).tolist() == [0.0, 1.0, 1.5, 2.0]
    assert spread(np.array([0.0, 0.0, 1.0, 2.0, 900.0, 901.0])).tolist() == [0.0, 0.5, 1.0, 2.0, 900.0, 901.0]
    assert spread(np.array([0.0, 1.0, 2.0, 2.0, 900.0, 900.0])).tolist() == [0.0, 1.0, 2.0, 2.5, 900.0, 900.5]


@given(arrays(np.int64, st.integers(2, 60), elements=st.integers(0, 9)))
def test_spread_times_increase_and_stay_within_a_step(ticks):
    times = np.sort(ticks) * 0.25
    if is_coarse(times):
        found = spread(times)
        assert (np.diff(found) > 0).all()
        assert (found >= times).all() and (found - times < np.median(np.diff(np.unique(times)))).all()
