"""What a workbook of Excel shows, where that is not what it holds, and what it hides."""

import shutil
import zipfile
from contextlib import nullcontext
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data import excel_formats
from sinew.tasks.data.excel_formats import looks_of_xlsx
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sheet_look import TooMuch
from sinew.tasks.data.sheets import read_sheets
from tests.tasks.data.test_sheets import MAIN, STYLES, cell, of_style, rewritten, rows_of, styled, write_workbook


def test_a_format_that_depends_on_values_is_asked_about(tmp_path):
    rule = '<conditionalFormatting sqref="A1 C2:C9"><cfRule type="expression" dxfId="1"/></conditionalFormatting>'
    formats = ('<numFmts><numFmt numFmtId="164" formatCode="0.0"/></numFmts>', '<numFmt numFmtId="1" formatCode="{}"/>')
    for code, title in (("0.00,", "Force [shown in thousands]"), ("0.0", "Force [N]")):
        dxfs = f"<dxfs><dxf/><dxf>{formats[1].format(code)}</dxf></dxfs>"
        path = write_workbook(tmp_path / "a.xlsx", f'<styleSheet xmlns="{MAIN}">{dxfs}</styleSheet>', one=styled(0))
        rewritten(path, lambda name, content: (name, content.replace(b"</sheetData>", b"</sheetData>" + rule.encode())))
        assert rows_of(path)["one"][0] == ("Time [s]", "Strain [%]", title)


@pytest.mark.parametrize(
    ("number", "code", "of", "title"),
    [(174, "0.0,", "#,##0.0", "Strain [%]"), (172, "0.0", "0.000,", "Strain [shown in thousands]")],
)
def test_a_format_of_another_rule_is_none_of_a_style(tmp_path, number, code, of, title):
    """Numbers of formats are those of their own list."""
    rules = f'<dxfs><dxf><numFmt numFmtId="{number}" formatCode="{code}"/></dxf></dxfs>'
    styles = STYLES.replace("<cellStyleXfs>", f"{rules}<cellStyleXfs>")
    path = write_workbook(tmp_path / "a.xlsx", styles, one=styled(of_style(of)))
    assert rows_of(path)["one"][0][1] == title


def test_formats_without_end_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(excel_formats, "MOST_FORMATS", 90)
    one = '<numFmt numFmtId="164" formatCode="0.0"/>'
    for count, ends in ((20, nullcontext()), (50, pytest.raises(TooMuch, match="more than 90 formats"))):
        styles = STYLES.replace("<numFmts>", f"<numFmts>{one * count}")
        with zipfile.ZipFile(write_workbook(tmp_path / "a.xlsx", styles, one=styled(0))) as archive, ends:
            looks_of_xlsx(archive, {name.lower(): name for name in archive.namelist()})


@pytest.mark.parametrize("code", ['"-"0.0', '0.0"00"'])
def test_numbers_that_are_shown_as_others_are_asked_about(tmp_path, code):
    styles = STYLES.replace("0.000,", code.replace('"', "&quot;"))
    path = write_workbook(tmp_path / "a.xlsx", styles, one=styled(of_style("0.000,")))
    assert rows_of(path)["one"][0][1] == "Strain [shown as other numbers]"
    with pytest.raises(BadInput, match="unit 'shown as other numbers' of the strain is not known"):
        read_recordings(path, Hints())


def test_the_workbook_is_the_one_that_the_archive_names(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", one=styled(0))
    assert rows_of(path)["one"][-1] == ("4", "0.0997", "12")
    named(shutil.copy(path, tmp_path / "b.xlsx"), "/XL/workbook.xml")
    assert rows_of(tmp_path / "b.xlsx")["one"][-1] == ("4", "0.0997", "12")
    named(path, "xl/worksheets/sheet1.xml")
    words = (
        r"a workbook in its part xl/worksheets/sheet1\.xml; expected a spreadsheet as Excel saves it, with the workbook"
    )
    with pytest.raises(BadInput, match=words):
        list(read_sheets(path))
    named(path, "xl/nowhere.xml")
    with pytest.raises(BadInput, match=r"an archive with xl/workbook\.xml"):
        list(read_sheets(path))


def named(path: Path | str, target: str) -> None:
    """Name another workbook in an archive."""
    known: list[bytes] = []

    def change(name, content):
        if name == "_rels/.rels":
            known.append(content)
            start = content.index(b'Target="') + 8
            content = content[:start] + target.encode() + content[content.index(b'"', start) :]
        return name, content

    rewritten(Path(path), change)
    assert known


@pytest.mark.parametrize(
    "columns",
    ['<col min="3" max="3" hidden="1"/>', '<col min="1" max="1" width="9"/><col min="3" max="16384" width="0"/>'],
)
def test_hidden_columns_are_said(tmp_path, columns):
    path = write_workbook(tmp_path / "a.xlsx", one=styled(0))
    rewritten(
        path,
        lambda name, content: (name, content.replace(b"<sheetData>", f"<cols>{columns}</cols><sheetData>".encode())),
    )
    (recording,) = read_recordings(path, Hints())
    assert recording.notes == ("hidden in the spreadsheet, but read: column 'Force [N]'",)


def test_rows_without_a_height_are_hidden(tmp_path):
    rows = "".join(
        f'<row r="{i + 2}"{" ht=" + chr(34) + "0" + chr(34) if i == 3 else " ht=" + chr(34) + "0.5" + chr(34)}>'
        f"{cell(i)}{cell(0.01 * i)}{cell(i)}</row>"
        for i in range(8)
    )
    head = f'<row r="1">{"".join(map(cell, ("Time [s]", "Strain [%]", "Force [N]")))}</row>'
    (recording,) = read_recordings(write_workbook(tmp_path / "a.xlsx", one=head + rows), Hints())
    assert recording.notes == ("hidden in the spreadsheet, but read: 1 of its 8 rows",)


def test_a_cell_that_is_there_twice_is_refused_without_styles_too(tmp_path):
    rows = styled(0)
    at = rows.index('<c r="C3"')
    path = write_workbook(tmp_path / "a.xlsx", one=rows[:at] + '<c r="B3"><v>25</v></c>' + rows[at:])
    with pytest.raises(BadInput, match="two cells B3; expected one"):
        list(read_sheets(path))


def test_cells_out_of_order_are_read_where_none_is_there_twice(tmp_path):
    rows = styled(0).split("</row>")
    path = write_workbook(tmp_path / "a.xlsx", one="</row>".join([rows[0], rows[2], rows[1], *rows[3:]]))
    in_order = write_workbook(tmp_path / "b.xlsx", one=styled(0))
    assert rows_of(path) == rows_of(in_order)
    later = "</row>".join([rows[0], rows[2], rows[1], *rows[3:-1], rows[3], rows[-1]])
    with pytest.raises(BadInput, match="two cells A4; expected one"):
        list(read_sheets(write_workbook(tmp_path / "a.xlsx", one=later)))
