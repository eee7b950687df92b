"""Spreadsheets: their cells as texts, and files that are refused."""

import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path
from xml.sax.saxutils import escape

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data import sheet_reading, sheets
from sinew.tasks.data.exports import read_export
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.sheets import read_sheets
from sinew.tasks.data.tables import MOST_BEFORE, read_tables

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"


def write_workbook(path: Path, **tables: list[list[object]] | str) -> Path:
    """A workbook with a sheet for each of ``tables``; rows of numbers, texts and None, or the XML of all rows."""
    names = list(tables)
    sheet_list = "".join(f'<sheet name="{n}" sheetId="{i}" r:id="r{i}"/>' for i, n in enumerate(names, start=1))
    links = "".join(
        f'<Relationship Id="r{i}" Type="{OFFICE}/worksheet" Target="worksheets/sheet{i}.xml"/>'
        for i in range(1, len(names) + 1)
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", f'<Types xmlns="{PACKAGE}/content-types"/>')
        archive.writestr(
            "_rels/.rels",
            f'<Relationships xmlns="{PACKAGE}/relationships"><Relationship Id="r0" Type="{OFFICE}/officeDocument" '
            'Target="xl/workbook.xml"/></Relationships>',
        )
        archive.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{MAIN}" xmlns:r="{OFFICE}"><sheets>{sheet_list}</sheets></workbook>'
        )
        archive.writestr(
            "xl/_rels/workbook.xml.rels", f'<Relationships xmlns="{PACKAGE}/relationships">{links}</Relationships>'
        )
        for i, name in enumerate(names, start=1):
            table = tables[name]
            rows = (
                table if isinstance(table, str) else "".join(f"<row>{''.join(map(cell, row))}</row>" for row in table)
            )
            archive.writestr(
                f"xl/worksheets/sheet{i}.xml",
                f'<worksheet xmlns="{MAIN}"><sheetData>{rows}</sheetData></worksheet>',
            )
    return path


def cell(value: object) -> str:
    if value is None:
        return "<c/>"
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    return f"<c><v>{value!r}</v></c>"


RESULTS = [[None, "Fmax", "a0", "b0", "L0 SW"], [None, "N", "mm", "mm", "mm"], [None, 30, 0.9, 5.9, 20]]
VALUES = [["one"] * 3, ["Temps d'essai", "Course standard", "Force standard"], ["s", "mm", "N"]]
VALUES += [[0.5 * i, 0.01 * i, 3.25 * i] for i in range(5)]


