"""Rows whose numbers may stand under other titles than their own are refused."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_sheets import write_workbook

TITLES = "Time (s)\tDisp (mm)\tForce (N)\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        pytest.param(
            "Temps (s)\tDéplacement (mm)\tForce (N)\n0,0\t0,00\t0,5\n1,0\t0,50\t480,2\n2,0\t1,00\t950,7\n"
            "3,0\t1,50\t1 420,3\n4,0\t2,00\t1 890,9\n",
            r"row 5: 4 numbers under 3 columns; expected as many in each row as it has titles, without marks for tho",
            id="a space for thousands",
        ),
        pytest.param(
            "Time (s),Disp (mm),Force (N)\n0.0,0.2,980.1\n0.1,0.4,990.2\n0.2,0.6,1,000.5\n0.3,0.7,1,010.5\n",
            "row 4: 4 numbers under 3 columns; .*, and another mark between columns than the decimal mark",
            id="a comma for thousands",
        ),
        pytest.param(
            "Time_s Camera_mm Disp_mm Force_N\n0.0 0.1 0.2 1.5\n0.1 0.1 0.3 2.5\n0.2 0.1 0.4 3.5\n0.3 0.5 4.5\n",
            "row 5, Force_N: an empty cell",
            id="a blank cell between spaces",
        ),
    ],
)
def test_a_row_with_other_columns_is_refused(tmp_path, text, words):
    path = tmp_path / "test.txt"
    path.write_text(text)
    with pytest.raises(BadInput, match=words):
        read_recordings(path, Hints())


@pytest.mark.parametrize(
    "row", ["0.3\t0.4\t4.5\tbreak", "0.3\t0.4\t4.5\t", "0.3\t0.4\t4.5"], ids=["a comment", "an empty cell", "nothing"]
)
def test_what_is_no_number_may_stand_behind_the_last_column(tmp_path, row):
    path = tmp_path / "test.txt"
    path.write_text(f"{TITLES}0.0\t0.1\t1.5\n0.1\t0.2\t2.5\n0.2\t0.3\t3.5\n{row}\n")
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers[-1].tolist() == [0.3, 0.4, 4.5]


def test_words_in_some_rows_between_spaces_do_no_harm(tmp_path):
    path = tmp_path / "test.txt"
    path.write_text(
        "Time_s Disp_mm Force_N Event\n0.0 0.0 0.5 START\n0.1 0.1 1.5\n0.2 0.2 2.5 ramp up\n"
        "0.3 0.3 3.5\n0.4 0.4 4.5 end\n"
    )
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers[:, 2].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5]


def test_a_blank_cell_between_spaces_does_not_move_the_numbers(tmp_path):
    path = tmp_path / "test.txt"
    rows = ("0.0 0.1 0.2 1.5 21", "0.1 0.1 0.3 2.5 21", "0.2 0.1 0.4 3.5 21", "0.3 0.5 4.5 21")
    path.write_text("\n".join(["Time_s Camera_mm Disp_mm Force_N Temp_C", *rows, ""]))
    with pytest.raises(BadInput, match="row 5: 4 numbers under 5 columns"):
        read_recordings(path, Hints())


def short(*places, mark=","):
    """A table of four columns, of which these rows lack their force."""
    rows = [[f"{i}.0", f"{i / 50:.2f}", f"{i / 1.5:.2f}", "20"] for i in range(30)]
    for place in places:
        del rows[place][2]
    titles = ["Time (s)", "Displacement (mm)", "Force (N)", "Temp (C)"]
    return "\n".join(mark.join(row) for row in (titles, *rows)) + "\n"


@pytest.mark.parametrize("mark", [",", ";", "\t", "|"])
@pytest.mark.parametrize("places", [(15,), (29,), tuple(range(15, 30))])
def test_a_row_that_lacks_a_cell_is_refused(tmp_path, places, mark):
    """Its temperature would be the force."""
    path = tmp_path / "test.csv"
    path.write_text(short(*places, mark=mark))
    with pytest.raises(BadInput, match=f"row {places[0] + 2}: 3 numbers under 4 columns; expected as many in each row"):
        read_recordings(path, Hints())


def test_a_shorter_table_beside_a_test_may_end(tmp_path):
    path = tmp_path / "test.csv"
    rows = [f"{i}.0,{i / 50:.2f},{i / 1.5:.2f}" + (f",,{i},9" if i < 4 else "") for i in range(30)]
    path.write_text("\n".join(["Time (s),Displacement (mm),Force (N),,Cycle,Peak", *rows, ""]))
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers.shape == (30, 3)


EVENTS = [[f"{i / 10}", f"{i / 50:.2f}", f"{i / 2}", "START" if i == 3 else ""] for i in range(9)]


@pytest.mark.parametrize("trimmed", [True, False])
def test_words_below_a_title_in_some_rows_do_no_harm(tmp_path, trimmed):
    path = tmp_path / "test.csv"
    rows = [",".join(row) for row in EVENTS]
    rows = [row.rstrip(",") for row in rows] if trimmed else rows
    path.write_text("\n".join(["Time_s,Disp_mm,Force_N,Event", *rows, ""]))
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers.shape == (9, 3)


def test_words_beside_a_sheet_do_no_harm(tmp_path):
    rows = [[i / 10, i / 50, i / 2, *(["slipped", None, "Smith"] if i == 3 else [])] for i in range(9)]
    path = write_workbook(tmp_path / "a.xlsx", A=[["Time (s)", "Disp (mm)", "Force (N)"], *rows])
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers.shape == (9, 3)


def test_a_mark_of_no_number_between_spaces_is_a_cell(tmp_path):
    path = tmp_path / "test.txt"
    rows = "0.0 0.1 0.1 0.5\n0.1 0.2 nan 1.5\n0.2 0.3 0.3 2.5\n0.3 0.4 - 3.5\n"
    path.write_text(f"Time_s Disp_mm Camera_mm Force_N\n{rows}")
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers[:, 2].tolist() == [0.5, 1.5, 2.5, 3.5]
