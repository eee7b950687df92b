"""Spreadsheets as files: their sheets, archives and limits, and open documents."""

import subprocess
import sys
import tracemalloc
import zipfile
from xml.sax.saxutils import quoteattr

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data import sheet_reading, sheets
from sinew.tasks.data.exports import read_export
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sheets import read_sheets
from sinew.tasks.data.tables import MOST_BEFORE, read_tables
from tests.tasks.data.test_sheets import (
    STYLES,
    cell,
    ods_number,
    ods_row,
    ods_text,
    rewritten,
    rows_of,
    styled,
    write_ods,
    write_workbook,
)

RESULTS = [[None, "Fmax", "a0", "b0", "L0 SW"], [None, "N", "mm", "mm", "mm"], [None, 30, 0.9, 5.9, 20]]
VALUES = [["one"] * 3, ["Temps d'essai", "Course standard", "Force standard"], ["s", "mm", "N"]]
VALUES += [[0.5 * i, 0.01 * i, 3.25 * i] for i in range(5)]


def test_cells_are_texts(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", first=[["a", 1.5, None, 2], [None, "b & c"]], second=[[1e-7]])
    assert rows_of(path) == {
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


def test_a_number_that_somebody_wrote_beside_the_units_hides_no_other_sheet(tmp_path):
    beside = [[*VALUES[0]], [*VALUES[1], None, "20"], [*VALUES[2], None, 10.78], *VALUES[3:]]
    other = [*beside[:2], [*VALUES[2], None, 9.9], *VALUES[3:]]
    found = inspect(write_workbook(tmp_path / "a.xlsx", one=beside, two=other, three=VALUES)).content()
    assert found["specimens"] == 2
    assert [found[name]["column"] for name in ("time", "displacement", "force")] == VALUES[1]


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


@pytest.mark.parametrize(
    "value",
    ["1&#48;5", "1<!--x-->05", "1<![CDATA[05]]>", "1<?x y?>05", "1<x/>05", "<![CDATA[105]]>", "1</v><v>105",
     "1</v><f>2</f><v>105"],
)  # fmt: skip
@pytest.mark.parametrize("before", ["", '<c r="A1" t="str"><f>B1&amp;"x"</f><v>a &amp; b</v></c>'])
def test_a_number_that_the_library_would_cut_is_refused(tmp_path, before, value):
    """It reads 1 for 105."""
    path = write_workbook(tmp_path / "a.xlsx", one=f'<row r="1">{before}<c r="B1"><v>{value}</v></c></row>')
    with pytest.raises(BadInput, match=r"a cell whose number is written in parts|a cell with two values"):
        list(read_sheets(path))


@pytest.mark.parametrize("part", ["<v>", "</v>", "<v><x/>", "<c ", "<row ", "<v", "<f>1</f>", "a:v", "<x:"])
def test_a_long_cell_takes_no_time_with_the_square_of_its_length(tmp_path, part):
    path = write_workbook(tmp_path / "a.xlsx", one=f'<row r="1"><c r="A1">{part * (2**19 // len(part))}')
    with pytest.raises(BadInput) as refused:
        list(read_sheets(path))
    assert "60 s" not in str(refused.value)


def test_texts_of_formulas_are_read_whole(tmp_path):
    cells = '<c r="A1" t="str"><f>B1&amp;C1</f><v>Kraft &#38; Weg</v></c><c r="B1"><f>1&amp;05</f><v>105</v></c>'
    path = write_workbook(tmp_path / "a.xlsx", one=f'<row r="1">{cells}</row>')
    assert rows_of(path) == {"one": [("Kraft & Weg", "105")]}


def test_a_sheet_with_a_document_type_or_in_another_encoding_is_refused(tmp_path):
    for number, (change, problem) in enumerate(
        (
            (lambda text: text.replace(b"<worksheet", b'<!DOCTYPE x [<!ENTITY k "0">]><worksheet'), "a document type"),
            (lambda text: text.replace(b"<sheetData", b'<cols x="<"/><sheetData'), "a tag that is not closed"),
            (lambda text: text.decode().encode("utf-16"), "not in UTF-8"),
        )
    ):
        path = write_workbook(tmp_path / f"{number}.xlsx", one=[[1, 2]])
        rewritten(path, lambda name, text, change=change: (name, change(text) if "sheet1" in name else text))
        with pytest.raises(BadInput, match=problem):
            list(read_sheets(path))


def test_cells_of_all_sheets_count(tmp_path, monkeypatch):
    monkeypatch.setattr(sheet_reading, "MAX_CELLS", 20)
    path = write_workbook(tmp_path / "a.xlsx", one=[[1] * 15], two=[[1] * 15])
    with pytest.raises(sheet_reading.TooMuch, match="30 cells"):
        list(sheet_reading.lines_of(path.read_bytes()))
    monkeypatch.setattr(sheet_reading, "MAX_CELLS", 30)
    assert [len(line) for line in sheet_reading.lines_of(path.read_bytes())] == [4, 15, 4, 15]


def test_empty_rows_and_names_of_sheets_have_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(sheet_reading, "MOST_EMPTY", 3)
    path = write_workbook(tmp_path / "a.xlsx", one=[[1], *[[None]] * 3, [2], *[[None]] * 3, [3]])
    assert len(list(sheet_reading.lines_of(path.read_bytes()))) == 10
    path = write_workbook(tmp_path / "b.xlsx", one=[[1], *[[None]] * 4, [2]])
    with pytest.raises(sheet_reading.TooMuch, match="more than 3 consecutive empty rows"):
        list(sheet_reading.lines_of(path.read_bytes()))
    path = write_workbook(tmp_path / "c.xlsx", **{"s" * 31: [[1]]})
    assert len(list(sheet_reading.lines_of(path.read_bytes()))) == 2
    monkeypatch.setattr(sheet_reading, "LONGEST_NAME", 30)
    with pytest.raises(sheet_reading.TooMuch, match="a sheet with a name of 31 characters"):
        list(sheet_reading.lines_of(path.read_bytes()))


def test_a_text_in_every_cell_has_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(sheet_reading, "MAX_BYTES", 1000)
    path = write_workbook(tmp_path / "a.xlsx", one=[["a" * 100]] * 11)
    with pytest.raises(sheet_reading.TooMuch, match="more than 1,000 bytes of text"):
        list(sheet_reading.lines_of(path.read_bytes()))


def test_a_lower_limit_of_the_shell_stays(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", one=[[1.5]])
    script = f"ulimit -v 1000000 && exec {sys.executable} -I -m {sheet_reading.__name__}"
    done = subprocess.run(["bash", "-c", script], input=path.read_bytes(), capture_output=True, check=True)
    assert done.stdout.splitlines()[1:] == [b'["1.5"]', b"null"]


def test_texts_reach_this_process_as_they_are_and_are_kept_once(tmp_path):
    text = "µ\U0001f9b4" * 50
    path = write_workbook(tmp_path / "a.xlsx", one=[[text] * 40] * 500)
    tracemalloc.start()
    try:
        (sheet,) = read_sheets(path)
        rows = sheet.rows
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


TITLES = ("Time [s]", "Strain", "Force [N]")


def test_a_number_that_is_shown_behind_a_hash_is_one(tmp_path):
    table = f'<table:table table:name="one">{ods_row(ods_number(7, shown="#7"), ods_number(8))}</table:table>'
    assert rows_of(write_ods(tmp_path / "a.ods", table))["one"] == [("7", "8")]


def ods_test(name: str, *rows: str, more: str = "") -> str:
    """A sheet of an open document with a test of ten rows, and then ``rows``."""
    ten = [ods_row(ods_number(i), ods_number(0.01 * i), ods_number(3 * i)) for i in range(10)]
    titles = ods_row(*map(ods_text, TITLES))
    return f'<table:table table:name="{name}"{more}>{titles}{"".join((*ten, *rows))}</table:table>'


def test_numbers_of_an_open_document_whose_style_shows_them_as_percent_are_asked_about(tmp_path):
    more = ods_row(ods_number(10), ods_number(0.1, shown="10%"), ods_number(30))
    path = write_ods(tmp_path / "a.ods", ods_test("one", more))
    assert rows_of(path)["one"][0] == ("Time [s]", "Strain [partly percent]", "Force [N]")


@pytest.mark.parametrize(
    ("shown", "unit"),
    [("30 kN", "kN"), ("1.030,5 kN", "kN"), ("3.0E+01 kN", "kN"), ("30(kN)", "kN"), ("30", ""), ("3.0E+01", "")],
)
def test_a_unit_that_cells_of_an_open_document_show_is_told(tmp_path, shown, unit):
    more = ods_row(ods_number(10), ods_number(0.1), ods_number(30, shown=shown))
    title = rows_of(write_ods(tmp_path / "a.ods", ods_test("one", more)))["one"][0][2]
    assert (title == "Force [N]") is (unit == "")
    assert unit in title


def test_an_open_document_of_other_namespaces_is_refused(tmp_path):
    """The library goes by prefixes, whatever they stand for."""
    path = write_ods(tmp_path / "a.ods", ods_test("one"), other="http://openoffice.org/2000")
    with pytest.raises(BadInput, match="names of another kind of document; expected an open document"):
        list(read_sheets(path))


def test_a_number_below_the_last_row_of_a_sheet_is_not_lost_without_a_word(tmp_path):
    gap = "<table:table-row table:number-rows-repeated='1048576'><table:table-cell/></table:table-row>"
    path = write_ods(tmp_path / "a.ods", ods_test("one", gap, ods_row(*map(ods_number, (9, 9, 9)))))
    with pytest.raises(BadInput, match=r"a number in row 1,048,588; expected at most 1,048,576 rows"):
        list(read_sheets(path))


@pytest.mark.parametrize("shown", ["#DIV/0!", "Err:502", "Err :502", "Fehler:502", "#VALUE!", "N/A"])
def test_an_error_of_an_open_document_is_no_force_of_zero(tmp_path, shown):
    more = (
        ods_row(ods_number(10), ods_number(0.1), ods_number(0, shown=shown)),
        ods_row(*map(ods_number, (11, 0.11, 33))),
    )
    path = write_ods(tmp_path / "a.ods", ods_test("one", *more))
    assert rows_of(path)["one"][-2] == ("10", "0.1", "")
    with pytest.raises(BadInput, match=r"row 12, Force \[N\]: an empty cell"):
        read_recordings(path, Hints(displacement_unit="1"))


@pytest.mark.parametrize("shown", ["-", "- €", ""])
def test_a_zero_that_is_shown_as_a_dash_is_a_zero(tmp_path, shown):
    path = write_ods(
        tmp_path / "a.ods", ods_test("one", ods_row(ods_number(10), ods_number(0.1), ods_number(0, shown=shown)))
    )
    assert rows_of(path)["one"][-1][0::2] == ("10", "0")


def test_rows_that_a_few_bytes_repeat_have_a_limit(tmp_path):
    numbers = [ods_number(number) for number in (1, 2, 3)]
    path = write_ods(tmp_path / "a.ods", ods_test("one", ods_row(*numbers, many=400_000)))
    with pytest.raises(BadInput, match="400,000 rows that are the same; expected at most 1,000,000 cells of them"):
        list(read_sheets(path))
    few = write_ods(tmp_path / "a.ods", ods_test("one", ods_row(*numbers, many=40)))
    assert rows_of(few)["one"].count(("1", "2", "3")) == 40


@pytest.mark.parametrize(
    ("saved", "read"), [("PT24H00M00S", "24:00:00"), ("PT100H02M03.5S", "100:02:03.500000"), ("PT12S", "0:00:12")]
)
def test_durations_beyond_a_day_are_clock_times(tmp_path, saved, read):
    cell = (
        f'<table:table-cell office:value-type="time" office:time-value="{saved}"><text:p>x</text:p></table:table-cell>'
    )
    path = write_ods(tmp_path / "a.ods", f'<table:table table:name="one">{ods_row(cell, ods_text("PT"))}</table:table>')
    assert rows_of(path)["one"] == [(read, "PT")]


@pytest.mark.parametrize("damaged", ["backslashes", "bytes in front", "an open document in it", "no workbook"])
def test_an_archive_whose_formats_are_not_found_is_refused_or_read_as_shown(tmp_path, damaged):
    """The library reads all of these but the last; without formats, strains were a hundred times too small."""
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1))
    if damaged == "backslashes":
        rewritten(path, lambda name, content: (name.replace("/", "\\"), content))
        assert rows_of(path)["one"][-1] == ("4", "9.97", "12")
        return
    if damaged == "bytes in front":
        path.write_bytes(b"#!" + path.read_bytes())
    elif damaged == "no workbook":
        rewritten(path, lambda name, content: (name.replace("workbook.xml", "book.xml"), content))
    else:
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("content.xml", "<a/>")
    with pytest.raises(
        BadInput, match=r"a\.xlsx: not a spreadsheet that can be read \((its first bytes|an archive with)"
    ):
        list(read_sheets(path))


def test_a_sheet_that_is_not_found_is_not_left_out(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1))
    rewritten(path, lambda name, content: (name, content.replace(b"worksheets/sheet1", b"worksheets/sheet2")))
    with pytest.raises(BadInput, match="one of its sheets is not found"):
        list(read_sheets(path))