def test_cells_are_texts(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", first=[["a", 1.5, None, 2], [None, "b & c"]], second=[[1e-7]])
    assert dict(read_sheets(path)) == {
        "first": [("a", "1.5", "", "2"), ("", "b & c", "", "")],
        "second": [("1e-07",)],
    }


def test_a_test_in_a_workbook_and_its_sizes_in_another_sheet(tmp_path):
    path = write_workbook(tmp_path / "tail.xlsx", Results=RESULTS, Values=VALUES)
    specimen = read_export(path)
    assert (specimen.length_mm, specimen.width_mm, specimen.thickness_mm) == (20.0, 5.9, 0.9)
    (curve,) = specimen.curves
    assert curve.protocol.time_s.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert curve.protocol.displacement_mm.tolist() == [0.01 * i for i in range(5)]
    assert curve.force_N.tolist() == [3.25 * i for i in range(5)]
    found = inspect(path).content()
    assert (found["sheet"], found["specimens"], found["ask"]) == ("Values", 1, [])


def test_each_sheet_may_hold_a_test(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", one=VALUES, two=VALUES)
    assert inspect(path).specimens == 2


@pytest.mark.parametrize("name", ["a.xlsx", "a.xls", "a.ods", "a.XLSB"])
def test_what_is_no_spreadsheet_is_one_line(tmp_path, name):
    for content in (b"time,force\n1,2\n", b"PK\x03\x04 no archive", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(BadInput, match="not a spreadsheet that can be read") as error:
            list(read_sheets(path))
        assert "\n" not in str(error.value)


def test_a_workbook_that_unpacks_to_gigabytes_is_refused_unread(tmp_path, monkeypatch):
    path = write_workbook(tmp_path / "a.xlsx", one=VALUES)
    monkeypatch.setattr(sheets, "MAX_UNPACKED_BYTES", 1000)
    with pytest.raises(BadInput, match="MB when unpacked"):
        list(read_sheets(path))


def test_a_workbook_without_numbers(tmp_path):
    with pytest.raises(BadInput, match="no sheet has a table of numbers; expected three columns or more: time, "):
        inspect(write_workbook(tmp_path / "a.xlsx", one=[["a", "b"], ["c", "d"]]))


def far_apart(last: str) -> str:
    """The rows of a sheet with two cells, the second of which is ``last``."""
    number = last.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    return f'<row r="1"><c r="A1"><v>1</v></c></row><row r="{number}"><c r="{last}"><v>2</v></c></row>'


@pytest.mark.parametrize(
    ("last", "problem"),
    [("XFD1048576", "takes more than 2 GB"), ("Z1048576", "27,262,976 cells up to the last one that is not empty")],
)
def test_two_cells_far_apart_are_refused_in_one_line(tmp_path, last, problem):
    """The library asks for 512 GB for the rows between them, and ends its process when it does not get them."""
    path = write_workbook(tmp_path / "a.xlsx", one=far_apart(last))
    with pytest.raises(BadInput, match=problem):
        list(read_sheets(path))


def test_cells_of_all_sheets_count(tmp_path, monkeypatch):
    monkeypatch.setattr(sheet_reading, "MAX_CELLS", 20)
    path = write_workbook(tmp_path / "a.xlsx", one=[[1] * 15], two=[[1] * 15])
    with pytest.raises(sheet_reading.TooMuch, match="30 cells"):
        list(sheet_reading.lines_of(path.read_bytes()))
    monkeypatch.setattr(sheet_reading, "MAX_CELLS", 30)
    assert [len(line) for line in sheet_reading.lines_of(path.read_bytes())] == [3, 15, 3, 15]


def test_a_text_in_every_cell_has_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(sheet_reading, "MAX_BYTES", 1000)
    path = write_workbook(tmp_path / "a.xlsx", one=[["a" * 100]] * 11)
    with pytest.raises(sheet_reading.TooMuch, match="more than 1,000 bytes of text"):
        list(sheet_reading.lines_of(path.read_bytes()))


def test_a_lower_limit_of_the_shell_stays(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", one=[[1.5]])
    script = f"ulimit -v 1000000 && exec {sys.executable} -I {sheet_reading.__file__}"
    done = subprocess.run(["bash", "-c", script], input=path.read_bytes(), capture_output=True, check=True)
    assert done.stdout.splitlines() == [b'"one"', b'["1.5"]', b"null"]


def test_texts_reach_this_process_as_they_are_and_are_kept_once(tmp_path):
    text = "µ\U0001f9b4" * 50
    path = write_workbook(tmp_path / "a.xlsx", one=[[text] * 40] * 500)
    tracemalloc.start()
    try:
        ((_, rows),) = read_sheets(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert {cell for row in rows for cell in row} == {text}
    assert peak < 2**22, "20,000 of them would take 8 MB, and escaped in JSON 18"


def test_an_archive_of_which_python_knows_nothing_is_one_line(tmp_path):
    newer = zipfile.ZipInfo("a")
    newer.extract_version = 64
    with zipfile.ZipFile(tmp_path / "newer.xlsx", "w") as archive:
        archive.writestr(newer, "")
    with zipfile.ZipFile(tmp_path / "names.xlsx", "w") as archive:
        archive.writestr("\N{LATIN SMALL LETTER E WITH ACUTE}", "")
    content = (tmp_path / "names.xlsx").read_bytes().replace(b"\xc3\xa9", b"\xff\xff")
    (tmp_path / "names.xlsx").write_bytes(content)
    for name in ("newer.xlsx", "names.xlsx"):
        with pytest.raises(BadInput, match="not a spreadsheet that can be read"):
            list(read_sheets(tmp_path / name))


def test_an_archive_of_very_many_files_is_refused_before_they_are_listed(tmp_path, monkeypatch):
    path = write_workbook(tmp_path / "a.xlsx", one=VALUES)
    monkeypatch.setattr(sheets, "MAX_MEMBERS", 4)
    monkeypatch.setattr(sheets.zipfile, "ZipFile", lambda _: pytest.fail("its files are listed"))
    with pytest.raises(BadInput, match="an archive of 5 files; expected at most 4"):
        list(read_sheets(path))


def test_sheets_have_a_limit(tmp_path, monkeypatch):
    path = write_workbook(tmp_path / "a.xlsx", one=VALUES, two=VALUES, three=VALUES)
    monkeypatch.setattr(sheet_reading, "MAX_SHEETS", 2)
    with pytest.raises(sheet_reading.TooMuch, match="3 sheets") as error:
        list(sheet_reading.lines_of(path.read_bytes()))
    assert error.value.expected == "at most 2 sheets"


def test_of_very_many_sheets_a_table_keeps_the_first_and_the_last_rows(tmp_path):
    """Each table has the sheets before it above it, where sizes may stand."""
    words = {f"s{number:03d}": [[f"size {number}"]] * 450 for number in range(14)}
    (table,) = read_tables(write_workbook(tmp_path / "a.xlsx", **words, last=VALUES))
    above = [row[0] for row in table.header[: table.own]]
    assert len(above) == MOST_BEFORE
    assert (above[0], above[-1]) == ("size 0", "size 13")
