"""Rows of words among and below the numbers of a table, and a last row that ends within a number."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import words
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.heads import Row, is_row_of_units, joined
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.layout import RUN
from sinew.tasks.data.sizes import named_in
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number
from sinew.tasks.data.told_lines import tells_factor, tells_unit

FEWEST_ROWS = 10  # in which the same decimals tell that a last number is cut off
_OF_TIMES = re.compile(r"\d|\b[AP]M\b")
_COMMENT = re.compile(r"#|%|//|;")
_TEST = re.compile(rf"\b(?:{'|'.join(word for word in words.TESTS if len(word) > 2)})\b", re.IGNORECASE)


def names_test(rows: Sequence[Row]) -> bool:
    """Whether a row names a test, a specimen or the like: ``Specimen B``."""
    return any(_TEST.search(cell) for row in rows for cell in row)


def says_more(above: Iterable[Row], first: Sequence[Row]) -> bool:
    """Whether the rows ``above`` further tables say more than those above the ``first`` one, but for the time.

    Some programs write a long record in tables, with the same words above each of them, and when that one was written.
    """
    known = {_without_time(row) for row in first}
    return any(_without_time(row) not in known for row in above if any(row))


def _without_time(row: Row) -> str:
    told = any(cell.rstrip(": ").lower() in words.TIME for cell in row)
    return _OF_TIMES.sub("", joined(row)) if told else joined(row)


def without_words(table: Table, columns: Sequence[Column], hints: Hints) -> tuple[Table, tuple[str, ...]]:
    """A table without its rows of words, such as events and what stands below the numbers, and a remark on them.

    A row with words in the places of all ``columns`` stays, to be refused: numbers may have been meant. Raises
    :class:`BadInput` for words that may change what the numbers mean.
    """
    if hints.test_column is not None or hints.cycle_column is not None:
        return table, ()  # they may name what is below them
    places = [column.place for column in columns if column.place != NOWHERE]
    unread = np.isnan(table.numbers(places[0])) if places else np.ones(len(table.rows))
    left = {at for at in np.flatnonzero(unread).tolist() if _is_words(table.rows[at][1], places, table.decimal)}
    if not left:
        return table, ()
    others = [at for at, (_, row) in enumerate(table.rows) if at not in left and any(row)]
    for at in sorted(left):
        _refuse(table, at, others)
    rows = [each for at, each in enumerate(table.rows) if at not in left]
    while not any(rows[-1][1]):  # blank lines above words at the end
        rows.pop()
    at, row = table.rows[min(left)]
    count = len(left)
    told = f"row {at} holds no number" if count == 1 else f"{count:,} rows hold no number, the first is row {at}"
    return replace(table, rows=rows), (f"{told}: {shown(joined(row), 60)}; left out",)


def _is_words(row: Row, places: Sequence[int], decimal: str) -> bool:
    if not any(row) or any(is_number(cell, decimal) for cell in row):
        return False
    filled = sum(place < len(row) and bool(row[place]) for place in places)
    return filled < len(places) or bool(_COMMENT.match(joined(row)))


def _refuse(table: Table, at: int, numbers: Sequence[int]) -> None:
    """Raises :class:`BadInput` for a row of words that tells something of the numbers, or begins something else."""
    number, row = table.rows[at]
    row = (row[0].lstrip("#%/; "), *row[1:])
    text, where = joined(row), f"{table.path}: row {number}"
    behind = sum(other > at for other in numbers)
    if tells_unit(text) or tells_factor(text) or is_row_of_units(row) or named_in(text):
        raise BadInput(where, f"{shown(text, 60)} below numbers", "units, factors and sizes above the table")
    if behind and _TEST.search(text):
        raise BadInput(where, f"{shown(text, 60)} may begin another test", "a file for each test, or titles above each")
    if 0 < behind < RUN:
        numbered = "row" if behind == 1 else "rows"
        problem = f"{shown(text, 60)}, and behind it {behind} {numbered} of numbers, which may be results"
        raise BadInput(where, problem, "a table that ends with the last measured row")


def cut_off(table: Table, columns: Sequence[Column], rows: int) -> bool:
    """Whether the last of so many ``rows`` ends within a number: it has fewer decimals than all those above it.

    So it may only be where a text ends without the end of its last line.
    """
    if rows <= FEWEST_ROWS or rows != len(table.rows) or table.sheet:
        return False
    last = table.rows[rows - 1][1]
    place = len(last) - 1
    if not last or not is_number(last[-1], table.decimal) or place not in {column.place for column in columns}:
        return False
    ours, before = _decimals(last[place], table.decimal), table.rows[rows - 2][1]
    if place < len(before) and len(ours) >= len(_decimals(before[place], table.decimal)):
        return False
    above = {_decimals(row[place], table.decimal) for _, row in table.rows[: rows - 1] if place < len(row)}
    return len(above) == 1 and len(ours) < len(next(iter(above))) and not _ends_a_line(table)


def _ends_a_line(table: Table) -> bool:
    with table.path.open("rb") as file:
        file.seek(-2, 2)
        return any(each in file.read() for each in (b"\n", b"\r"))


def _decimals(cell: str, mark: str) -> str:
    """What stands behind the decimal mark, with a 0 for each digit: ``000e-00``."""
    return re.sub(r"\d", "0", cell.partition(mark)[2])
