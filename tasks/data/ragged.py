"""Rows with more or fewer cells than there are columns: marks for thousands, cells that are missing."""

import re
from collections import Counter
from collections.abc import Sequence

from sinew.runner.errors import BadInput
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number

_NO_NUMBER = re.compile(r"[-+]?(?:nan|inf)|-+|[*]+", re.IGNORECASE)  # between spaces, in place of a number


def refuse_ragged(table: Table, rows: range) -> None:
    """Raises :class:`BadInput` for the first of ``rows`` whose numbers may stand under other titles than their own.

    A number beyond all titles may be the rest of one that is cut in two. A row with fewer cells than most may lack one
    in its middle, unless all rows from there on lack several: then a shorter table beside it has ended. Between
    spaces, where no cell is empty, numbers count in place of cells.
    """
    sizes = [_size(table, table.rows[at][1]) for at in rows]
    usual = Counter(sizes).most_common(1)[0][0]
    most = max(len(table.titles), usual)
    whole = max(at for at, size in enumerate(sizes) if size >= usual)
    for at, size in enumerate(sizes):
        number, row = table.rows[rows[at]]
        fewer = size < usual and (at < whole or usual - size == 1 or table.separator == " ")
        fewer = fewer and table.separator != ""  # no cell of a sheet is missing
        if not fewer and (len(row) <= most or not _count(row[most:], table.decimal)):
            continue
        expected = "as many in each row as it has titles, without marks for thousands"
        if table.separator == " ":
            expected += " and without blank cells, which nobody sees between spaces"
        elif table.separator == table.decimal or table.separator == ",":
            expected += ", and another mark between columns than the decimal mark"
        problem = f"{_count(row, table.decimal)} numbers under {most} columns"
        raise BadInput(f"{table.path}: row {number}", problem, expected)


def _size(table: Table, row: Sequence[str]) -> int:
    """How many cells a row has below titles, or up to its last number; between spaces, numbers and marks of none."""
    if table.separator == " ":
        return _count(row, table.decimal) + sum(_NO_NUMBER.fullmatch(cell) is not None for cell in row)
    if len(row) <= len(table.titles):
        return len(row)
    last = max((at for at, cell in enumerate(row, start=1) if is_number(cell, table.decimal)), default=0)
    return max(min(len(row), len(table.titles)), last)


def _count(cells: Sequence[str], decimal: str) -> int:
    """How many cells hold numbers."""
    return sum(is_number(cell, decimal) for cell in cells)
