"""How the cells of a workbook of Excel (.xlsx, .xlsm) are shown, and what of it is hidden."""

import io
import posixpath
import re
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from sinew.tasks.data.number_formats import PERCENT, shown_by
from sinew.tasks.data.sheet_look import Look, TooMuch, local, parsed

PERCENT_FORMATS = {9, 10}  # of Excel itself
REFERENCE = re.compile(r"([A-Z]{1,3})([0-9]{1,7})")  # of a cell
AS_EXCEL = "a spreadsheet as Excel saves it"
#: Within a cell, up to its first value, however long its formula is. It gives nothing back, so that it takes no time
#: with the square of its length.
WITHIN = rb"(?:(?!</?(?:\w+:)?c[\s/>]|</?(?:\w+:)?v[\s>])[\s\S]){0,16384}+"
#: A number in parts, such as a character by its code. The library reads the first; texts of formulas it reads whole.
IN_PARTS = re.compile(
    rb"<(?:\w+:)?c(?:\s(?![^<>]*\bt=[\"']str[\"'])[^<>]*)?>" + WITHIN
    + rb"<((?:\w+:)?v)(?:\s[^>]*)?>[^<&]*+(?:&|<(?!/\1\s*>))"
)  # fmt: skip
#: What no spreadsheet program writes in a sheet, and the library does not read as it is.
READ_OTHERWISE = {
    re.compile(rb"\A[\s\S]{0,199}\0"): "a sheet that is not in UTF-8",
    re.compile(rb"<!DOCTYPE"): "a sheet with a document type",
    re.compile(rb"<[^<>]*<"): "a sheet with a tag that is not closed",
    IN_PARTS: "a cell whose number is written in parts",
    re.compile(rb"</(?:\w+:)?v\s*>" + WITHIN + rb"<(?:\w+:)?v[\s/>]"): "a cell with two values",
}
HIDES = re.compile(rb"<(?:\w+:)?(?:row|col)\b[^<>]*\b(?:hidden=|(?:ht|width)=[\"']0[.0]*[\"'])")
PLACE = re.compile(rb"<(?:\w+:)?c\s(?:[^>]*?\s)?r=[\"']([A-Z]{1,3})([0-9]{1,7})[\"']")
TRUE = ("1", "true")
LAST_COLUMN, MOST_RULES = 2**14, 200  # of a sheet
MOST_FORMATS = 200_000  # of a workbook, with those of its cells; Excel has at most 65,490 of cells


@dataclass
class Styles:
    """How ``cells`` by the number of their style, and rules that depend on their values (``rules``), show numbers.

    Only what does not show them as they are.
    """

    cells: dict[int, str] = field(default_factory=dict)
    rules: dict[int, str] = field(default_factory=dict)


def main_part(archive: zipfile.ZipFile, members: dict[str, str]) -> str | None:
    """The name of the part that a workbook begins with, or None where the archive does not tell one."""
    if "_rels/.rels" not in members:
        return None
    for one in _elements(archive, members["_rels/.rels"], "Relationship"):
        if one.get("Type", "").endswith("/officeDocument"):
            return _target("/", one)
    return None


def _target(folder: str, relation: Element) -> str:
    """The part that a relation of a part in ``folder`` points at, as whoever reads the numbers finds it."""
    target = relation.get("Target", "").replace("\\", "/")
    return posixpath.normpath(posixpath.join(folder, target)).lstrip("/").lower()


def relations_of(archive: zipfile.ZipFile, members: dict[str, str], part: str) -> dict[str, tuple[str, str]]:
    """The parts and their kinds that the relations of a workbook point at. Raises :class:`TooMuch`."""
    if part not in members:
        raise TooMuch("its sheets are not found", AS_EXCEL)
    relations = _elements(archive, members[part], "Relationship")
    found = {one.get("Id", ""): (_target("/xl", one), one.get("Type", "")) for one in relations}
    if len(found) < len(relations):
        raise TooMuch("two parts with the same name", "another name for each")
    return found


def looks_of_xlsx(archive: zipfile.ZipFile, members: dict[str, str]) -> dict[str, Look]:
    """How the sheets are shown, by their names. Raises :class:`TooMuch`."""
    relations = relations_of(archive, members, "xl/_rels/workbook.xml.rels")
    of_styles = [path for path, kind in relations.values() if kind.endswith("/styles")]
    style_path = next((path for path in (*of_styles, "xl/styles.xml") if path in members), None)
    if style_path is None and of_styles:
        raise TooMuch("the formats of its cells are not found", AS_EXCEL)
    styles = _scaling_styles(archive, members[style_path]) if style_path else Styles()
    found = {}
    for sheet in _elements(archive, members["xl/workbook.xml"], "sheet"):
        link = next((value for key, value in sheet.attrib.items() if local(key) == "id"), None)
        path = relations.get(str(link), ("", ""))[0]
        if path not in members:
            raise TooMuch("one of its sheets is not found", AS_EXCEL)
        content = archive.read(members[path])
        for pattern, words in READ_OTHERWISE.items():
            if pattern.search(content):
                raise TooMuch(words, AS_EXCEL)
        _refuse_twice(content)
        if styles.cells or styles.rules or HIDES.search(content):
            found[sheet.get("name", "")] = _look_of_sheet(content, styles)
    return found