SIZES = f"<table:table-row>{ods_text('Length')}{ods_number(99)}{ods_text('mm')}</table:table-row>"
STYLE_HIDDEN = (
    '<office:automatic-styles><style:style style:name="h" style:family="table">'
    '<style:table-properties table:display="false"/></style:style></office:automatic-styles>'
)


def test_a_hidden_sheet_tells_no_sizes_and_its_tests_are_named_as_hidden(tmp_path):
    of_sizes = f'<table:table table:name="old"{{}}>{SIZES}</table:table>'
    hidden = ' table:style-name="h"'
    for more, tells in (("", True), (hidden, False)):
        path = write_ods(tmp_path / "a.ods", of_sizes.format(more), ods_test("new"), styles=STYLE_HIDDEN)
        (recording,) = read_recordings(path, Hints(displacement_unit="1"))
        assert ("length" in recording.sizes) == tells
        assert recording.notes == ()
    path = write_ods(tmp_path / "a.ods", ods_test("old", more=hidden), ods_test("new"), styles=STYLE_HIDDEN)
    assert [one.notes for one in read_recordings(path, Hints(displacement_unit="1"))] == [
        ("its sheet 'old' is hidden",),
        (),
    ]


def test_hidden_rows_are_said(tmp_path):
    more = ods_row(*map(ods_number, (10, 0.1, 900)), more=' table:visibility="filter"')
    (recording,) = read_recordings(write_ods(tmp_path / "a.ods", ods_test("one", more)), Hints(displacement_unit="1"))
    assert recording.notes == ("hidden in the spreadsheet, but read: 1 of its 11 rows",)
    rows = "".join(
        f'<row r="{i + 2}"{" hidden=" + quoteattr("1") if i in (3, 4) else ""}>{cell(i)}{cell(0.01 * i)}{cell(i)}</row>'
        for i in range(8)
    )
    head = f'<row r="1">{"".join(map(cell, TITLES))}</row>'
    (recording,) = read_recordings(write_workbook(tmp_path / "a.xlsx", one=head + rows), Hints(displacement_unit="1"))
    assert recording.notes == ("hidden in the spreadsheet, but read: 2 of its 8 rows",)


def test_numbers_without_titles_behind_an_empty_column_are_none_of_the_test(tmp_path):
    titles = ["Time (s)", "Displacement (mm)", "Force (N)"]
    rows = [[i, i / 10, 2 * i] for i in range(6)]
    for beside in ([None, 4.2, 0.3], [None, None, 4.2, 0.3, 7, 8]):
        path = write_workbook(tmp_path / "a.xlsx", A=[titles, *([*row, *beside] for row in rows)])
        (one,) = read_recordings(path, Hints())
        assert one.numbers.tolist() == rows
    path = write_workbook(tmp_path / "a.xlsx", A=[titles, *([*row, 4.2, 0.3, 7] for row in rows)])
    with pytest.raises(BadInput, match="3 names above 6 columns of numbers"):
        read_recordings(path, Hints())
