"""How the cells of a spreadsheet are shown, and what of it is hidden: what the library that reads it does not tell.

Files of the kinds .xls and .xlsb do not tell it here. This runs in the process of
:mod:`sinew.tasks.data.sheet_reading`, which has limits.
"""

import io
import posixpath
import re
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO
from xml.etree.ElementTree import Element

MAX_CELLS = 4 * 10**6  # of all sheets, with those that are empty
MAX_REPEATED = 10**6  # cells with a value, which a few bytes of an open document may repeat
MAX_ROWS = 2**20  # of a sheet: the library ends there
OF_TABLES = ("table", "table-row", "table-cell", "covered-table-cell")
OF_DOCUMENTS = "{urn:oasis:names:tc:opendocument:xmlns:"  # begin of names that an open document gives a meaning
ARCHIVE, OLE = b"PK", bytes.fromhex("d0cf11e0")  # what a file begins with: all kinds but .xls, and .xls
KINDS = ("xl/workbook.xml", "xl/workbook.bin", "content.xml")  # the part that only one kind has
NO_SIGN = re.compile(r'"[^"]*"|\\.|_.|\*.|\[[^\]]*\]')  # in a number format: shown as it is, or not at all
CONDITION = re.compile(r"\[[<>=]")  # of a section of a format
PERCENT_FORMATS = {9, 10}  # of Excel itself
PERCENT, THOUSANDS, UNCLEAR = "percent", "thousands", "unclear"  # how a format shows all numbers
FAILED = "failed"  # a number that stands for an error of a formula
WITH = "shown with "  # so it does, with the unit behind this
SHOWN_TEXT = re.compile(r'"([^"]*)"|\\(.)|([0#?.,%]|General|_.|\*.|\[[^\]]*\])')  # parts of a number format
NUMBER = re.compile(r"[-+\u2212(]?\s?[\d.,'\s]*\d(?:[eE][-+]?\d+)?")  # as a cell shows it, before its unit
HAS_UNIT = re.compile(r"[^\W\d_]|[%°]")  # a letter
IN_THOUSANDS = re.compile(r"[0#?](,+)(?![0#?,])")  # in a number format: each comma divides by a thousand
REFERENCE = re.compile(r"([A-Z]{1,3})([0-9]{1,7})")  # of a cell
#: What an open document shows for an error, in any language: "#DIV/0!", "Err:502", "Fehler:502", "#N/A", "nv".
ERROR = re.compile(r"#[^\W\d_]|[^\W\d_]{2,12}\.?\s?:\s?\d{3}\b|(?=\D+\Z)[\W_]*[^\W\d_]")
AS_EXCEL = "a spreadsheet as Excel saves it"
#: Within a cell, up to its value, however long its formula is.
WITHIN = rb"(?:(?!</?(?:\w+:)?c[\s/>])[\s\S]){0,16384}?"
#: A number in parts, such as a character by its code. The library reads the first; texts of formulas it reads whole.
IN_PARTS = re.compile(
    rb"<(?:\w+:)?c(?:\s(?![^>]*\bt=[\"']str[\"'])[^>]*)?>" + WITHIN
    + rb"<((?:\w+:)?v)(?:\s[^>]*)?>[^<&]*(?:&|<(?!/\1\s*>))"
)  # fmt: skip
#: What no spreadsheet program writes in a sheet, and the library does not read as it is.
READ_OTHERWISE = {
    re.compile(rb"\A[\s\S]{0,199}\0"): "a sheet that is not in UTF-8",
    re.compile(rb"<!DOCTYPE"): "a sheet with a document type",
    IN_PARTS: "a cell whose number is written in parts",
    re.compile(rb"</(?:\w+:)?v\s*>" + WITHIN + rb"<(?:\w+:)?v[\s/>]"): "a cell with two values",
}
HIDDEN_ROW = re.compile(rb"<(?:\w+:)?row\b[^>]*\bhidden=")
HIDDEN = ("collapse", "filter")  # rows of an open document that are not shown
Cells = dict[int, dict[int, str]]  # by row and column, both from 0: how the number is shown


class TooMuch(Exception):
    """What is not read: of what there is too much, or what is wrong, and what is ``expected``."""

    def __init__(self, words: str, expected: str) -> None:
        super().__init__(words)
        self.expected = expected


@dataclass
class Look:
    """How a sheet is shown: the ``cells`` that are not shown as they are, and the hidden ``rows``, from 1."""

    cells: Cells = field(default_factory=dict)
    rows: set[int] = field(default_factory=set)


