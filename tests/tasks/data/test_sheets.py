"""Spreadsheets: their cells as texts, and files that are refused."""

import zipfile
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sheets import is_sheet, read_sheets

MAIN = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"


def rows_of(path: Path) -> dict[str, list[tuple[str, ...]]]:
    """The rows of each sheet, by its name."""
    return {sheet.name: sheet.rows for sheet in read_sheets(path)}


def write_workbook(path: Path, styles: str = "", **tables: list[list[object]] | str) -> Path:
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
        if styles:
            archive.writestr("xl/styles.xml", styles)
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


def ods_row(*cells: str, many: int = 1, more: str = "") -> str:
    return f'<table:table-row table:number-rows-repeated="{many}"{more}>{"".join(cells)}</table:table-row>'


def ods_number(value: object, kind: str = "float", many: int = 1, shown: str | None = None) -> str:
    about = f'office:value-type="{kind}" office:value="{value}" table:number-columns-repeated="{many}"'
    return f"<table:table-cell {about}><text:p>{value if shown is None else shown}</text:p></table:table-cell>"


def ods_text(words: str) -> str:
    return f'<table:table-cell office:value-type="string"><text:p>{words}</text:p></table:table-cell>'


def write_ods(path: Path, *tables: str, styles: str = "", other: str = "") -> Path:
    """An open document with ``tables``, each the XML of one; ``other``: begin of its namespaces."""
    names = "".join(
        f' xmlns:{name}="{other or "urn:oasis:names:tc:opendocument:xmlns:"}{name}:1.0"'
        for name in ("office", "table", "text", "style")
    )
    body = f"<office:body><office:spreadsheet>{''.join(tables)}</office:spreadsheet></office:body>"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("META-INF/manifest.xml", "<manifest/>")
        archive.writestr("content.xml", f"<office:document-content{names}>{styles}{body}</office:document-content>")
    return path


def cell(value: object) -> str:
    if value is None:
        return "<c/>"
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{escape(value)}</t></is></c>'
    return f"<c><v>{value!r}</v></c>"


CODES = {164: "0.000%", 165: '0.0" %"', 166: r"0.0\%", 167: "0.00_%", 168: "[=1]0%;General", 169: "0.0%%",
         170: "0%;-0%", 171: "[Red]0.0%;@", 172: "0.000,", 173: '0.0,," M"', 174: "#,##0.0", 175: "0.0,%",
         185: '[>0]0.0" N";0.0" kN"', 186: '0.0" mm²"',
         180: '0.00" kN"', 181: 'General" kN"', 182: '[Red]0.0\\N;-0.0\\N', 183: '"about "0.0', 184: '0.0" €"',
         176: "0.0,;0.0", 177: "0.00%;-0.00%;0", 178: "[>1]0%;0%;0.0", 179: "0%;0%;0%%"}  # fmt: skip
OF_STYLE = [0, 10, *CODES, 2]  # the format of each style
STYLES = (
    f'<styleSheet xmlns="{MAIN}"><numFmts>'
    + "".join(f'<numFmt numFmtId="{at}" formatCode={quoteattr(code)}/>' for at, code in CODES.items())
    + '</numFmts><cellStyleXfs><xf numFmtId="9"/></cellStyleXfs><cellXfs>'
    + "".join(f'<xf numFmtId="{at}"/>' for at in OF_STYLE)
    + "</cellXfs></styleSheet>"
)
ASKED = "unit 'partly percent' of the strain is not known; expected --displacement-unit"


def styled(*styles: int, title: str = "Strain [%]", first: int = 1, references: bool = True) -> str:
    """Rows of a test from row ``first`` on, whose strains, from 0 to 0.0997, have these styles, the last again."""
    styles = (*styles, *[styles[-1]] * (5 - len(styles)))

    def at(column: str, row: int) -> str:
        return f' r="{column}{row + first}"' if references else ""

    rows = [f"<row{at('', 0)}>{cell('Time [s]')}{cell(title)}{cell('Force [N]')}</row>"]
    for i, style in enumerate(styles):
        strain = f'<c{at("B", i + 1)} s="{style}"><v>{0.0997 * i / 4!r}</v></c>'
        time, force = (f"<c{at(column, i + 1)}><v>{value}</v></c>" for column, value in (("A", i), ("C", 3 * i)))
        rows.append(f"<row{at('', i + 1)}>{time}{strain}{force}</row>")
    return "".join(rows)


def of_style(code: str) -> int:
    """The number of the style with a format."""
    return OF_STYLE.index(next(number for number, each in CODES.items() if each == code))


PERCENT = [1, *map(of_style, ("0.000%", "0%;-0%", "[Red]0.0%;@", "0.00%;-0.00%;0"))]


