"""Rows with more or fewer numbers than there are columns: marks for thousands, blank cells between spaces."""

from collections.abc import Iterable, Sequence

from sinew.runner.errors import BadInput
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number


def refuse_ragged(table: Table, rows: Iterable[int]) -> None:
    """Raises :class:`BadInput` for the first of ``rows`` whose numbers may stand under other titles than their own.

    A number beyond all titles may be the rest of one that is cut in two. Between spaces, blank cells are not seen: all
    rows have as many numbers as the first one then.
    """
    first = table.rows[0][1]
    most = max(len(table.titles), len(first))
    usual = _count(first, table.decimal)
    for at, row in (table.rows[place] for place in rows):
        fewer = table.separator == " " and _count(row, table.decimal) < usual
        if not fewer and not _count(row[most:], table.decimal):
            continue
        expected = "as many numbers in each row, without marks for thousands"
        if table.separator == " ":
            expected += " and without blank cells, which nobody sees between spaces"
        elif table.separator == table.decimal or table.separator == ",":
            expected += ", and another mark between columns than the decimal mark"
        problem = f"{_count(row, table.decimal)} numbers under {most} columns"
        raise BadInput(f"{table.path}: row {at}", problem, expected)


def _count(cells: Sequence[str], decimal: str) -> int:
    """How many cells hold numbers."""
    return sum(is_number(cell, decimal) for cell in cells)
