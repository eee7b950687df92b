"""Rows at the start of a test that have the same time."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import check_times
from sinew.tasks.data.first_rows import before_clock
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


def test_a_test_begins_with_the_last_of_them(tmp_path):
    later = np.maximum(TIME - 0.1, 0.0)
    found = read(tmp_path, later, changed(WAY, 1, 0.0), changed(FORCE, slice(0, 2), [0.3, 0.2]))
    check_times(found)
    assert found.numbers[:2].tolist() == [[0.0, 0.0, 0.2], [0.1, 0.1, 0.5]]
    assert found.notes == ("the first 2 rows have the same time, 0 s: the test begins with the last of them",)
    with pytest.raises(BadInput, match=r"time: 0\.2 s after 0\.2 s"):
        check_times(read(tmp_path, changed(TIME, 3, 0.2)))
