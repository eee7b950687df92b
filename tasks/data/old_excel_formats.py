"""How the cells of an old workbook of Excel (.xls) are shown, and what of it is hidden."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

from sinew.tasks.data.number_formats import shown_by
from sinew.tasks.data.sheet_look import Look, TooMuch

STREAMS = ("workbook", "book")  # of a file; programs of 1995 write the second one
LOCKED = "encryptedpackage"
AS_XLSX = "the same saved as .xlsx"


def looks_of_xls(content: bytes) -> dict[str, Look]:
    """How the sheets are shown, by their names. Raises :class:`TooMuch`, and what xlrd does for no compound file."""
    from xlrd.compdoc import CompDoc  # in the process that reads spreadsheets only

    with open(os.devnull, "w") as log:  # xlrd would write its remarks among the lines of this process
        entries = CompDoc(content, logfile=log, ignore_workbook_corruption=True).dirlist
        _refuse_others([entry.name.casefold() for entry in entries])
        try:
            return _looks(content, log)
        except MemoryError:
            raise
        except Exception as error:  # what xlrd raises for broken workbooks is no closed list
            problem = f"the formats of its cells cannot be read ({str(error)[:100] or type(error).__name__})"
            raise TooMuch(problem, AS_XLSX) from error


def _refuse_others(names: Sequence[str]) -> None:
    """Refuse a compound file with these streams that holds no workbook or several.

    The library that reads the numbers takes the first of a name, wherever it is.
    """
    counts = [names.count(stream) for stream in STREAMS]
    if LOCKED in names:
        raise TooMuch("locked by a password", "the same without a password")
    if not any(counts):
        raise TooMuch("no workbook in it", AS_XLSX)
    if max(counts) > 1:
        raise TooMuch("several workbooks in one file, as of an embedded table", AS_XLSX)


def _looks(content: bytes, log: Any) -> dict[str, Look]:
    import xlrd

    with xlrd.open_workbook(
        file_contents=content, formatting_info=True, ragged_rows=True, logfile=log, ignore_workbook_corruption=True
    ) as book:
        codes = [book.format_map[xf.format_key].format_str for xf in book.xf_list]
        ways = {style: way for style, code in enumerate(codes) if (way := shown_by(code)) is not None}
        return {sheet.name: _look_of_sheet(sheet, ways) for sheet in book.sheets()}


def _look_of_sheet(sheet: Any, ways: Mapping[int, str]) -> Look:
    """The look of a sheet of xlrd. ``ways``: how those styles show numbers that do not show them as they are."""
    found = Look()
    found.rows.update(row + 1 for row, info in sheet.rowinfo_map.items() if info.hidden or info.height == 0)
    found.columns.update(column + 1 for column, info in sheet.colinfo_map.items() if info.hidden or info.width == 0)
    for row in range(sheet.nrows if ways else 0):
        shown = ((at, ways.get(sheet.cell_xf_index(row, at))) for at in range(sheet.row_len(row)))
        if others := {at: way for at, way in shown if way is not None}:
            found.cells[row] = others
    return found
