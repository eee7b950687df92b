"""How the cells of a binary workbook of Excel (.xlsb) are shown, and what of it is hidden.

Its parts are records: a kind and a size, of 7 bits in each byte, and the content. [MS-XLSB] describes them.
"""

import struct
import zipfile
from collections.abc import Iterator

from sinew.tasks.data.excel_formats import AS_EXCEL, LAST_COLUMN, PERCENT_FORMATS, Styles, relations_of
from sinew.tasks.data.number_formats import PERCENT, shown_by
from sinew.tasks.data.sheet_look import Look, TooMuch

ROW, FORMAT, STYLE, COLUMNS, SHEET = 0, 44, 47, 60, 156  # kinds of records
BEGIN_CELLS, END_CELLS, BEGIN_STYLES, END_STYLES = 145, 146, 617, 618
#: The fewest bytes of a cell by its kind: empty, numbers, errors, truths, texts, and the same of formulas.
CELLS = {1: 8, 2: 12, 3: 9, 4: 9, 5: 16, 6: 12, 7: 12, 8: 12, 9: 16, 10: 9, 11: 9, 62: 13}
NUMBERS = (2, 5, 9)
SHORT_CELLS = range(12, 19)  # the library that reads the numbers passes them over
FEWEST = {ROW: 17, FORMAT: 6, STYLE: 16, COLUMNS: 18, SHEET: 16, **CELLS}
ROW_HIDDEN, COLUMN_HIDDEN = 0x10, 0x01


def looks_of_xlsb(archive: zipfile.ZipFile, members: dict[str, str]) -> dict[str, Look]:
    """How the sheets are shown, by their names. Raises :class:`TooMuch`, and ``ValueError`` for broken records."""
    relations = relations_of(archive, members, "xl/_rels/workbook.bin.rels")
    style_path = next((path for path, kind in relations.values() if kind.endswith("/styles")), "")
    styles = _styles(archive.read(members[style_path])) if style_path in members else Styles()
    found = {}
    for kind, content in records(archive.read(members["xl/workbook.bin"])):
        if kind == SHEET:
            link, end = _text(content, 8)
            name, _ = _text(content, end)
            path = relations.get(link, ("", ""))[0]
            if path not in members:
                raise TooMuch("one of its sheets is not found", AS_EXCEL)
            found[name] = _look_of_sheet(archive.read(members[path]), styles)
    return found


def records(content: bytes) -> Iterator[tuple[int, bytes]]:
    """The records of a part: kind and content. Raises ``ValueError`` for one that is too short."""
    at = 0
    while at < len(content):
        kind, at = _number(content, at, 2)
        size, at = _number(content, at, 4)
        if at + size > len(content) or size < FEWEST.get(kind, 0):
            raise ValueError("a record that is cut short")
        yield kind, content[at : at + size]
        at += size


def _number(content: bytes, at: int, most: int) -> tuple[int, int]:
    """A number of 7 bits in each of ``most`` bytes at most, and where it ends."""
    value = 0
    for place in range(most):
        if at >= len(content):
            raise ValueError("a record that is cut short")
        byte = content[at]
        value |= (byte & 0x7F) << 7 * place
        at += 1
        if not byte & 0x80:
            break
    return value, at


def _text(content: bytes, at: int) -> tuple[str, int]:
    """A text with the number of its characters in front, and where it ends."""
    (count,) = struct.unpack_from("<I", content, at)
    end = at + 4 + 2 * count
    if end > len(content):
        raise ValueError("a text that is cut short")
    return content[at + 4 : end].decode("utf-16-le", "replace"), end


def _styles(content: bytes) -> Styles:
    """The styles that do not show numbers as they are."""
    formats: dict[int, str | None] = dict.fromkeys(PERCENT_FORMATS, PERCENT)
    found, inside, count = Styles(), False, 0
    for kind, record in records(content):
        if kind == FORMAT:
            formats[struct.unpack_from("<H", record)[0]] = shown_by(_text(record, 2)[0])
        elif kind in (BEGIN_STYLES, END_STYLES):
            inside = kind == BEGIN_STYLES
        elif kind == STYLE and inside:
            if (shown := formats.get(struct.unpack_from("<H", record, 2)[0])) is not None:
                found.cells[count] = shown
            count += 1
    return found


def _look_of_sheet(content: bytes, styles: Styles) -> Look:
    """How a sheet is shown. Raises :class:`TooMuch` for cells that Excel does not write so, such as one twice."""
    found = Look()
    begun, row, before = 0, -1, -1
    for kind, record in records(content):
        if kind == BEGIN_CELLS:
            begun += 1
        elif kind == COLUMNS:
            first, last, _, _, flags = struct.unpack_from("<IIIIH", record)
            if flags & COLUMN_HIDDEN:
                found.columns.update(range(first + 1, min(last + 1, LAST_COLUMN) + 1))
        elif kind == ROW:
            (number,) = struct.unpack_from("<I", record)
            if number <= row:
                raise TooMuch(f"two rows {number + 1}, or one out of order", "one")
            row, before = number, -1
            if record[11] & ROW_HIDDEN:
                found.rows.add(row + 1)
        elif kind in SHORT_CELLS:
            raise TooMuch("cells without their columns", AS_EXCEL)
        elif kind in CELLS:
            column, style = struct.unpack_from("<II", record)
            if column <= before:
                raise TooMuch(f"two cells in row {row + 1}, column {column + 1}, or one out of order", "one")
            before = column
            if kind in NUMBERS and (shown := styles.cells.get(style & 0xFFFFFF)) is not None:
                found.cells.setdefault(row, {})[column] = shown
    if begun > 1:  # a chart has none
        raise TooMuch(f"a sheet with {begun} tables of cells", AS_EXCEL)
    return found
