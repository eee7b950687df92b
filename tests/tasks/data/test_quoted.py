"""Cells and lines in quotation marks that the csv module does not take."""

import csv
import io

from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.quoted import unquoted, unwrapped
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_sheets import write_workbook


def saved(*cells: str) -> str:
    text = io.StringIO()
    csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="").writerow(cells)
    return text.getvalue()


@given(st.lists(st.text(alphabet='ab",; 0', max_size=5), min_size=2, max_size=4))
def test_a_line_that_was_saved_as_a_cell_is_that_line(cells):
    line = saved(*cells)
    assert unwrapped(saved(line)) == line
    assert unwrapped(line) == line, "several cells are none"


def test_lines_saved_as_cells_are_read(tmp_path):
    path = tmp_path / "a.csv"
    rows = [saved(saved(*(f"{x:.5f}" for x in (i, 0.1 * i, 3 * i)))) for i in range(5)]
    path.write_text("\n".join([saved('Specimen : Length,"20",mm'), "Time,Extension,Load", "(s),(mm),(N)", *rows]))
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers[-1].tolist() == [4.0, 0.4, 12.0]
    assert recording.sizes["length"].mm == 20.0


def test_quotation_marks_behind_spaces_are_none_of_a_cell(tmp_path):
    assert [unquoted(cell) for cell in (' "mm"', '""', '"', '5"', ' "a b" ', "mm")] == [
        "mm",
        "",
        '"',
        '5"',
        "a b",
        "mm",
    ]
    path = tmp_path / "a.csv"
    path.write_text('_Load, _Time, SlackExt\nN, "s", "mm"\n' + "".join(f"{3 * i}, {i}, {i / 10}\n" for i in range(5)))
    found = inspect(path).content()
    assert [found[name]["unit"] for name in ("time", "displacement", "force")] == ["s", "mm", "N"]
    rows = [[3 * i, i, i / 10] for i in range(5)]
    path = write_workbook(tmp_path / "a.xlsx", one=[["_Load", "_Time", "SlackExt"], ["N", ' "s"', ' "mm"'], *rows])
    found = inspect(path).content()
    assert [found[name]["unit"] for name in ("time", "displacement", "force")] == ["s", "mm", "N"]