def looks_of(content: bytes) -> dict[str, Look]:
    """How sheets are shown, by their names; none for .xls and .xlsb. Raises :class:`TooMuch`."""
    if content.startswith(OLE):
        return {}
    if not content.startswith(ARCHIVE):
        raise ValueError("its first bytes are not those of a spreadsheet")
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        # as whoever reads the numbers finds them
        members = {name.lower().replace("\\", "/"): name for name in archive.namelist()}
        if len(members) < len(archive.namelist()):
            raise TooMuch("two members with the same name", "another name for each")
        kinds = [part for part in KINDS if part in members]
        if len(kinds) != 1:
            raise ValueError(f"an archive with {' and '.join(kinds) or 'no workbook'}")
        if kinds == ["content.xml"]:
            return _looks_of_ods(archive, members["content.xml"])
        return _looks_of_xlsx(archive, members) if kinds == ["xl/workbook.xml"] else {}


def _shown(code: str) -> str | None:
    """How a format shows numbers: ``PERCENT``, ``THOUSANDS``, ``UNCLEAR`` where it differs or is another; None: as is.

    Where it writes units behind them, ``WITH`` these. The third section is of zero, unless they have conditions.
    """
    count = 3 if CONDITION.search(code) else 2
    sections = [part for part in NO_SIGN.sub("", code).split(";")[:count] if re.search(r"[0#?]|General", part)]
    if any(IN_THOUSANDS.search(part) for part in sections):
        return THOUSANDS
    percents = {part.count("%") for part in sections}
    if percents <= {0}:
        units = sorted({unit for part in code.split(";")[:count] if (unit := _unit(part))})
        return WITH + " or ".join(units) if units else None
    return PERCENT if percents == {1} else UNCLEAR


def _unit(section: str) -> str:
    """The unit that a section of a format writes behind numbers, or nothing."""
    texts, numbers = [""], False
    for quoted, escaped, sign in SHOWN_TEXT.findall(section):
        numbers = numbers or sign in ("0", "#", "?", "General")
        texts.append((quoted or escaped) if numbers else "")
    unit = "".join(texts).strip(" ()[]")
    return unit[:20] if HAS_UNIT.search(unit) else ""


def _looks_of_xlsx(archive: zipfile.ZipFile, members: dict[str, str]) -> dict[str, Look]:
    if "xl/_rels/workbook.xml.rels" not in members:
        raise TooMuch("its sheets are not found", AS_EXCEL)
    relations = _elements(archive, members["xl/_rels/workbook.xml.rels"], "Relationship")
    targets = {
        one.get("Id"): posixpath.normpath(posixpath.join("/xl", one.get("Target", "").replace("\\", "/")))
        .lstrip("/")
        .lower()
        for one in relations
    }
    of_styles = [targets[one.get("Id")] for one in relations if one.get("Type", "").endswith("/styles")]
    style_path = next((path for path in (*of_styles, "xl/styles.xml") if path in members), None)
    if style_path is None and of_styles:
        raise TooMuch("the formats of its cells are not found", AS_EXCEL)
    styles = _scaling_styles(archive, members[style_path]) if style_path else {}
    found = {}
    for sheet in _elements(archive, members["xl/workbook.xml"], "sheet"):
        link = next((value for key, value in sheet.attrib.items() if _local(key) == "id"), None)
        if (path := targets.get(link)) not in members:
            raise TooMuch("one of its sheets is not found", AS_EXCEL)
        content = archive.read(members[str(path)])
        for pattern, words in READ_OTHERWISE.items():
            if pattern.search(content):
                raise TooMuch(words, AS_EXCEL)
        if styles or HIDDEN_ROW.search(content):
            found[sheet.get("name", "")] = _look_of_sheet(content, styles)
    return found


def _scaling_styles(archive: zipfile.ZipFile, path: str) -> dict[int, str]:
    """How styles of cells, by their numbers, show numbers, where it is not as they are."""
    formats: dict[int, str | None] = dict.fromkeys(PERCENT_FORMATS, PERCENT)
    styles: dict[int, str] = {}
    inside, count = False, 0
    with archive.open(path) as file:
        for event, element in _parsed(file):
            name = _local(element.tag)
            if name == "cellXfs":
                inside = event == "start"
            elif event == "end" and name == "numFmt":
                formats[int(element.get("numFmtId", "0"))] = _shown(element.get("formatCode", ""))
            elif event == "end" and name == "xf" and inside:
                if (shown := formats.get(int(element.get("numFmtId", "0")))) is not None:
                    styles[count] = shown
                count += 1
    return styles


def _look_of_sheet(content: bytes, styles: dict[int, str]) -> Look:
    found = Look()
    row, column = -1, -1
    before = (-1, -1)
    for event, element in _parsed(io.BytesIO(content)):
        name = _local(element.tag)
        if event == "start" and name == "row":
            row, column = int(element.get("r", str(row + 2))) - 1, -1
            if element.get("hidden") in ("1", "true"):
                found.rows.add(row + 1)
        elif event == "start" and name == "c":
            row, column = _place(element.get("r", "")) if element.get("r") else (row, column + 1)
            if (row, column) <= before:
                raise TooMuch(f"two cells in row {row + 1}, column {column + 1}, or one out of order", "one")
            before = row, column
            if (style := int(element.get("s", "0"))) in styles:
                found.cells.setdefault(row, {})[column] = styles[style]
        elif event == "end" and name in ("row", "c"):
            element.clear()
    return found


