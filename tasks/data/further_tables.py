"""Tables of a file that are left out: whether they may be tests, and what is said of them."""

from collections.abc import Sequence

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.questions import NoColumn
from sinew.tasks.data.several import FEWEST_ROWS
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number


def may_be_test(table: Table, hints: Hints, first: Table) -> bool:
    """Whether a table has columns of time, motion and load, even if a person had to tell more of them.

    Or numbers in the same columns as the ``first`` table of its sheet.
    """
    if len(table.rows) < FEWEST_ROWS:
        return False
    try:
        recognise(table, hints)
    except NoColumn:
        here, there = ([is_number(cell, one.decimal) for cell in one.rows[0][1]] for one in (table, first))
        return table.sheet == first.sheet and here == there
    except BadInput:
        pass
    return True


def left_out_note(tables: Sequence[Table]) -> str:
    """A note on tables that may be tests, but have other titles than the first one."""
    first = tables[0]
    where = f"sheet '{first.sheet}', " if first.sheet else ""
    where += f"row {first.title_row or first.first}"
    if len(tables) == 1:
        told = f"the table in {where} has other titles and is left out"
    else:
        told = f"{len(tables)} tables, the first in {where}, have other titles and are left out"
    return f"{told}; a test needs a file of its own"
