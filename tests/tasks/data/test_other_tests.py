"""Tests that are no tension or compression, and a force that is the displacement."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Reading, inspect
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_rows_of_results import table

TIMES = np.round(0.1 * np.arange(60), 3)
PULL, FORCE = np.round(0.021 * np.arange(60), 4), np.round(np.sqrt(np.arange(60.0)), 4)
NAMED = Hints(displacement_column="Gap (mm)", force_column="Normal Force (N)")


def refused(path, problem, hints=Hints()):  # noqa: B008 - frozen
    for read in (lambda: inspect(path, Reading(hints=hints)), lambda: read_recordings(path, hints)):
        with pytest.raises(BadInput, match=problem):
            read()


def taken(path, hints=Hints()):  # noqa: B008 - frozen
    assert inspect(path, Reading(hints=hints)).rows == len(TIMES)
    (one,) = read_recordings(path, hints)
    assert len(one.numbers) == len(TIMES)


def test_a_force_that_is_the_displacement_is_refused(tmp_path):
    titles = "Time (s),Position (mm),Load (N)"
    same = table(tmp_path / "same.csv", titles, [TIMES, PULL, PULL])
    refused(same, r"'Position \(mm\)' and 'Load \(N\)' hold the same numbers in all rows; expected another column")
    refused(same, "hold the same numbers", Hints(displacement_column="2", force_column="3"))
    refused(table(tmp_path / "units.csv", "Time (s),Position (um),Load (lbf)", [TIMES, PULL, PULL]), "the same numbers")
    other = PULL.copy()
    other[30] += 0.001
    taken(table(tmp_path / "other.csv", titles, [TIMES, PULL, other]))
    taken(table(tmp_path / "counts.csv", titles, [TIMES, range(60), range(60)]))
    steps = np.round(0.1 * (np.arange(60) // 2), 3)  # 30 numbers
    taken(table(tmp_path / "steps.csv", titles, [TIMES, steps, steps]))


@pytest.mark.parametrize("line", ["Method : Oliver & Pharr", "Nano-indentation of a cell wall", "Tip,Berkovich"])
def test_a_tip_that_indents_is_refused(tmp_path, line):
    titles, columns = "Time (s),Pd (nm),Fn (mN)", [TIMES, PULL, FORCE]
    path = table(tmp_path / "a.csv", f"{line}\n{titles}", columns)
    refused(path, r": a tip that indents a surface; expected a test in tension or compression")
    taken(path, Hints(displacement_column="Pd (nm)", force_column="Fn (mN)"))
    taken(table(tmp_path / "b.csv", f"Method,tension\n{titles}", columns))


@pytest.mark.parametrize("turns", ["Rotational Speed (1/min)", "Shear rate (1/s)", "Angular velocity"])
def test_a_plate_that_turns_is_refused(tmp_path, turns):
    titles, columns = f"Time (s),Gap (mm),Normal Force (N),Torque (uNm),{turns}", [TIMES, 9.0 - PULL, FORCE, FORCE]
    always, mostly, seldom = (np.where(begins <= TIMES, 0.1, 0.0) for begins in (0.0, 0.3, 4.0))
    path = table(tmp_path / "a.csv", titles, [*columns, always])
    refused(path, "and a torque: a test that turns the specimen; expected a test in tension or compression")
    taken(path, NAMED)
    refused(table(tmp_path / "b.csv", titles, [*columns, mostly]), "a test that turns the specimen")
    taken(table(tmp_path / "c.csv", titles, [*columns, seldom]))
    taken(table(tmp_path / "d.csv", titles, [*columns[:3], 0.0 * FORCE, 0.0 * FORCE]))  # squeezed only
    taken(table(tmp_path / "e.csv", titles.replace("Torque (uNm)", "Temperature (°C)"), [*columns, always]))
