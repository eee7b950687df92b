"""What an open document shows, where that is not what it holds, and what it hides."""

import zipfile

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sheets import read_sheets
from tests.tasks.data.test_sheets import ods_number, ods_row, ods_text, rows_of, write_ods
from tests.tasks.data.test_workbooks import TITLES, ods_test

NUMBERS = "urn:oasis:names:tc:opendocument:xmlns:datastyle:1.0"


@pytest.mark.parametrize("factor", ["1000", "1"])
def test_a_factor_of_a_style_with_a_name_is_refused(tmp_path, factor):
    path = write_ods(tmp_path / "a.ods", ods_test("one"))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("styles.xml", f'<n:number xmlns:n="{NUMBERS}" n:display-factor="{factor}"/>')
    if factor == "1":
        assert rows_of(path)["one"][-1] == ("9", "0.09", "27")
        return
    with pytest.raises(BadInput, match="numbers that are shown divided by a factor; expected numbers that are shown"):
        list(read_sheets(path))


@pytest.mark.parametrize(
    ("shown", "told"), [("-30", True), ("0.030", True), ("30.0", False), ("30,0", False), ("", False)]
)
def test_numbers_that_are_shown_as_others_are_asked_about(tmp_path, shown, told):
    path = write_ods(
        tmp_path / "a.ods", ods_test("one", ods_row(*map(ods_number, (10, 0.1)), ods_number(30, shown=shown)))
    )
    assert rows_of(path)["one"][0][2] == ("Force [shown as other numbers]" if told else "Force [N]")


def with_columns(columns: str, *more: str) -> str:
    return ods_test("one", *more).replace("<table:table-row", f"{columns}<table:table-row", 1)


@pytest.mark.parametrize(
    "columns",
    [
        '<table:table-column table:number-columns-repeated="2"/><table:table-column table:visibility="collapse"/>',
        '<table:table-column table:number-columns-repeated="2"/><table:table-column-group table:display="false">'
        "<table:table-column/></table:table-column-group>",
    ],
)
def test_hidden_columns_are_said(tmp_path, columns):
    path = write_ods(tmp_path / "a.ods", with_columns(columns))
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.notes == (f"hidden in the spreadsheet, but read: column '{TITLES[2]}'",)
    path = write_ods(tmp_path / "a.ods", with_columns(columns.replace("collapse", "visible").replace("false", "true")))
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.notes == ()


def test_rows_of_a_hidden_group_are_said(tmp_path):
    rows = "".join(ods_row(*map(ods_number, (i, 0.01 * i, 3 * i))) for i in (10, 11))
    group = f'<table:table-row-group table:display="false">{rows}</table:table-row-group>'
    path = write_ods(tmp_path / "a.ods", ods_test("one", group, ods_row(*map(ods_number, (12, 0.12, 36)))))
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.notes == ("hidden in the spreadsheet, but read: 2 of its 13 rows",)


def test_numbers_below_a_merged_cell_are_hidden(tmp_path):
    covered = ods_number(30).replace("table:table-cell", "table:covered-table-cell")
    path = write_ods(tmp_path / "a.ods", ods_test("one", ods_row(*map(ods_number, (10, 0.1)), covered)))
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.notes == ("hidden in the spreadsheet, but read: 1 of its 11 rows",)
    empty = ods_row(ods_text("of one test"), "<table:covered-table-cell/>")
    path = write_ods(tmp_path / "a.ods", ods_test("one").replace("<table:table-row", f"{empty}<table:table-row", 1))
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.notes == ()
