"""Rows with more or fewer numbers than there are columns: marks for thousands, blank cells between spaces."""

from collections.abc import Iterable

from sinew.runner.errors import BadInput
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number


def refuse_ragged(table: Table, rows: Iterable[int]) -> None:
    """Raises :class:`BadInput` for the first of ``rows`` whose numbers may stand under other titles than their own.

    A number beyond all titles may be the rest of one that is cut in two. Between spaces, blank cells are not seen.
    """
    width = len(table.rows[0][1])
    most = max(len(table.titles), width)
    for at, row in (table.rows[place] for place in rows):
        beyond = [cell for cell in row[most:] if is_number(cell, table.decimal)]
        between_spaces = table.separator == " " and (len(row) < width or (beyond and len(row) > width))
        if not (beyond or between_spaces):
            continue
        expected = "as many numbers in each row, without marks for thousands"
        if table.separator == " ":
            expected += " and without blank cells, which nobody sees between spaces"
        elif table.separator == table.decimal or table.separator == ",":
            expected += ", and another mark between columns than the decimal mark"
        count = sum(is_number(cell, table.decimal) for cell in row)
        raise BadInput(f"{table.path}: row {at}", f"{count} numbers under {most} columns", expected)