@pytest.mark.parametrize("references", [True, False])
@pytest.mark.parametrize("title", ["Strain [%]", "Strain"])
@pytest.mark.parametrize("style", PERCENT)
def test_cells_of_percent_are_read_as_they_are_shown(tmp_path, title, style, references):
    rows = styled(style, title=title, references=references)
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=rows)
    rows = rows_of(path)["one"]
    assert rows[0] == ("Time [s]", "Strain [%]", "Force [N]")
    assert [row[1] for row in rows[1:]] == ["0", "2.4925", "4.985", "7.4775", "9.97"]
    assert [row[2] for row in rows[1:]] == ["0", "3", "6", "9", "12"]
    (recording,) = read_recordings(path, Hints())
    assert recording.numbers[-1].tolist() == pytest.approx([4.0, 0.0997, 12.0])


@pytest.mark.parametrize("style", [0, *map(of_style, ('0.0" %"', r"0.0\%", "0.00_%", "#,##0.0")), len(OF_STYLE) - 1])
def test_other_formats_leave_cells_as_they_are(tmp_path, style):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(style))
    assert rows_of(path)["one"][-1] == ("4", "0.0997", "12")


@pytest.mark.parametrize("title", ["Strain [%]", "Strain"])
@pytest.mark.parametrize(
    "styles",
    [
        (0, 1),
        (1, 0),
        (1, 0, 1),
        (1, 1, 1, 1, 0),
        (of_style("[=1]0%;General"),),
        (of_style("[>1]0%;0%;0.0"),),
        (of_style("0.0%%"),),
        (of_style("0%;0%;0%%"), 0),
    ],
)
def test_numbers_of_which_some_are_formatted_as_percent_are_asked_about(tmp_path, styles, title):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(*styles, title=title))
    assert [row[1] for row in rows_of(path)["one"][1:]] == ["0", "0.024925", "0.04985", "0.074775", "0.0997"]
    with pytest.raises(BadInput, match=ASKED):
        read_recordings(path, Hints())
    (recording,) = read_recordings(path, Hints(displacement_unit="1"))
    assert recording.numbers[-1].tolist() == pytest.approx([4.0, 0.0997, 12.0])


@pytest.mark.parametrize("title", ["Force [kN]", "Force"])
@pytest.mark.parametrize("code", ["0.000,", '0.0,," M"', "0.0,%", "0.0,;0.0"])
def test_numbers_that_are_shown_in_thousands_are_asked_about(tmp_path, code, title):
    """What stands in the title may be the unit of what is shown, or of what is stored."""
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(of_style(code), title=title))
    found = rows_of(path)["one"]
    assert found[0] == ("Time [s]", "Force [shown in thousands]", "Force [N]")
    assert found[-1] == ("4", "0.0997", "12"), "as it is stored"
    path = write_workbook(tmp_path / "b.xlsx", STYLES, one=styled(of_style(code), title="Strain"))
    with pytest.raises(
        BadInput, match="unit 'shown in thousands' of the strain is not known; expected --displacement-u"
    ):
        read_recordings(path, Hints())


def rewritten(path: Path, change) -> Path:
    """The archive with its members' names and contents as ``change`` gives them."""
    with zipfile.ZipFile(path) as archive:
        members = [change(name, archive.read(name)) for name in archive.namelist()]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


@pytest.mark.parametrize("name", ["xl/styles.xml", "xl/workbook.xml", "xl/_rels/workbook.xml.rels"])
def test_members_are_found_whatever_their_case(tmp_path, name):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1))
    other = name.replace("styles", "Styles").replace("workbook", "Workbook")
    rewritten(path, lambda each, content: (other if each == name else each, content))
    assert rows_of(path)["one"][-1] == ("4", "9.97", "12")


def test_styles_of_another_name_are_found_by_their_relation(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1))
    link = f'<Relationship Id="s" Type="{OFFICE}/styles" Target="looks.xml"/></Relationships>'.encode()

    def moved(name, content):
        content = content.replace(b"</Relationships>", link) if name == "xl/_rels/workbook.xml.rels" else content
        return name.replace("xl/styles.xml", "xl/looks.xml"), content

    assert rows_of(rewritten(path, moved))["one"][-1] == ("4", "9.97", "12")
    gone = rewritten(path, lambda name, content: (name.replace("looks", "gone"), content))
    with pytest.raises(BadInput, match="the formats of its cells are not found; expected a spreadsheet as Excel saves"):
        list(read_sheets(gone))


def test_members_with_one_name_are_refused(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("xl/Styles.xml", STYLES.replace("cellXfs", "none"))
    with pytest.raises(BadInput, match="two members with the same name; expected another name for each"):
        list(read_sheets(path))


def test_numbers_of_styles_are_numbers(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1).replace('s="1"', 's="01"'))
    assert rows_of(path)["one"][-1] == ("4", "9.97", "12")


