"""How the cells of an open document (.ods) are shown, and what of it is hidden."""

import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

from sinew.tasks.data.number_formats import (
    BRACKETS,
    FAILED,
    HAS_UNIT,
    LONGEST_UNIT,
    NUMBER,
    OTHERWISE,
    PERCENT,
    UNCLEAR,
    WITH,
    differs,
)
from sinew.tasks.data.sheet_look import MAX_CELLS, Look, TooMuch, local, parsed

MAX_REPEATED = 10**6  # cells with a value, which a few bytes of an open document may repeat
MAX_ROWS = 2**20  # of a sheet: the library ends there
MAX_COLUMNS = 2**14  # of a sheet, that may be hidden
CELLS = ("table-cell", "covered-table-cell")
OF_TABLES = ("table", "table-row", *CELLS)
GROUPS = ("table-row-group", "table-column-group")
OF_DOCUMENTS = "{urn:oasis:names:tc:opendocument:xmlns:"  # begin of names that an open document gives a meaning
#: What an open document shows for an error, in any language: "#DIV/0!", "Err:502", "Fehler:502", "#N/A", "nv".
ERROR = re.compile(r"#[^\W\d_]|[^\W\d_]{2,12}\.?\s?:\s?\d{3}\b|(?=\D+\Z)[\W_]*[^\W\d_]")
HIDDEN = ("collapse", "filter")  # rows and columns that are not shown
STYLES = "styles.xml"  # of an open document: those that have names, and their formats


@dataclass
class _Reading:
    """Where in a sheet one is: its ``look`` so far, the next ``row`` and ``column``, both from 0.

    ``filled``: cells of the row with a value; ``unseen``: whether some of them stand below a merged cell;
    ``columns``: those that were described; ``groups``: groups of rows or columns around, and whether each is shown.
    """

    look: Look = field(default_factory=Look)
    row: int = 0
    column: int = 0
    filled: int = 0
    unseen: bool = False
    columns: int = 0
    groups: list[bool] = field(default_factory=list)

    def is_hidden(self, about: Mapping[str, str]) -> bool:
        """Whether a row or column of the sheet is not shown."""
        return about.get("visibility") in HIDDEN or not all(self.groups)

    def begin_row(self) -> None:
        """Go to the first cell of the next row."""
        self.column, self.filled, self.unseen = 0, 0, False

    def add_columns(self, about: Mapping[str, str]) -> None:
        """Take in what is said of the next columns."""
        many = int(about.get("number-columns-repeated", "1"))
        if self.is_hidden(about):
            self.look.columns.update(range(self.columns + 1, min(self.columns + many, MAX_COLUMNS) + 1))
        self.columns += many

    def add_cells(self, cell: Element, about: Mapping[str, str], *, covered: bool) -> None:
        """Take in a cell, which may be repeated. Raises :class:`TooMuch`."""
        many = int(about.get("number-columns-repeated", "1"))
        if "value-type" in about:
            self.filled += many
            self.unseen = self.unseen or covered
        if (shown := _shown(cell, about)) is not None:
            if many > MAX_CELLS:
                raise TooMuch(f"{many:,} cells that are the same", f"at most {MAX_CELLS:,}")
            places = range(self.column, self.column + many)
            self.look.cells.setdefault(self.row, {}).update(dict.fromkeys(places, shown))
        self.column += many

    def end_row(self, about: Mapping[str, str]) -> None:
        """Take in that a row, which may be repeated, is at its end. Raises :class:`TooMuch`."""
        many, cells = int(about.get("number-rows-repeated", "1")), self.look.cells
        _check_rows(self.row, many, self.filled, cells.get(self.row, {}))
        if self.row in cells:
            cells.update((self.row + i, cells[self.row]) for i in range(1, many))
        hidden = self.unseen or self.is_hidden(about)
        if hidden and len(self.look.rows) + many <= MAX_CELLS:  # more rows are those below all others
            self.look.rows.update(range(self.row + 1, self.row + 1 + many))
        self.row += many


