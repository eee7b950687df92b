"""Tests one under another in a table that no column tells apart: the time begins again, or without one the motion."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.data.cell_numbers import empty_row
from sinew.tasks.data.columns import NOWHERE
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.several import FEWEST_ROWS, TABLES, Block, going_on
from sinew.tasks.data.tables import Table

NEAR = 0.1  # of the range of the first test: another one begins that near to where it began
BACK, USUAL = 0.5, 5.0  # of the range of the test before, and in usual steps: how far a motion goes back in one row
UNLOADED = 0.25  # of the range of the load: so far it goes back in one row where another test begins at rest
MOST = 500  # tests one under another
APART, JOIN = "apart", "join"
Array = np.ndarray[Any, np.dtype[Any]]


def restarts(time_s: Array, moved: Array, load: Array) -> list[int]:
    """The rows in which tests begin again; none where one would have fewer rows than a test has, or there are many.

    Each time ``[t]`` that goes back must go back to about where the first test began. Times that are all the same tell
    nothing; then a motion ``[t]`` begins again that goes back in one row, as the load does, and moves on from there.
    (Where the load goes on, the motion is only set to zero.) The motion may also rest where it began, as along one axis
    of two, while the load goes back.
    """
    timed = bool(np.ptp(time_s)) if time_s.size else False
    found = _of_times(time_s) if timed else _of_motion(moved, load)
    lengths = np.diff([0, *found, len(moved)])
    return found if 0 < len(found) < MOST and lengths.min() >= FEWEST_ROWS else []


def _of_times(time_s: Array) -> list[int]:
    back = 1 + np.flatnonzero(np.diff(time_s) < 0)
    if not back.size:
        return []
    span = float(np.ptp(time_s[: back[0]]))
    return back.tolist() if (np.abs(time_s[back] - time_s[0]) <= NEAR * span).all() else []


def _of_motion(moved: Array, load: Array) -> list[int]:
    if moved.size < FEWEST_ROWS:
        return []
    steps, falls = np.abs(np.diff(moved)), np.abs(np.diff(load))
    near = np.abs(moved[1:] - moved[0]) <= NEAR * np.ptp(moved)
    far = (steps > USUAL * np.median(steps)) | (falls > USUAL * np.median(falls))
    back = 1 + np.flatnonzero(far & near)
    found: list[int] = []
    span = 0.0
    for row in back.tolist() if back.size < MOST else ():
        start = found[-1] if found else 0
        before = moved[start:row]
        span = span or float(np.ptp(before))  # of the first test, once it has moved
        range_of_load = float(np.ptp(load[:row]))
        begins = abs(moved[row] - moved[0]) <= NEAR * span and abs(load[row] - load[0]) <= NEAR * range_of_load
        next_rows = slice(row, row + len(before))
        moves_on = np.ptp(moved[next_rows]) > NEAR * span or np.ptp(load[next_rows]) > NEAR * range_of_load
        unloaded = abs(load[row] - load[row - 1]) > UNLOADED * np.ptp(load) and _goes_back(load, start, row)
        if begins and moves_on and (_goes_back(moved, start, row) or unloaded):
            found.append(row)
    return found


def _goes_back(values: Array, start: int, row: int) -> bool:
    """Whether ``values`` ``[t]`` of a test from ``start`` on go back in a ``row``, and go on from there.

    A single point that is wrong goes back as far in the next row.
    """
    before = values[start:row]
    back = abs(values[row] - before[-1])
    goes_on = row + 1 < len(values) and abs(values[row + 1] - values[row]) <= back / USUAL
    return bool(goes_on and back > BACK * np.ptp(before) > 0)


def without_gaps(table: Table) -> tuple[Table, tuple[int, ...]]:
    """A table without its empty rows, and the numbers in the file of the rows behind them."""
    filled = [row for row in table.rows if any(row[1])]
    if len(filled) == len(table.rows):
        return table, ()
    behind = tuple(row for (_, before), (row, cells) in pairwise(table.rows) if any(cells) and not any(before))
    return replace(table, rows=filled), behind


def tests_again(recording: Recording, gaps: Sequence[int], hints: Hints) -> list[Recording]:
    """The tests one under another in what was read as one test, as a person says; itself where there is only one.

    ``gaps``: rows of the file with empty ones above them, which may only stand between tests. Raises :class:`Unclear`
    where nobody has said whether the tests are apart.
    """
    time_s, moved, load = recording.numbers.T
    if recording.columns[0].place == NOWHERE:  # times that are told go on
        time_s = np.zeros(len(moved))
    told = recording.remedy or hints.cycle_column is not None  # by a column
    found = [] if told else restarts(time_s, moved, load)
    first = recording.rows[0]
    inside = sorted({row for row in gaps if row > first} - {recording.rows[row] for row in found})
    goes_on = "times go on there" if (np.diff(time_s) > 0).all() else ""  # so nothing else begins there
    if len(inside) == len(recording.rows) - 1:
        goes_on = goes_on or "each row has one below it"
    if inside and not found and goes_on:
        rows = "row among the numbers is" if len(inside) == 1 else "rows among the numbers are"
        note = f"{len(inside)} empty {rows} passed over, the first above row {inside[0]}: {goes_on}"
        recording, inside = replace(recording, notes=(*recording.notes, note)), []
    if inside:
        raise empty_row(recording.path, inside[0] - 1)
    if not found:
        return [recording]
    blocks = [Block("", start, end) for start, end in zip([0, *found], [*found, len(recording.rows)], strict=True)]
    if hints.tables not in (APART, JOIN):
        raise _unclear(recording.path, _begins_again(found, recording.rows, timed=bool(np.ptp(time_s))))
    if hints.tables == JOIN:
        numbers = recording.numbers.copy()
        numbers[:, 0] = going_on(numbers[:, 0], blocks)
        note = f"{len(blocks)} tests one under another are read as one, as {TABLES} says"
        return [replace(recording, numbers=numbers, notes=(*recording.notes, note))]
    return [_part(recording, block, number) for number, block in enumerate(blocks, start=1)]


def rows_again(numbers: Array) -> list[int]:
    """The rows of ``numbers`` ``[t, 3]`` in which tests begin again; NaN where a cell has none, or no column."""
    filled = np.flatnonzero(np.isfinite(numbers).any(axis=1))
    return list(map(int, filled[restarts(*np.nan_to_num(numbers[filled]).T)])) if filled.size else []


def tests_below(table: Table, found: Sequence[int], hints: Hints, *, timed: bool) -> tuple[int, tuple[str, ...]]:
    """How many tests a table holds one under another, where they begin again in rows ``found``; what must be asked.

    ``timed``: the time does, not the motion.
    """
    if hints.tables in (APART, JOIN):
        return (len(found) + 1 if hints.tables == APART else 1), ()
    question = _unclear(table.path, _begins_again(found, [row for row, _ in table.rows], timed=timed))
    return len(found) + 1, (str(question).removeprefix(f"{table.path}: "),)


def _begins_again(found: Sequence[int], rows: Sequence[int], *, timed: bool) -> str:
    """That time or motion begins again, in words; ``rows``: the number in the file of each row of the table."""
    first, *others = (rows[at] for at in found)
    where = f"row {first} and {len(others)} more rows" if others else f"row {first}"
    if len(others) == 1:
        where = f"rows {first} and {others[0]}"
    what = "time" if timed else "motion"
    return f"the {what} begins again in {where}: tests one under another, or one test"


def _part(recording: Recording, block: Block, number: int) -> Recording:
    note = f"rows {recording.rows[block.start]} to {recording.rows[block.end - 1]}, as {TABLES} says"
    part = recording.part(slice(block.start, block.end), note)
    start = part.numbers[0, 0] if recording.columns[0].place == NOWHERE else 0.0  # told times count from the first test
    return replace(part, test=str(number), numbers=part.numbers - [start, 0.0, 0.0])


def _unclear(path: Path, problem: str) -> Unclear:
    return Unclear(
        str(path),
        problem,
        f"{TABLES} {APART} for a test from each such row on, or {TABLES} {JOIN} for one test",
        what="tests",
        which="a test from each such row on, or one in all?",
        option=TABLES,
        choices=(APART, JOIN),
    )
