"""What an old workbook of Excel shows, where that is not what it holds, and what it hides."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.sheets import read_sheets
from tests.tasks.data.binary_workbooks import write_xls, xls_stream
from tests.tasks.data.test_sheets import rows_of

TITLES = ["Time [s]", "Strain", "Force [N]"]
ROWS = [TITLES, *([i, i / 100, 10.0 * i] for i in range(5))]


def test_numbers_and_texts_are_read_as_they_are(tmp_path):
    path = write_xls(tmp_path / "a.xls", {"Workbook": xls_stream(ROWS)})
    assert rows_of(path)["one"][:3] == [tuple(TITLES), ("0", "0", "0"), ("1", "0.01", "10")]


@pytest.mark.parametrize(
    ("code", "title", "second"),
    [
        ("0.00", "Force [N]", "10"),
        ("0.00,", "Force [shown in thousands]", "10"),
        ('0.00" kN"', "Force [shown with kN]", "10"),
        ('"-"0.00', "Force [shown as other numbers]", "10"),
        ("0.00%", "Force [N] [%]", "1000"),
    ],
)
def test_numbers_that_are_shown_otherwise_are_asked_about(tmp_path, code, title, second):
    path = write_xls(tmp_path / "a.xls", {"Workbook": xls_stream(ROWS, ("General", "0.0", code))})
    rows = rows_of(path)["one"]
    assert (rows[0][2], rows[2][2]) == (title, second)


def test_hidden_rows_and_columns_are_named(tmp_path):
    path = write_xls(tmp_path / "a.xls", {"Workbook": xls_stream(ROWS, hidden_rows=[2, 4], hidden=[1])})
    (sheet,) = read_sheets(path)
    assert (sheet.hidden.rows, sheet.hidden.columns) == ({3, 5}, {2})


@pytest.mark.parametrize(
    ("streams", "problem"),
    [
        (("Workbook", "WORKBOOK"), "several workbooks in one file"),
        (("Book", "book"), "several workbooks in one file"),
        (("EncryptedPackage",), "locked by a password"),
        (("Notes",), "no workbook in it"),
    ],
)
def test_a_file_with_another_workbook_or_none_is_refused(tmp_path, streams, problem):
    """Excel opens that in the root; the library that reads the numbers the first of that name."""
    path = write_xls(tmp_path / "a.xls", {name: xls_stream(ROWS) for name in streams})
    with pytest.raises(BadInput, match=problem):
        list(read_sheets(path))


def test_a_workbook_of_1995_beside_that_of_1997_is_none_of_its_own(tmp_path):
    path = write_xls(tmp_path / "a.xls", {"Workbook": xls_stream(ROWS), "Book": xls_stream(ROWS)})
    assert rows_of(path)["one"][2][2] == "10"


def test_formats_that_cannot_be_read_are_refused(tmp_path):
    stream = xls_stream(ROWS)
    path = write_xls(tmp_path / "a.xls", {"Workbook": stream.replace(b"\xe0\0\x14\0", b"\xe0\0\xff\x7f", 1)})
    with pytest.raises(
        BadInput, match=r"the formats of its cells cannot be read \(.+\); expected the same saved as \.xlsx"
    ):
        list(read_sheets(path))
