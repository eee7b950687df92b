"""What a binary workbook of Excel shows, where that is not what it holds, what it hides, and what is wrong in it."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.binary_excel_formats import FEWEST, records
from sinew.tasks.data.sheets import read_sheets
from tests.tasks.data.binary_workbooks import write_xlsb, xlsb_cell, xlsb_record, xlsb_row, xlsb_sheet
from tests.tasks.data.test_sheets import rows_of

TITLES = ["Time [s]", "Strain", "Force [N]"]


def rows(style: int = 0, hidden: tuple[int, ...] = ()) -> bytes:
    """Titles and numbers; the force has this style."""
    lines = [xlsb_row(0, b"".join(xlsb_cell(at, title) for at, title in enumerate(TITLES)))]
    for i in range(1, 6):
        cells = xlsb_cell(0, i) + xlsb_cell(1, i / 100) + xlsb_cell(2, 10.0 * i, style)
        lines.append(xlsb_row(i, cells, hidden=i in hidden))
    return b"".join(lines)


@pytest.mark.parametrize(
    ("code", "title", "first"),
    [
        ("0.00", "Force [N]", "10"),
        ("0.00,", "Force [shown in thousands]", "10"),
        ('0.00" kN"', "Force [shown with kN]", "10"),
        ("0.00%", "Force [N] [%]", "1000"),
    ],
)
def test_numbers_that_are_shown_otherwise_are_asked_about(tmp_path, code, title, first):
    path = write_xlsb(tmp_path / "a.xlsb", xlsb_sheet(rows(style=2)), ("0.0", code))
    found = rows_of(path)["one"]
    assert (found[0][2], found[1]) == (title, ("1", "0.01", first))


def test_hidden_rows_and_columns_are_named(tmp_path):
    columns = xlsb_record(60, struct.pack("<IIIIH", 1, 2, 2000, 0, 1)) + xlsb_record(
        60, struct.pack("<IIIIH", 5, 5, 9, 0, 0)
    )
    path = write_xlsb(tmp_path / "a.xlsb", xlsb_sheet(rows(hidden=(2, 3)), columns))
    (sheet,) = read_sheets(path)
    assert (sheet.hidden.rows, sheet.hidden.columns) == ({3, 4}, {2, 3})


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (xlsb_row(5, xlsb_cell(2, 7.0)), "two rows 6, or one out of order"),
        (xlsb_row(6, xlsb_cell(2, 7.0) + xlsb_cell(2, 8.0)), "two cells in row 7, column 3, or one out of order"),
        (xlsb_row(6, xlsb_record(2, struct.pack("<II", 2, 0))), "a record that is cut short"),
        (xlsb_row(6, xlsb_record(16, struct.pack("<Id", 0, 7.0))), "cells without their columns"),
        (xlsb_record(146) + xlsb_record(145) + xlsb_row(6, xlsb_cell(2, 7.0)), "a sheet with 2 tables of cells"),
    ],
)
def test_cells_that_excel_does_not_write_so_are_refused(tmp_path, more, problem):
    """The library that reads the numbers takes the last of two, and memory of something else for what is missing."""
    path = write_xlsb(tmp_path / "a.xlsb", xlsb_sheet(rows() + more))
    with pytest.raises(BadInput, match=problem):
        list(read_sheets(path))


def test_two_parts_of_one_name_are_refused(tmp_path):
    more = '<Relationship Id="r1" Type="x/worksheet" Target="worksheets/sheet2.bin"/>'
    path = write_xlsb(tmp_path / "a.xlsb", xlsb_sheet(rows()), relations=more)
    with pytest.raises(BadInput, match="two parts with the same name"):
        list(read_sheets(path))


@given(st.lists(st.tuples(st.integers(63, 2**14 - 1), st.binary(max_size=300)), max_size=5))
def test_records_are_read_as_they_are_written(written):
    written = [(kind, content) for kind, content in written if len(content) >= FEWEST.get(kind, 0)]
    assert list(records(b"".join(xlsb_record(*one) for one in written))) == written


@given(st.binary(max_size=200))
def test_any_bytes_are_records_or_refused(content):
    try:
        found = list(records(content))
    except ValueError:
        return
    assert sum(len(one) for _, one in found) <= len(content)