def _refuse_twice(content: bytes) -> None:
    """Raises :class:`TooMuch` for a cell that is there twice. Where all stand in order, that takes no memory."""
    before, seen = (0, 0, b""), set[tuple[int, int, bytes]]()
    for found in PLACE.finditer(content):
        here = int(found[2]), len(found[1]), found[1]
        if here <= before and not seen:
            seen.update((int(one[2]), len(one[1]), one[1]) for one in PLACE.finditer(content, 0, found.start()))
        if here <= before and here in seen:
            raise TooMuch(f"two cells {found[1].decode()}{here[0]}", "one")
        if seen:
            seen.add(here)
        before = max(before, here)


def _scaling_styles(archive: zipfile.ZipFile, path: str) -> Styles:
    """The styles that do not show numbers as they are."""
    formats: dict[int, str | None] = dict.fromkeys(PERCENT_FORMATS, PERCENT)
    found = Styles()
    inside, count, rule, told = "", 0, 0, 0
    with archive.open(path) as file:
        for event, element in parsed(file):
            name = local(element.tag)
            told += event == "end" and name in ("numFmt", "xf")
            if told > MOST_FORMATS:
                raise TooMuch(f"more than {MOST_FORMATS:,} formats", AS_EXCEL)
            if name in ("cellXfs", "dxfs"):
                inside = name if event == "start" else ""
            elif event == "end" and name == "numFmt":
                shown = shown_by(element.get("formatCode", ""))
                if inside == "dxfs" and shown is not None:
                    found.rules[rule] = shown
                elif inside != "dxfs":
                    formats[int(element.get("numFmtId", "0"))] = shown
            elif event == "end" and name == "xf" and inside == "cellXfs":
                if (shown := formats.get(int(element.get("numFmtId", "0")))) is not None:
                    found.cells[count] = shown
                count += 1
            elif event == "end" and name == "dxf":
                rule += 1
    return found


def _look_of_sheet(content: bytes, styles: Styles) -> Look:
    found = Look()
    ruled = _ruled(content, styles.rules) if styles.rules else []
    row, column = -1, -1
    before = (-1, -1)
    for event, element in parsed(io.BytesIO(content)):
        name = local(element.tag)
        if event == "start" and name == "col" and _is_hidden(element, "width"):
            first, last = (int(element.get(end, "0")) for end in ("min", "max"))
            found.columns.update(range(first, min(last, LAST_COLUMN) + 1))
        elif event == "start" and name == "row":
            row, column = int(element.get("r", str(row + 2))) - 1, -1
            if _is_hidden(element, "ht"):
                found.rows.add(row + 1)
        elif event == "start" and name == "c":
            row, column = _place(element.get("r", "")) if element.get("r") else (row, column + 1)
            if (row, column) <= before:
                raise TooMuch(f"two cells in row {row + 1}, column {column + 1}, or one out of order", "one")
            before = row, column
            by_rule = (shown for rows, columns, shown in ruled if row in rows and column in columns)
            shown = styles.cells.get(int(element.get("s", "0"))) or next(by_rule, None)
            if shown is not None:
                found.cells.setdefault(row, {})[column] = shown
        elif event == "end" and name in ("row", "c"):
            element.clear()
    return found


def _is_hidden(element: Element, size: str) -> bool:
    """Whether a row or a column is hidden, or has no ``size``."""
    return element.get("hidden") in TRUE or float(element.get(size, "1")) == 0.0


def _ruled(content: bytes, rules: dict[int, str]) -> list[tuple[range, range, str]]:
    """The rows and columns of a sheet whose numbers are shown by a rule that depends on them, and how."""
    found: list[tuple[range, range, str]] = []
    for event, element in parsed(io.BytesIO(content)):
        name = local(element.tag)
        if event == "end" and name == "conditionalFormatting":
            ways = [rules.get(int(one.get("dxfId", "-1"))) for one in element if local(one.tag) == "cfRule"]
            for way in filter(None, ways):
                found += [(*_area(area), way) for area in element.get("sqref", "").split()]
            if len(found) > MOST_RULES:
                raise TooMuch(f"more than {MOST_RULES} formats that depend on values", "fewer")
        elif event == "end" and name in ("row", "c"):
            element.clear()
    return found


def _area(reference: str) -> tuple[range, range]:
    """Rows and columns, both from 0, of a reference such as ``B2:C9``."""
    ends: Sequence[tuple[int, int]] = [_place(end.replace("$", "")) for end in reference.split(":")[:2]]
    (top, left), (bottom, right) = ends[0], ends[-1]
    return range(top, bottom + 1), range(left, right + 1)


def _place(reference: str) -> tuple[int, int]:
    """Row and column, both from 0, of a cell such as ``AB12``."""
    found = REFERENCE.fullmatch(reference)
    if found is None:
        raise ValueError(f"a cell called {reference[:20]}")
    column = 0
    for letter in found[1]:
        column = 26 * column + ord(letter) - 64
    return int(found[2]) - 1, column - 1


def _elements(archive: zipfile.ZipFile, path: str, name: str) -> list[Element]:
    with archive.open(path) as file:
        return [element for event, element in parsed(file) if event == "end" and local(element.tag) == name]
