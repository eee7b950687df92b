"""Tables one under another that are one test because a person says so, or are not although one does."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.joined_tables import NOT_JOINED
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_sheets import write_workbook

UNTIMED = "Displacement (mm),Force (N)\n"
ONE = "Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n"


def test_tables_without_times_are_one_test_if_a_person_says_so(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("".join(f"{UNTIMED}{at}.1,{at}0\n{at}.2,{at}2\n{at}.3,{at}4\n" for at in range(1, 4)))
    (joined,) = read_recordings(path, Hints(tables="join", rate_hz=10.0))
    np.testing.assert_allclose(joined.numbers[:, 0], np.arange(9) / 10)
    assert joined.numbers[:, 2].tolist() == [10, 12, 14, 20, 22, 24, 30, 32, 34]
    assert "3 tables without times, as --tables says: read as one test" in joined.notes
    assert len(read_recordings(path, Hints(tables="apart", rate_hz=10.0))) == 3


def test_joining_tables_that_do_not_go_on_from_each_other_is_said_to_have_no_effect(tmp_path):
    path = tmp_path / "tests.csv"
    path.write_text(f"{ONE}Specimen B\n{ONE}")
    first, second = read_recordings(path, Hints(tables="join"))
    assert NOT_JOINED in first.notes
    assert not second.notes
    assert all(NOT_JOINED not in one.notes for one in read_recordings(path, Hints(tables="apart")))


def test_empty_titles_at_the_end_make_no_other_titles(tmp_path):
    table = [["Time (s)", "Extension (mm)", "Load (N)"], [0, 0, 0], [1, 0.1, 5], [2, 0.2, 9]]
    wide = [[*table[0], ""], *table[1:-1], [*table[-1], "broken"]]
    both = read_recordings(write_workbook(tmp_path / "tests.xlsx", A=wide, B=table), Hints())
    assert [one.test for one in both] == ["A", "B"]
    more = [[*table[0], "Grip (mm)"], *([*row, 1] for row in table[1:])]
    assert len(read_recordings(write_workbook(tmp_path / "more.xlsx", A=wide, B=more), Hints())) == 2
    for other in ([*table[0][:2], "Load (kN)"], [table[0][0], "Stroke (mm)", table[0][2]]):
        with pytest.raises(BadInput, match="has other titles than the first one"):
            read_recordings(write_workbook(tmp_path / "units.xlsx", A=wide, B=[other, *table[1:]]), Hints())
    other = [["Grip (mm)", *table[0]], *([1, *row] for row in table[1:])]
    with pytest.raises(BadInput, match="has other titles than the first one"):
        read_recordings(write_workbook(tmp_path / "other.xlsx", A=wide, B=other), Hints())


def test_sheets_whose_times_are_those_of_steps_are_one_test_or_several(tmp_path):
    """As TRIOS writes them: times begin again with each step, and a later one may have a further column."""
    titles, units = ["Step time", "Gap", "Axial force"], ["s", "mm", "N"]
    steps = {
        f"Axial - {step}": [
            [f"Axial - {step}"],
            [*titles, *(["Torque"] if step == 3 else [])],
            [*units, *(["N.m"] if step == 3 else [])],
            *([t, 8.0 - 0.1 * (t + 10 * step), -1.0 * (t + 10 * step) + 4 * step] for t in range(10)),
        ]
        for step in (1, 2, 3)
    }
    path = write_workbook(tmp_path / "steps.xlsx", **steps)
    with pytest.raises(Unclear, match="a test is a step of its own, by 'Step time', while its time starts again"):
        read_recordings(path, Hints())
    (one,) = read_recordings(path, Hints(tables="join"))
    np.testing.assert_allclose(one.numbers[:, 0], np.arange(30))
    assert [test.test for test in read_recordings(path, Hints(tables="apart"))] == list(steps)
    own = {name: [rows[0], ["Time", *rows[1][1:]], *rows[2:]] for name, rows in steps.items()}
    assert len(read_recordings(write_workbook(tmp_path / "tests.xlsx", **own), Hints())) == 3
