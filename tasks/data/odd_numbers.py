"""Numbers that no test of tissue has: marks of what was not measured, limits of a sensor, gaps, a row cut off."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import words
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.heads import Row
from sinew.tasks.data.quantities import BASE_UNITS
from sinew.tasks.data.sizes import narrow
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number
from sinew.tasks.drawing.blocks import number

Array = np.ndarray[Any, np.dtype[Any]]
_MARK = re.compile(r"-?9{3,7}(?:[.,]9*0*)?")  # -999, 9999.0, 999.9
_FACTOR_LINE = re.compile(
    rf"(?:{'|'.join(map(re.escape, (*words.DISPLACEMENT[:9], *words.FORCE[:9], *words.TIME[:6])))})\b[\w ]{{0,30}}"
    r"(?:scale|scaling|multipl|factor|faktor|facteur)[\w ]{0,20}[:=]? ?(?P<value>[-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)",
    re.IGNORECASE,
)
_LONGEST_LINE = 100  # characters of a line that tells a factor
BEYOND = 10.0  # times the largest other number: a mark of what was not measured
FEWEST_ROWS = 10  # in which the same decimals tell that a last number is cut off
AT_LIMIT, MOVED = 5, 0.02  # rows with the largest force, and the part of the way of the motion meanwhile
TURNED = 0.4  # of the range of the force, on either side of zero: a converter that overflows
GAP, USUAL = 50.0, 10.0  # times the steps beside a gap, and the usual step


def refuse_marks(table: Table, columns: Sequence[Column], numbers: Array, start: int) -> None:
    """Refuse numbers ``[t, 3]``, as the file has them, that mark what was not measured, such as -999.

    They begin in row ``start`` of the table. Raises :class:`BadInput`.
    """
    for values, column in list(zip(numbers.T, columns, strict=True))[1:]:
        largest = np.abs(values).max(initial=0.0)
        at = int(np.argmax(np.abs(values)))
        others = np.abs(values[np.abs(values) < largest]).max(initial=0.0)
        cell = table.rows[start + at][1][column.place]
        if largest > BEYOND * others > 0 and _MARK.fullmatch(cell):
            where = f"{table.path}: row {table.rows[start + at][0]}, {column.title or column.quantity.name}"
            problem = f"{shown(cell)}, where no other number is above {number(others)}: a usual mark of no measurement"
            raise BadInput(where, problem, "a file without such rows")


def without_words(table: Table) -> tuple[Table, tuple[str, ...]]:
    """A table without its rows of words, such as events and what stands below the numbers, and a remark on them."""
    rows, left = list[tuple[int, Row]](), list[tuple[int, Row]]()
    for each in table.rows:
        words = any(each[1]) and not any(is_number(cell, table.decimal) for cell in each[1])
        (left if words else rows).append(each)
    if not left:
        return table, ()
    while not any(rows[-1][1]):  # blank lines above words at the end
        rows.pop()
    at, row = left[0]
    said = shown(" ".join(filter(None, row)), 60)
    count = len(left)
    told = f"row {at} holds no number" if count == 1 else f"{count:,} rows hold no number, the first is row {at}"
    return replace(table, rows=rows), (f"{told}: {said}; left out",)


def cut_off(table: Table, columns: Sequence[Column], rows: int) -> bool:
    """Whether the last of so many ``rows`` ends within a number: it has fewer decimals than all those above it."""
    if rows <= FEWEST_ROWS or rows != len(table.rows):
        return False
    last = table.rows[rows - 1][1]
    place = len(last) - 1
    if not last or not is_number(last[-1], table.decimal) or place not in {column.place for column in columns}:
        return False
    above = {_decimals(row[place], table.decimal) for _, row in table.rows[: rows - 1] if place < len(row)}
    ours = _decimals(last[place], table.decimal)
    return len(above) == 1 and len(ours) < len(next(iter(above)))


def _decimals(cell: str, mark: str) -> str:
    """What stands behind the decimal mark, with a 0 for each digit: ``000e-00``."""
    return re.sub(r"\d", "0", cell.partition(mark)[2])


def told_factors(header: Sequence[Row]) -> Iterator[str]:
    """A line for each factor of a column that a line above the table tells and that is not 1: ``Load scale factor``."""
    for row in narrow(header):
        found = _FACTOR_LINE.match(" ".join(cell for cell in row if cell)[:_LONGEST_LINE])
        if found is not None and float(found["value"].replace(",", ".")) not in (0.0, 1.0):
            yield f"the file tells {shown(found[0])}; numbers are read as they stand, without it"


def odd_numbers(columns: Sequence[Column], numbers: Array) -> Iterator[str]:
    """A line for each odd thing in numbers ``[t, 3]`` in s, mm and N (or 1 and MPa)."""
    time, moved, load = numbers.T
    name, unit = columns[2].quantity.name, BASE_UNITS.get(columns[2].quantity.name, "")
    for row, count in _at_limit(moved, load):
        yield (
            f"the {name} stays at exactly {number(load[row], 6)} {unit}, its largest value, in {count:,} rows while "
            f"the {columns[1].quantity.name} goes on; it may be the limit of the load cell"
        )
    reach = float(np.ptp(load))
    both = np.minimum(np.abs(load[1:]), np.abs(load[:-1]))
    over = np.flatnonzero((both > TURNED * reach) & (load[1:] * load[:-1] < 0))
    if over.size:
        before, after = (number(load[at], 6) for at in (over[0], over[0] + 1))
        yield (
            f"the {name} turns from {before} to {after} {unit} from one row to the next, at "
            f"{number(time[over[0] + 1], 6)} s; a converter may have overflown"
        )
    if columns[0].place != NOWHERE:
        yield from _gaps(time)


def _at_limit(moved: Array, load: Array) -> Iterator[tuple[int, int]]:
    """The first row and the number of rows of the longest run with the largest force, if the motion goes on in it."""
    size = np.abs(load)
    if not size.max(initial=0.0):
        return
    same = np.flatnonzero((size == size.max()) & (np.sign(load) == np.sign(load[int(np.argmax(size))])))
    runs = np.split(same, np.flatnonzero(np.diff(same) > 1) + 1)
    longest = max(runs, key=len)
    if len(longest) >= AT_LIMIT and np.ptp(moved[longest]) > MOVED * np.ptp(moved):
        yield int(longest[0]), len(longest)


def _gaps(time: Array) -> Iterator[str]:
    """A line on the largest step of time that is far longer than those beside it."""
    steps = np.diff(time)
    if steps.size < FEWEST_ROWS or steps.min() <= 0:
        return
    beside = np.maximum(steps[:-2], steps[2:])
    far = (steps[1:-1] > GAP * beside) & (steps[1:-1] > USUAL * np.median(steps))
    if far.any():
        row = 1 + int(np.argmax(np.where(far, steps[1:-1], 0.0)))
        yield (
            f"times go on from {number(time[row], 6)} to {number(time[row + 1], 6)} s from one row to the next; nothing"
            " may have been recorded in between"
        )
