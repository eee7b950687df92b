"""Tests that are no tension or compression, and a force that is the displacement."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Reading, inspect
from sinew.tasks.data.recordings import read_recordings

TIMES = np.round(0.1 * np.arange(60), 3)
PULL, FORCE = np.round(0.021 * np.arange(60), 4), np.round(np.sqrt(np.arange(60.0)), 4)
NAMED = Hints(displacement_column="Gap (mm)", force_column="Normal Force (N)")


def table(path, titles, *columns, above=""):
    lines = (",".join(map(str, row)) for row in zip(*columns, strict=True))
    path.write_text("\n".join([*([above] if above else []), titles, *lines]) + "\n")
    return path


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
    same = table(tmp_path / "same.csv", titles, TIMES, PULL, PULL)
    refused(same, r"'Position \(mm\)' and 'Load \(N\)' hold the same numbers in all rows; expected another column")
    refused(same, "hold the same numbers", Hints(displacement_column="2", force_column="3"))
    other = PULL.copy()
    other[30] += 0.001
    taken(table(tmp_path / "other.csv", titles, TIMES, PULL, other))
    taken(table(tmp_path / "counts.csv", titles, TIMES, np.arange(60), np.arange(60)))
    steps = np.round(0.1 * (np.arange(60) // 2), 3)  # 30 numbers
    taken(table(tmp_path / "steps.csv", titles, TIMES, steps, steps))


@pytest.mark.parametrize("line", ["Method : Oliver & Pharr", "Nano-indentation of a cell wall", "Tip,Berkovich"])
def test_a_tip_that_indents_is_refused(tmp_path, line):
    path = table(tmp_path / "a.csv", "Time (s),Pd (nm),Fn (mN)", TIMES, PULL, FORCE, above=line)
    refused(path, r": a tip that indents a surface; expected a test in tension or compression")
    taken(path, Hints(displacement_column="Pd (nm)", force_column="Fn (mN)"))
    taken(table(tmp_path / "b.csv", "Time (s),Pd (nm),Fn (mN)", TIMES, PULL, FORCE, above="Method,tension"))


@pytest.mark.parametrize("turns", ["Rotational Speed (1/min)", "Shear rate (1/s)", "Angular velocity"])
def test_a_plate_that_turns_is_refused(tmp_path, turns):
    titles = f"Time (s),Gap (mm),Normal Force (N),Torque (uNm),{turns}"
    path = table(tmp_path / "a.csv", titles, TIMES, 9.0 - PULL, FORCE, FORCE, 0.1 + 0.0 * PULL)
    refused(path, "and a torque: a test that turns the specimen; expected a test in tension or compression")
    taken(path, NAMED)
    taken(table(tmp_path / "b.csv", titles, TIMES, 9.0 - PULL, FORCE, 0.0 * FORCE, 0.0 * PULL))  # squeezed only
    for name, begins in (("c", 4.0), ("d", 0.3)):
        turning = np.where(begins <= TIMES, 0.1, 0.0)
        path = table(tmp_path / f"{name}.csv", titles, TIMES, 9.0 - PULL, FORCE, FORCE, turning)
        if name == "c":
            taken(path)
        else:
            refused(path, "a test that turns the specimen")
    without = titles.replace("Torque (uNm)", "Temperature (°C)")
    taken(table(tmp_path / "e.csv", without, TIMES, 9.0 - PULL, FORCE, FORCE, 0.1 + 0.0 * PULL))