def looks_of_ods(archive: zipfile.ZipFile, members: Mapping[str, str]) -> dict[str, Look]:
    """How the sheets are shown, by their names. Raises :class:`TooMuch`."""
    if STYLES in members:
        with archive.open(members[STYLES]) as file:
            for event, element in parsed(file):
                if event == "start":
                    _refuse_factor(element)
    found: dict[str, Look] = {}
    here, depth = _Reading(), 0
    with archive.open(members["content.xml"]) as file:
        for event, element in parsed(file):
            name, about = local(element.tag), _about(element)
            if name in OF_TABLES and _foreign(element, about):  # whoever reads the numbers takes it all the same
                raise TooMuch(f"a {name} with names of another kind of document", "an open document (ODF 1.0 to 1.4)")
            _refuse_factor(element)
            if name == "table":
                depth += 1 if event == "start" else -1
                if event == "start" and depth == 1:  # not one within a cell
                    here = _Reading(found.setdefault(about.get("name", ""), Look()))
            elif depth > 1:
                continue
            elif name in GROUPS and event == "start":
                here.groups.append(about.get("display", "true") != "false")
            elif name in GROUPS:
                here.groups.pop()
            elif event == "start" and name == "table-row":
                here.begin_row()
            elif event == "end" and name == "table-column":
                here.add_columns(about)
            elif event == "end" and name in CELLS:
                here.add_cells(element, about, covered=name == CELLS[1])
                element.clear()
            elif event == "end" and name == "table-row":
                here.end_row(about)
                element.clear()
    return found


def _about(element: Element) -> dict[str, str]:
    """The attributes of an element to which an open document gives a meaning."""
    return {local(key): value for key, value in element.attrib.items() if key.startswith(OF_DOCUMENTS)}


def _refuse_factor(element: Element) -> None:
    """Raises :class:`TooMuch` for a format that divides numbers by a factor."""
    if local(element.tag) == "number" and float(_about(element).get("display-factor", "1")) != 1.0:
        raise TooMuch("numbers that are shown divided by a factor", "numbers that are shown as they are")


def _check_rows(row: int, many: int, filled: int, shown: dict[int, str]) -> None:
    """Raises :class:`TooMuch` for a row that is repeated too often, or stands too far below, from its cells."""
    if filled and row >= MAX_ROWS:
        raise TooMuch(f"a number in row {row + 1:,}", f"at most {MAX_ROWS:,} rows")
    if many > 1 and many * filled > MAX_REPEATED:
        raise TooMuch(f"{many:,} rows that are the same", f"at most {MAX_REPEATED:,} cells of them")
    if many > 1 and many * len(shown) > MAX_CELLS:
        raise TooMuch(f"{many:,} rows that are the same", f"at most {MAX_CELLS:,} cells")


def _foreign(element: Element, about: Mapping[str, str]) -> bool:
    """Whether an element, or all that says what a cell holds, is of another namespace than ``about``."""
    others = {local(key) for key in element.attrib} - set(about)
    return not element.tag.startswith(OF_DOCUMENTS) or not others.isdisjoint(("value-type", "value"))


def _shown(cell: Element, about: Mapping[str, str]) -> str | None:
    """How a cell shows its number, where it is not as it is."""
    kind = about.get("value-type", "")
    if kind == "percentage":
        return PERCENT
    if kind not in ("float", "currency"):
        return None
    text = "".join("".join(part.itertext()) for part in cell if local(part.tag) == "p").strip()
    value = about.get("value", "")
    if text == value:
        return None
    if ERROR.match(text):
        return FAILED
    if text.endswith("%"):
        return UNCLEAR
    number = NUMBER.match(text)
    unit = text[number.end() :].strip(BRACKETS) if number else ""
    if HAS_UNIT.search(unit):
        return WITH + unit[:LONGEST_UNIT]
    return OTHERWISE if number and not unit and differs(number[0], float(value)) else None
