"""Tests that have times, ways and forces and are no tension or compression of a bar, and columns that say one thing."""

import re
from collections.abc import Sequence

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.length_columns import numbers_of
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
    turning = [place for place, title in enumerate(table.titles) if _TURNING.search(title) and _moves(table, place)]
    if turning and any(map(_TORQUE.search, table.titles)):
        title = shown(table.titles[turning[0]])
        raise BadInput(table.path, f"{title} and a torque: a test that turns the specimen", EXPECTED_ALONG)


def _refuse_same(table: Table, motion: Column | None, load: Column | None) -> None:
    """Refuse a force that is the displacement, number by number: one of the two was written twice."""
    if motion is None or load is None or NOWHERE in (motion.place, load.place):
        return
    rows = range(len(table.rows))
    one, other = (numbers_of(table, column, rows) / column.factor for column in (motion, load))
    same = (one == other) | (np.isnan(one) & np.isnan(other))
    measured = np.unique(one[np.isfinite(one)])
    if same.all() and measured.size >= FEWEST and (measured % 1.0 != 0.0).any():
        problem = f"{shown(motion.title)} and {shown(load.title)} hold the same numbers in all rows"
        raise BadInput(table.path, problem, "another column, by --displacement-column or --force-column")


def _moves(table: Table, place: int) -> bool:
    """Whether most numbers of a column are not zero."""
    numbers = [table.number(row, place) for row in range(len(table.rows))]
    return 2 * sum(bool(number) for number in numbers) > len(numbers)