@pytest.mark.parametrize("more", ['<c r="B3"><v>25</v></c>', '<c r="A3"><v>25</v></c>', '<c r="C2"><v>25</v></c>'])
def test_a_cell_that_is_there_twice_is_refused(tmp_path, more):
    rows = styled(1)
    at = rows.index('<c r="C3"')
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=rows[:at] + more + rows[at:])
    with pytest.raises(BadInput, match=r"two cells [ABC]\d; expected one"):
        list(read_sheets(path))


def test_a_unit_that_contradicts_cells_of_percent_is_asked_for(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1, title="Strain (mm/mm)"))
    with pytest.raises(BadInput, match=r"the strain has two units: 'mm/mm' and '%'"):
        read_recordings(path, Hints())


def test_a_number_above_the_title_is_of_another_table(tmp_path):
    above = f'<row r="1">{cell("Humidity")}<c r="B1" s="1"><v>0.45</v></c></row>'
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=above + styled(1, title="Strain (mm/mm)", first=3))
    assert rows_of(path)["one"][0] == ("Humidity", "45", "")
    with pytest.raises(BadInput, match=r"the strain has two units: 'mm/mm' and '%'"):
        read_recordings(path, Hints())


def test_each_of_several_tables_has_its_own_title(tmp_path):
    both = styled(1, title="Strain") + styled(1, title="Strain", first=7)
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=both)
    rows = rows_of(path)["one"]
    assert rows[0] == rows[6] == ("Time [s]", "Strain [%]", "Force [N]")
    assert [row[1] for row in rows[7:]] == ["0", "2.4925", "4.985", "7.4775", "9.97"]


def test_a_percent_sign_within_a_title_is_no_unit(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(1, title="Strain of 10% test (mm/mm)"))
    assert rows_of(path)["one"][0][1] == "Strain of 10% test (mm/mm) [%]"


def test_cells_and_sheets_with_names_of_no_spreadsheet_are_refused(tmp_path):
    odd = styled(1).replace('r="B3"', f'r="{"Z" * 400_000}3"')
    with pytest.raises(BadInput, match=r"not a spreadsheet that can be read \(a cell called ZZZ"):
        list(read_sheets(write_workbook(tmp_path / "a.xlsx", STYLES, one=odd)))
    path = write_workbook(tmp_path / "b.xlsx", STYLES, one=styled(1), two=styled(0))
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(tmp_path / "c.xlsx", "w") as twice:
        for name in archive.namelist():
            twice.writestr(name, archive.read(name).replace(b'name="two"', b'name="one"'))
    with pytest.raises(BadInput, match="two sheets with the same name; expected another name for each"):
        list(read_sheets(tmp_path / "c.xlsx"))


def test_cells_of_percent_in_an_open_document(tmp_path):
    rows = [ods_row(*map(ods_text, ("Time [s]", "Strain", "Stretch", "Force [N]")))]
    rows.append(ods_row(ods_number(0), ods_number(0.05, "percentage", many=2), ods_number(3)))
    rows.append(ods_row(ods_number(1), ods_number(0.0997, "percentage"), ods_number(1.5), ods_number(3), many=2))
    within = f'<table:table table:name="two">{ods_row(ods_number(2))}</table:table>'  # which is no table of the sheet
    rows[-1] = rows[-1].replace("</text:p></table:table-cell>", f"</text:p>{within}</table:table-cell>", 1)
    write_ods(tmp_path / "a.ods", f'<table:table table:name="one">{"".join(rows)}</table:table>')
    assert rows_of(tmp_path / "a.ods")["one"] == [
        ("Time [s]", "Strain [%]", "Stretch [partly percent]", "Force [N]"),
        ("0", "5", "0.05", "3"),
        ("1", "9.97", "1.5", "3"),
        ("1", "9.97", "1.5", "3"),
    ]
    foreign = 'xmlns:other="urn:other" other:value-type="float" office:value-type="percentage"'
    replaced(tmp_path / "a.ods", 'office:value-type="percentage"', foreign)
    assert rows_of(tmp_path / "a.ods")["one"][1] == ("0", "5", "0.05", "3")
    style = '<style xmlns:n="urn:oasis:names:tc:opendocument:xmlns:datastyle:1.0"><n:number n:display-factor="1000"/>'
    replaced(tmp_path / "a.ods", "<office:body>", f"{style}</style><office:body>")
    with pytest.raises(BadInput, match="numbers that are shown divided by a factor; expected numbers that are shown"):
        list(read_sheets(tmp_path / "a.ods"))


