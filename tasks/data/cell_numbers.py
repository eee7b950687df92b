"""The numbers in the cells of a test: an empty or strange one is refused."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.layout import otherwise_marked
from sinew.tasks.data.several import FEWEST_ROWS
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_clock

Array = np.ndarray[Any, Any]
MOST_UNREAD = 3  # rows at the start of a test with an empty cell, or with numbers of another decimal mark


def filled_rows(table: Table, columns: Sequence[Column]) -> int:
    """The number of rows up to the last with anything in these columns: the longest of several tests is beside them."""
    rows = len(table.rows)
    places = [column.place for column in columns if column.place != NOWHERE]
    while rows and not any(table.rows[rows - 1][1][place : place + 1] > ("",) for place in places):
        rows -= 1
    return rows


def unread_at_start(table: Table, columns: Sequence[Column], rows: int) -> tuple[int, str]:
    """How many of the first rows have an empty cell in one of these columns, or numbers with the other decimal mark.

    And a note on them; 0 where these are not just a few.
    """
    places = [column.place for column in columns if column.place != NOWHERE]
    marked = 0
    for row, (_, cells) in enumerate(table.rows[: min(rows, MOST_UNREAD + 1)]):
        other = bool(otherwise_marked(cells, table.decimal))
        if other or not all(cells[place : place + 1] > ("",) for place in places):
            marked += other
            continue
        mark = "a point" if table.decimal == "," else "a comma"
        reason = f"{mark} as decimal mark, unlike those below" if marked else "an empty cell"
        which = f"row {table.rows[0][0]} has" if row == 1 else f"the first {row} rows have"
        return row, f"{which} {reason}, and {'is' if row == 1 else 'are'} left out" if row else ""
    return 0, ""


def empty_row(path: Path, row: int) -> BadInput:
    """The refusal of an empty row among the numbers of a test."""
    expected = "one test without such rows; where they stand between tests, a file for each"
    return BadInput(f"{path}: row {row}", "an empty row among the numbers", expected)


def measured(table: Table, rows: range, columns: Sequence[Column]) -> Array:
    """The numbers ``[t, columns]`` of columns in some rows; 0 for times that no column holds.

    Raises :class:`BadInput` for the first cell without one.
    """
    found = np.zeros((len(rows), len(columns)))
    for at, column in enumerate(columns):
        if column.place != NOWHERE:
            found[:, at] = table.numbers(column.place)[rows]
    if (missing := np.argwhere(np.isnan(found))).size:
        row, at = missing[0].tolist()
        raise _no_number(table, rows[row], columns[at])
    return found


def _no_number(table: Table, row: int, column: Column) -> BadInput:
    """The refusal of a cell without a number in a row of a table."""
    at, cells = table.rows[row]
    cell = cells[column.place] if column.place < len(cells) else ""
    if not any(cells):
        return empty_row(table.path, at)
    where = f"{table.path}: row {at}, {column.title or column.quantity.name}"
    if not cell:
        formula = "; a formula needs the value that Excel or LibreOffice saves with it" if table.sheet else ""
        behind = len(table.rows) - row
        last = table.rows[-1][0]
        rest = f"row {at} if it is" if behind == 1 else f"rows {at} to {last} if they are"
        summary = f"; delete {rest} a summary" if behind < FEWEST_ROWS <= row else ""
        return BadInput(where, "an empty cell", f"a finite number, like those above{formula}{summary}")
    if is_clock(cell) and table.has_clock(column.place):
        return BadInput(where, shown(cell), "a time of the same day as those above, or dates such as 2024-05-03")
    mark = "a point" if table.decimal == "." else "a comma"
    return BadInput(where, shown(cell), f"a finite number with {mark} as decimal mark, like those above")