def _place(reference: str) -> tuple[int, int]:
    """Row and column, both from 0, of a cell such as ``AB12``."""
    found = REFERENCE.fullmatch(reference)
    if found is None:
        raise ValueError(f"a cell called {reference[:20]}")
    column = 0
    for letter in found[1]:
        column = 26 * column + ord(letter) - 64
    return int(found[2]) - 1, column - 1


def _looks_of_ods(archive: zipfile.ZipFile, path: str) -> dict[str, Look]:
    found: dict[str, Look] = {}
    look = Look()
    row = column = depth = filled = 0
    with archive.open(path) as file:
        for event, element in _parsed(file):
            name = _local(element.tag)
            about = {_local(key): value for key, value in element.attrib.items() if key.startswith(OF_DOCUMENTS)}
            if name in OF_TABLES and _foreign(element, about):  # whoever reads the numbers takes it all the same
                raise TooMuch(f"a {name} with names of another kind of document", "an open document (ODF 1.0 to 1.4)")
            if name == "number" and float(about.get("display-factor", "1")) != 1.0:
                raise TooMuch("numbers that are shown divided by a factor", "numbers that are shown as they are")
            if name == "table":
                depth += 1 if event == "start" else -1
                if event == "start" and depth == 1:  # not one within a cell
                    look = found.setdefault(about.get("name", ""), Look())
                    row = 0
            elif depth > 1:
                continue
            elif event == "start" and name == "table-row":
                column = filled = 0
            elif event == "end" and name in ("table-cell", "covered-table-cell"):
                many = int(about.get("number-columns-repeated", "1"))
                filled += many if "value-type" in about else 0
                if (shown := _shown_in_ods(element, about.get("value-type", ""))) is not None:
                    if many > MAX_CELLS:
                        raise TooMuch(f"{many:,} cells that are the same", f"at most {MAX_CELLS:,}")
                    look.cells.setdefault(row, {}).update(dict.fromkeys(range(column, column + many), shown))
                column += many
                element.clear()
            elif event == "end" and name == "table-row":
                many = int(about.get("number-rows-repeated", "1"))
                _check_rows(row, many, filled, look.cells.get(row, {}))
                if row in look.cells:
                    look.cells.update((row + i, look.cells[row]) for i in range(1, many))
                if (
                    about.get("visibility") in HIDDEN and len(look.rows) + many <= MAX_CELLS
                ):  # more rows are those below all others
                    look.rows.update(range(row + 1, row + 1 + many))
                row += many
                element.clear()
    return found


def _check_rows(row: int, many: int, filled: int, shown: dict[int, str]) -> None:
    """Raises :class:`TooMuch` for a row that is repeated too often, or stands too far below, from its cells."""
    if filled and row >= MAX_ROWS:
        raise TooMuch(f"a number in row {row + 1:,}", f"at most {MAX_ROWS:,} rows")
    if many > 1 and many * filled > MAX_REPEATED:
        raise TooMuch(f"{many:,} rows that are the same", f"at most {MAX_REPEATED:,} cells of them")
    if many > 1 and many * len(shown) > MAX_CELLS:
        raise TooMuch(f"{many:,} rows that are the same", f"at most {MAX_CELLS:,} cells")


def _foreign(element: Element, about: dict[str, str]) -> bool:
    """Whether an element, or all that says what a cell holds, is of another namespace than ``about``."""
    others = {_local(key) for key in element.attrib} - set(about)
    return not element.tag.startswith(OF_DOCUMENTS) or not others.isdisjoint(("value-type", "value"))


def _shown_in_ods(cell: Element, kind: str) -> str | None:
    """How a cell shows its number, where it is not as it is."""
    if kind == "percentage":
        return PERCENT
    if kind not in ("float", "currency"):
        return None
    text = "".join("".join(part.itertext()) for part in cell if _local(part.tag) == "p").strip()
    if ERROR.match(text):
        return FAILED
    if text.endswith("%"):
        return UNCLEAR
    number = NUMBER.match(text)
    unit = text[number.end() :].strip(" ()[]") if number else ""
    return WITH + unit[:20] if HAS_UNIT.search(unit) else None


def _elements(archive: zipfile.ZipFile, path: str, name: str) -> list[Element]:
    with archive.open(path) as file:
        return [element for event, element in _parsed(file) if event == "end" and _local(element.tag) == name]


def _parsed(file: IO[bytes]) -> Iterator[tuple[str, Element]]:
    """The elements of a member, each where it begins and where it ends."""
    from defusedxml.ElementTree import iterparse  # in this process only

    yield from iterparse(file, ("start", "end"), forbid_dtd=True)


def _local(name: str) -> str:
    """A name of XML without its namespace."""
    return name.rpartition("}")[2]
