"""Refuses tests that are neither tension nor compression of a bar, and a force that repeats the displacement."""

import re
from collections.abc import Sequence

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.rows_of_results import EXPECTED_ALONG
from sinew.tasks.data.tables import Table

FEWEST = 50  # numbers that must be alike, some of them with decimals
_TIP = re.compile(r"\boliver\b.{1,10}\bpharr\b|\bnano-?indent|\bberkovich\b|\bvickers\b", re.IGNORECASE)
_TORQUE = re.compile(r"\b(?:torque|drehmoment|couple)\b", re.IGNORECASE)
_TURNING = re.compile(
    r"\b(?:rotational (?:speed|velocity)|angular (?:speed|velocity|frequency)|shear (?:rate|strain)|drehzahl)\b",
    re.IGNORECASE,
)


def refuse_other_tests(table: Table, columns: Sequence[Column | None], hints: Hints) -> None:
    """Raises :class:`BadInput` where a tip indents a surface or a plate turns, unless a person names the columns.

    ``columns``: time, motion and load, None where there is none. Motion and load must not be the same numbers.
    """
    _refuse_same(table, *columns[1:])
    if hints.columns_given:
        return
    told = (cell for row in table.header for cell in row if _TIP.search(cell))
    if (line := next(told, None)) is not None:
        raise BadInput(table.path, f"{shown(line)}: a tip that indents a surface", EXPECTED_ALONG)
    if not any(map(_TORQUE.search, table.titles)):
        return
    for place, title in enumerate(table.titles):
        if _TURNING.search(title) and _moves(table, place):
            raise BadInput(table.path, f"{shown(title)} and a torque: a test that turns the specimen", EXPECTED_ALONG)


def _refuse_same(table: Table, motion: Column | None, load: Column | None) -> None:
    """Refuse a force that is the displacement, number by number: one of the two was written twice."""
    if motion is None or load is None or NOWHERE in (motion.place, load.place):
        return
    measured: set[float] = set()
    for row in range(len(table.rows)):  # nearly always, the first row ends it
        number = table.number(row, motion.place)
        if number != table.number(row, load.place):
            return
        measured |= set() if number is None else {number}
    if len(measured) >= FEWEST and any(number % 1.0 for number in measured):
        problem = f"{shown(motion.title)} and {shown(load.title)} hold the same numbers in all rows"
        raise BadInput(table.path, problem, "another column, by --displacement-column or --force-column")


def _moves(table: Table, place: int) -> bool:
    """Whether most numbers of a column are not zero."""
    numbers = table.numbers(place)
    return bool(2 * np.count_nonzero(np.nan_to_num(numbers)) > numbers.size)
