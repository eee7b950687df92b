"""Tests one under another in a table that no column tells apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Reading, inspect
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.restarts import restarts

UP = np.linspace(0.0, 3.0, 30)
TITLES = "Displacement (mm),Force (N)"
BEGINS = r"the motion begins again in rows {} and {}: tests one under another, or one test; expected --tables apart"


def of(moved, load=None, time_s=None):
    moved = np.asarray(moved)
    load = 5.0 * moved if load is None else np.asarray(load)
    return restarts(np.zeros(moved.size) if time_s is None else np.asarray(time_s), moved, load)


@given(st.lists(st.tuples(st.integers(30, 60), st.floats(0.5, 2.0)), min_size=1, max_size=6), st.floats(-50.0, 50.0))
def test_every_ramp_behind_the_first_is_a_test(ramps, start):
    moved = np.concatenate([start + np.linspace(0.0, height, count) for count, height in ramps])
    load = np.concatenate([np.linspace(0.0, height, count) ** 2 for count, height in ramps])
    assert of(moved, load) == np.cumsum([count for count, _ in ramps])[:-1].tolist()


@pytest.mark.parametrize(
    "moved",
    [
        UP,
        np.concatenate([UP, UP[::-1], UP]),  # cycles
        np.concatenate([np.zeros(5), np.full(40, 3.0), np.zeros(40)]),  # a step, and recovery
        np.concatenate([UP, [0.0, 0.0]]),  # the machine returns
        np.concatenate([UP, 1.5 + UP]),  # another ramp, from elsewhere
        np.zeros(20),
        [],
    ],
)
def test_one_test_is_one(moved):
    assert of(moved) == []


def test_the_motion_along_an_axis_may_rest_while_the_load_begins_again():
    """Biaxial tests one under another: both axes, the first one alone, both, the second one alone, both."""
    pulled = np.array([1.0, 1.0, 0.7, 0.0, 1.0])
    moved = np.concatenate([1.0 + each * UP for each in pulled])
    load = np.concatenate([(2.0 + each) * UP for each in pulled])
    assert of(moved, load) == [30, 60, 90, 120]
    assert of(moved, np.concatenate([load[:90], np.zeros(30), load[120:]])) == [30, 60]  # it rests, unloaded


def test_noise_of_a_rest_before_the_motion_begins_no_test():
    rng = np.random.default_rng(1)
    moved = np.concatenate([np.zeros(300), UP])
    for _ in range(20):
        noise = 0.5 * rng.standard_normal(330)
        for each in (noise, np.round(noise)):  # also one that rests in most rows
            assert of(moved, np.concatenate([np.zeros(300), 10.0 * UP]) + each) == []


def test_a_motion_that_goes_back_by_less_than_half_begins_no_test():
    back = np.concatenate([UP, UP[::-1][:18]])  # to 1.24 of 3
    assert of(np.concatenate([back, UP])) == []
    assert of(np.concatenate([UP, UP[::-1][:12], UP])) == [42]  # from 1.86


def test_a_motion_that_is_set_to_zero_while_the_load_goes_on_is_no_new_test():
    assert of(np.concatenate([UP, UP]), np.arange(60.0)) == []
    assert of(np.concatenate([UP, UP])) == [30]


def test_times_that_begin_again_tell_tests_whatever_the_motion_does():
    time_s = np.arange(30.0)
    both = np.concatenate([UP, 1.0 + UP])
    assert of(both, time_s=np.concatenate([time_s, time_s + 0.5])) == [30]
    assert of(both, time_s=np.concatenate([time_s, time_s + 10.0])) == []  # a clock that was set back
    assert of(np.concatenate([UP, UP]), time_s=np.arange(60.0)) == []
    assert of(np.concatenate([UP, UP[:2]]), time_s=np.concatenate([time_s, [0.0, 1.0]])) == []  # fewer than three rows


def rows(height, gap=""):
    return "".join(f"{u:.3f},{5 * height * u:.3f}\n" for u in height * UP) + gap


@pytest.mark.parametrize("gap", ["", "\n", ",\n", "\n\n"])
def test_a_person_says_whether_they_are_tests_with_or_without_empty_rows_between_them(tmp_path, gap):
    path = tmp_path / "a.csv"
    path.write_text(f"{TITLES}\n" + rows(1.0, gap) + rows(0.8, gap) + rows(1.2))
    step = 30 + gap.count("\n")
    told = BEGINS.format(2 + step, 2 + 2 * step)
    with pytest.raises(Unclear, match=told):
        read_recordings(path, Hints(rate_hz=10.0))
    apart = read_recordings(path, Hints(speed=0.5, tables="apart"))
    assert [(one.test, one.rows[0], len(one.rows)) for one in apart] == [
        ("1", 2, 30), ("2", 2 + step, 30), ("3", 2 + 2 * step, 30),
    ]  # fmt: skip
    for one, height in zip(apart, (1.0, 0.8, 1.2), strict=True):
        assert one.numbers[:, 0] == pytest.approx(2 * height * UP, abs=0.01)  # each counts its times from its start
    (joined,) = read_recordings(path, Hints(rate_hz=10.0, tables="join"))
    assert len(joined.rows) == 90 and (np.diff(joined.numbers[:, 0]) > 0).all()
    found = inspect(path).content()
    assert (found["specimens"], found["rows"]) == (3, 90)
    assert found["peak_force_N"] == pytest.approx(5 * 1.2 * 1.2 * 3, abs=0.01), "in the last row of the last test"
    assert sum("begins again in rows" in one for one in found["ask"]) == 1


def test_a_person_may_say_that_a_column_tells_cycles_apart_or_that_all_is_one_test(tmp_path):
    path = tmp_path / "a.csv"
    lines = [*rows(1.0).split(), *rows(1.0).split()]
    path.write_text(f"cycle,{TITLES}\n" + "".join(f"{at // 30},{line}\n" for at, line in enumerate(lines)))
    for said in ({"test_column": "none"}, {"cycle_column": "cycle"}):
        (one,) = read_recordings(path, Hints(rate_hz=10.0, **said))
        assert len(one.rows) == 60
        found = inspect(path, Reading(hints=Hints(rate_hz=10.0, **said))).content()
        assert found["specimens"] == 1 and not any("begins again" in each for each in found["ask"])


def test_a_single_point_that_is_wrong_begins_no_test():
    cycles = np.concatenate([UP, UP[::-1], UP, UP[::-1]])
    moved = np.concatenate([cycles[:85], [0.0], cycles[85:]])  # near a peak, where it goes back by more than half
    assert of(moved, np.zeros(121)) == []
    assert of(np.concatenate([cycles[:85], UP]), np.zeros(115)) == [85]  # as a test does that goes on from there


def test_empty_rows_are_passed_over_where_times_go_on(tmp_path):
    path = tmp_path / "a.csv"
    lines = [f"{t / 10},{u:.3f},{u:.3f}" for t, u in enumerate(UP)]
    path.write_text("\n".join([f"Time (s),{TITLES}", lines[0], "", *lines[1:9], "", "", *lines[9:]]))
    (one,) = read_recordings(path, Hints())
    assert len(one.rows) == 30 and one.rows[:2] == (2, 4)
    assert one.notes == ("2 empty rows among the numbers are passed over, the first above row 4: times go on there",)
    assert inspect(path).rows == 30


def test_an_empty_row_within_a_test_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    lines = rows(1.0).splitlines(keepends=True)
    path.write_text("".join([f"{TITLES}\n", *lines[:10], "\n", *lines[10:], rows(1.0)]))
    for tables in (None, "apart", "join"):
        with pytest.raises(BadInput, match="row 12: an empty row among the numbers"):
            read_recordings(path, Hints(rate_hz=10.0, tables=tables))


def test_rows_of_words_are_no_empty_rows(tmp_path):
    path = tmp_path / "a.csv"
    lines = rows(1.0).splitlines(keepends=True)
    path.write_text("".join([f"{TITLES}\n", *lines[:10], "pause,\n", *lines[10:], "\n", rows(0.8)]))
    apart = read_recordings(path, Hints(rate_hz=10.0, tables="apart"))
    assert [(one.rows[0], len(one.rows)) for one in apart] == [(2, 30), (34, 30)]


def test_times_of_a_file_that_begin_again(tmp_path):
    path = tmp_path / "a.csv"
    one = "".join(f"{t / 10},{u:.3f},{u:.3f}\n" for t, u in enumerate(UP))
    path.write_text(f"Time (s),{TITLES}\n" + one * 2)
    with pytest.raises(Unclear, match="the time begins again in row 32: tests one under another"):
        read_recordings(path, Hints())
    first, second = read_recordings(path, Hints(tables="apart"))
    assert np.array_equal(first.numbers, second.numbers) and second.rows[0] == 32
    (joined,) = read_recordings(path, Hints(tables="join"))
    assert joined.numbers[-1, 0] == pytest.approx(5.9)
    path.write_text(f"id,Time (s),{TITLES}\n" + "".join(f"{n},{line}\n" for n in "ab" for line in one.splitlines()))
    (together,) = read_recordings(path, Hints())
    assert "--test-column 'id'" in together.remedy  # a column tells them apart


def test_a_file_with_an_empty_row_below_each_is_one_test(tmp_path):
    path = tmp_path / "a.csv"
    lines = [f"0:00:{t // 2:02d},{u:.3f},{u:.3f}" for t, u in enumerate(UP)]
    path.write_text("\n\n".join([f"Time,{TITLES}", *lines]))
    (one,) = read_recordings(path, Hints(same_times="spread"))
    assert len(one.rows) == 30
    told = "29 empty rows among the numbers are passed over, the first above row 5: each row has one below it"
    assert one.notes[0] == told
    path.write_text("\n\n".join([f"Time,{TITLES}", *lines[:-2], "\n".join(lines[-2:])]))
    with pytest.raises(BadInput, match="row 4: an empty row among the numbers"):
        read_recordings(path, Hints(same_times="spread"))
