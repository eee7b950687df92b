"""The one sheet of a spreadsheet that a person chooses."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.exports import Reading, read_export
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_sheets import write_workbook

TITLES = ["Time [s]", "Extension [mm]", "Force [N]"]
SIZES = [["Length", 20, "mm"], ["Area", 4, "mm2"]]


def workbook(folder):
    sheets = {name: [TITLES, *([i, i, factor * i] for i in range(9))] for name, factor in (("raw", 1), ("copy", 2))}
    return write_workbook(folder / "a.xlsx", sizes=SIZES, **sheets)


@pytest.mark.parametrize(("sheet", "last"), [("raw", 8.0), ("copy", 16.0)])
def test_only_its_tables_are_read_and_the_others_still_tell_sizes(tmp_path, sheet, last):
    path = workbook(tmp_path)
    (found,) = read_recordings(path, Hints(sheet=sheet))
    assert found.numbers[-1].tolist() == [8.0, 8.0, last]
    told = inspect(path, Reading(hints=Hints(sheet=sheet))).content()
    assert (told["sheet"], told["specimens"], told["length_mm"], told["area_mm2"]) == (sheet, 1, 20.0, 4.0)
    assert read_export(path, reading=Reading(hints=Hints(sheet=sheet))).length_mm == 20.0
    assert len(read_recordings(path, Hints())) == 2


def test_a_name_that_no_sheet_has_is_refused(tmp_path):
    for sheet in ("Raw", ""):
        with pytest.raises(BadInput, match=rf"--sheet: '{sheet}' is no sheet; expected one of 'sizes', 'raw', 'copy'"):
            read_recordings(workbook(tmp_path), Hints(sheet=sheet))
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Extension (mm),Force (N)\n" + "0,0,0\n" * 3)
    for sheet in ("raw", ""):
        with pytest.raises(BadInput, match=r"is no sheet; expected no --sheet, as this file is no spreadsheet"):
            read_recordings(path, Hints(sheet=sheet))


def test_a_sheet_without_a_table_is_refused(tmp_path):
    with pytest.raises(BadInput, match=r"no sheet has a table of numbers|no column"):
        read_recordings(workbook(tmp_path), Hints(sheet="sizes"))


def test_sheets_with_other_titles_are_told_where_columns_are_named(tmp_path):
    """They may be further tests, whose columns nobody has named."""
    rows = [[i, i, i] for i in range(10)]
    sheets = {
        "one": [["t-s", "str", "Cauchy-kPa"], *rows],
        "two": [["x", "y", "z"], *rows],
        "few": [["u", "v", "w"], *rows[:9]],
    }
    path = write_workbook(tmp_path / "a.xlsx", **sheets)
    hints = Hints(displacement_column="str", displacement_unit="1", force_column="Cauchy-kPa")
    (found,) = read_recordings(path, hints)
    assert found.notes == (
        "the table in sheet 'two', row 1 has other titles and is left out; a test needs a file of its own, or --sheet",
    )
