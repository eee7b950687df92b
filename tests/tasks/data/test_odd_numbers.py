"""Marks of what was not measured, limits of sensors, gaps in time and factors are not taken for measurements."""

import re
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import Recording, read_recordings
from sinew.tasks.data.remarks import remarks

TITLES = "Time (s),Extension (mm),Force (N)"
TIME = np.arange(40) / 10
WAY = np.minimum(np.arange(40) / 20, 1.0)
FORCE = np.round(50.0 * WAY**2, 2)


def read(folder: Path, time=TIME, moved=WAY, force=FORCE, above: str = "", titles: str = TITLES) -> Recording:
    path = folder / "test.csv"
    rows = "".join(f"{t:.3f},{u:.4f},{f:.2f}\n" for t, u, f in zip(time, moved, force, strict=True))
    path.write_text(f"{above}{titles}\n{rows}")
    return read_recordings(path, Hints())[0]


def changed(values, places, to):
    found = np.array(values, dtype=float)
    found[places] = to
    return found


def test_a_usual_test_is_not_odd(tmp_path):
    assert remarks(read(tmp_path)) == []


@pytest.mark.parametrize("mark", [-999.0, 9999.0, -9999.99])
@pytest.mark.parametrize("column", ["moved", "force"])
def test_a_mark_of_what_was_not_measured_is_refused(tmp_path, mark, column):
    values = {"moved": WAY, "force": FORCE}[column]
    told = {column: changed(values, [7, 8], mark)}
    with pytest.raises(BadInput, match=rf"row 9, .*: '{re.escape(f'{mark:g}')}.*a usual mark of no measurement"):
        read(tmp_path, **told)


def test_large_numbers_beside_others_are_measurements(tmp_path):
    force = np.linspace(0.0, 999.0, 40)
    assert read(tmp_path, force=force).numbers[-1, 2] == 999.0
    alone = changed(np.zeros(40), 39, 999.0)
    assert read(tmp_path, force=alone).numbers[-1, 2] == 999.0, "there is nothing to compare it with"


def test_a_force_at_its_limit_is_told(tmp_path):
    moved = np.linspace(0.0, 1.0, 40)
    (line,) = remarks(read(tmp_path, moved=moved, force=np.minimum(100.0 * moved, 80.0)))
    assert line == (
        "the force stays at exactly 80 N, its largest value, in 8 rows while the displacement goes on; "
        "it may be the limit of the load cell"
    )
    (line,) = remarks(read(tmp_path, moved=moved, force=changed(100.0 * moved, slice(30, 35), 120.0)))
    assert "in 5 rows" in line
    assert remarks(read(tmp_path, moved=moved, force=changed(100.0 * moved, slice(30, 34), 120.0))) == []


def test_a_converter_that_overflows_is_told(tmp_path):
    moved = np.linspace(0.0, 1.0, 40)
    force = np.where(moved > 0.8, -32.8 + 20 * (moved - 0.8), 40.0 * moved)
    found = [line for line in remarks(read(tmp_path, moved=moved, force=force)) if "converter" in line]
    assert found == ["the force turns from 31.79 to -32.39 N from one row to the next, at 3.2 s; "
                     "a converter may have overflown"]  # fmt: skip
    cyclic = 30.0 * np.sin(np.arange(40) / 3)
    assert not [line for line in remarks(read(tmp_path, force=cyclic)) if "converter" in line]


def test_a_gap_in_time_is_told(tmp_path):
    time = TIME + np.where(np.arange(40) > 25, 3600.0, 0.0)
    (line,) = remarks(read(tmp_path, time=time))
    assert line == (
        "times go on from 2.5 to 3602.6 s from one row to the next; nothing may have been recorded in between"
    )
    assert remarks(read(tmp_path, time=np.geomspace(1.0, 4000.0, 40))) == [], "ever longer steps"
    assert remarks(read(tmp_path, time=np.concatenate([TIME[:20], TIME[19] + np.arange(1, 21) * 10.0]))) == [], (
        "another rate"
    )