@pytest.mark.parametrize(("code", "unit"), [('0.00" kN"', "kN"), ('General" kN"', "kN"), ("[Red]0.0\\N;-0.0\\N", "N")])
@pytest.mark.parametrize("title", ["Force [mN]", "Force", "Force, mN"])
def test_numbers_that_are_shown_with_another_unit_are_asked_about(tmp_path, code, unit, title):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(of_style(code), title=title))
    found = rows_of(path)["one"]
    name = "Force, mN" if title == "Force, mN" else "Force"
    assert found[0] == ("Time [s]", f"{name} [shown with {unit}]", "Force [N]")
    assert found[-1] == ("4", "0.0997", "12")
    path = write_workbook(tmp_path / "b.xlsx", STYLES, one=styled(of_style(code), title="Strain"))
    with pytest.raises(
        BadInput, match=f"unit 'shown with {unit}' of the strain is not known; expected --displacement-u"
    ):
        read_recordings(path, Hints())


@pytest.mark.parametrize(
    ("code", "title"),
    [
        ('0.00" kN"', "Force [kN]"),
        ('0.00" kN"', "kN"),
        ('0.0" mm²"', "Area [mm2]"),
        ('0.0" €"', "Force"),
    ],
)
def test_numbers_that_are_shown_with_their_own_unit_or_none_are_as_they_are(tmp_path, code, title):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(of_style(code), title=title))
    assert rows_of(path)["one"][0] == ("Time [s]", title, "Force [N]")
    path = write_workbook(tmp_path / "b.xlsx", STYLES, one=styled(of_style(code), 0, title=title))
    assert rows_of(path)["one"][0][1] == title, "only some have the format"


@pytest.mark.parametrize(
    ("code", "title", "asked"),
    [
        ('0.00" kN"', "Force [kN/mm]", "Force [shown with kN]"),
        ('0.00" kN"', "kN [N]", "kN [shown with kN]"),
        ('[>0]0.0" N";0.0" kN"', "Force [N]", "Force [shown with N or kN]"),
    ],
)
def test_only_the_whole_unit_of_a_title_is_the_unit_that_is_shown(tmp_path, code, title, asked):
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=styled(of_style(code), title=title))
    assert rows_of(path)["one"][0][1] == asked


def test_a_number_that_is_no_column_changes_no_text(tmp_path):
    size = f'<c s="{of_style(CODES[180])}"><v>14.33</v></c>'
    rows = f"<row>{cell('Specimen')}{cell('A1')}</row><row>{cell('Length')}{size}</row>"
    path = write_workbook(tmp_path / "a.xlsx", STYLES, one=rows)
    assert rows_of(path)["one"] == [("Specimen", "A1"), ("Length", "14.33")]


def test_dates_and_durations_are_clock_times(tmp_path):
    """Of a day at midnight, and beyond 24 hours."""
    styles = STYLES.replace("<cellXfs>", '<cellXfs><xf numFmtId="0"/><xf numFmtId="22"/><xf numFmtId="46"/>')
    rows = "<row>" + cell("Date") + cell("Duration") + "</row>"
    for days, past in ((45000.5, 0.9), (45001, 1.0), (45001.25, 2.5)):
        rows += f'<row><c s="1"><v>{days}</v></c><c s="2"><v>{past}</v></c></row>'
    path = write_workbook(tmp_path / "a.xlsx", styles, one=rows)
    assert rows_of(path)["one"][1:] == [
        ("2023-03-15T12:00:00", "21:36:00"),
        ("2023-03-16T00:00:00", "24:00:00"),
        ("2023-03-16T06:00:00", "60:00:00"),
    ]


def replaced(path: Path, old: str, new: str) -> None:
    rewritten(path, lambda name, content: (name, content.replace(old.encode(), new.encode())))


def test_a_text_that_is_called_xls_is_read_as_a_text(tmp_path):
    path = tmp_path / "a.xls"
    path.write_text("Time (s)\tDisplacement (mm)\tForce (N)\n0\t0\t0\n1\t0.1\t2\n2\t0.2\t4\n")
    (found,) = read_recordings(path, Hints())
    assert found.numbers[:, 2].tolist() == [0.0, 2.0, 4.0]
    for start in (b"<html><table>", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"\t\x08\x10\x00", b""):
        path.write_bytes(start)
        assert is_sheet(path), start
    assert is_sheet(tmp_path / "none.xls")


def test_an_empty_row_among_the_numbers_may_stand_between_tests(tmp_path):
    table = [["Time (s)", "Extension (mm)", "Load (N)"], [0, 0, 0], [1, 0.1, 5], [2, 0.2, 9]]
    path = write_workbook(tmp_path / "test.xlsx", A=[*table, [None, None, None], *table[1:]])
    assert [one.rows for one in read_recordings(path, Hints(tables="apart"))] == [(2, 3, 4), (6, 7, 8)]
    path = write_workbook(tmp_path / "test.xlsx", A=[*table, [None, None, None], [1.5, 0.3, 12]])
    with pytest.raises(BadInput, match=r"row 5: an empty row among the numbers; .* a file for each"):
        read_recordings(path, Hints())
