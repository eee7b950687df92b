"""Tables of a file that are left out: whether they may be tests, and what is said of them."""

from collections.abc import Sequence
from dataclasses import replace

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import NOWHERE, Column, recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.questions import NoColumn, Unclear
from sinew.tasks.data.several import FEWEST_ROWS, TABLES
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number

LONG = 10  # rows of a table on another sheet, which may be a test
#: What a person says of the columns of one table, which tells nothing of another.
OF_ONE_TABLE = ("time_column", "displacement_column", "force_column", "rate_hz", "speed", "speed_column")


def may_be_test(table: Table, hints: Hints, first: Table) -> bool:
    """Whether a table has columns of time, motion and load, even if a person had to tell more of them.

    Or numbers in the same columns as the ``first`` table of its sheet.
    """
    if len(table.rows) < FEWEST_ROWS:
        return False
    try:
        recognise(table, hints)
    except NoColumn:
        if hints.columns_given and table.sheet != first.sheet:  # whose columns may have other titles there
            return len(table.rows) >= LONG
        here, there = ([is_number(cell, one.decimal) for cell in one.rows[0][1]] for one in (table, first))
        return table.sheet == first.sheet and here == there
    except BadInput:
        pass
    return True


def is_test(table: Table, hints: Hints) -> bool:
    """Whether a table surely has columns of time, motion and load by their titles, of enough rows."""
    if len(table.rows) < FEWEST_ROWS:
        return False
    try:
        recognise(table, replace(hints, **dict.fromkeys(OF_ONE_TABLE)))
    except BadInput:
        return False
    return True


def has_columns(table: Table, hints: Hints, columns: Sequence[Column]) -> bool:
    """Whether a table has these columns of time, motion and load in the same places, and perhaps others beside them."""
    if not all(column.title and column.place != NOWHERE for column in columns):
        return False
    try:
        found = recognise(table, hints, first_of_alike=True)
    except BadInput:
        return False
    return all(one.is_as(other) for one, other in zip(found, columns, strict=True))


def unclear_further(table: Table) -> Unclear:
    """The question on a ``table`` that is a test, but has other titles than the first one."""
    return Unclear(
        str(table.path),
        f"the table in {_where(table)} has other titles than the first one, and is a test",
        f"a file for each, or {TABLES} first to leave it out",
        what="tests",
        which="leave out tables with other titles?",
        option=TABLES,
        choices=("first",),
    )


def left_out_note(tables: Sequence[Table]) -> str:
    """A note on tables that may be tests, but have other titles than the first one."""
    where = _where(tables[0])
    if len(tables) == 1:
        told = f"the table in {where} has other titles and is left out"
    else:
        told = f"{len(tables)} tables, the first in {where}, have other titles and are left out"
    return f"{told}; a test needs a file of its own{', or --sheet' if tables[0].sheet else ''}"


def _where(table: Table) -> str:
    sheet = f"sheet '{table.sheet}', " if table.sheet else ""
    return f"{sheet}row {table.title_row or table.first}"