def test_a_last_number_that_is_cut_off_is_left_out(tmp_path):
    path = tmp_path / "test.csv"
    read(tmp_path)
    whole = path.read_text()
    path.write_text(whole[:-3])
    (found,) = read_recordings(path, Hints())
    assert (len(found.numbers), found.notes) == (39, ("row 41 ends within a number, '50.', and is left out",))
    path.write_text(whole[:-1])
    (found,) = read_recordings(path, Hints())
    assert (len(found.numbers), found.notes) == (40, ())
    rows = [line.rstrip("0") for line in whole.splitlines()]
    path.write_text("\n".join(rows))
    assert len(read_recordings(path, Hints())[0].numbers) == 40, "numbers without zeros at their end"


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("Load scale factor: 1000\n", "'Load scale factor: 1000'"),
        ("Force,scaling,0.5\n", "'Force scaling 0.5'"),
        ("Load scale factor: 1.0\n", None),
        ("Load cell: 1000 N\n", None),
        ("Safety factor: 3\n", None),
    ],
)
def test_a_factor_above_the_table_is_told(tmp_path, line, told):
    found = remarks(read(tmp_path, above=line))
    assert found == ([] if told is None else [f"the file tells {told}; numbers are read as they stand, without it"])


@pytest.mark.parametrize("row", ["x1,x1,x1000", "*1,*1,*0.001", "x 1,x 1,x 1e3", "10^0,10^0,10^3"])
def test_a_row_of_factors_is_refused(tmp_path, row):
    path = tmp_path / "test.csv"
    numbers = "".join(f"{i},{i},{i}\n" for i in range(20))
    path.write_text(f"Time,Extension,Force\ns,mm,N\n{row}\n{numbers}")
    with pytest.raises(BadInput, match=r"row 3: '.*' above the numbers may be factors of the columns"):
        read_recordings(path, Hints())


def test_a_unit_above_the_table_may_not_contradict_the_title(tmp_path):
    with pytest.raises(BadInput, match="the force has two units: 'N' and 'kN'"):
        read(tmp_path, above="Force unit: kN\n")
    assert read(tmp_path, above="Force unit: N\n").numbers[-1, 2] == 50.0
    found = read(tmp_path, above="Force unit: kN\n", titles="Time (s),Extension (mm),Force")
    assert (found.numbers[-1, 2], found.load.unit) == (50_000.0, "kN")


@pytest.mark.parametrize("title", ["-Force (N)", "- Force (N)", "\u2212Force (N)"])
def test_a_title_with_a_minus_is_none_of_a_force(tmp_path, title):
    with pytest.raises(BadInput, match="no column of force or stress"):
        read(tmp_path, titles=f"Time (s),Extension (mm),{title}")


def test_a_true_stress_is_no_engineering_stress(tmp_path):
    with pytest.raises(BadInput, match="no column of force or stress"):
        read(tmp_path, titles="Time (s),Extension (mm),Stress (MPa) true")


def test_rows_of_words_are_left_out_with_a_remark(tmp_path):
    path = tmp_path / "test.csv"
    rows = [f"{t:.3f},{u:.4f},{f:.2f}" for t, u, f in zip(TIME, WAY, FORCE, strict=True)]
    lines = [TITLES, *rows[:20], "# Event: target reached, hold", *rows[20:]]
    path.write_text("\n".join(lines))
    (found,) = read_recordings(path, Hints())
    assert len(found.numbers) == 40
    assert found.notes == ("row 22 holds no number: '# Event: target reached hold'; left out",)
    path.write_text("\n".join([*lines, "", "Stop,Operator,"]))
    (found,) = read_recordings(path, Hints())
    assert len(found.numbers) == 40
    assert found.notes == ("2 rows hold no number, the first is row 22: '# Event: target reached hold'; left out",)
    path.write_text("\n".join([*lines[:20], "2.000,,", *lines[20:]]))
    with pytest.raises(BadInput, match=r"row 21, Extension .*an empty cell"):
        read_recordings(path, Hints())
