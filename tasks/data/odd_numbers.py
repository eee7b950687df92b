"""Numbers that a test of tissue hardly has: limits of a sensor, overflows, gaps in time, a force like a motion."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.quantities import BASE_UNITS
from sinew.tasks.drawing.blocks import number

Array = np.ndarray[Any, np.dtype[Any]]
FEWEST_ROWS = 10  # in which a gap can be seen
AT_LIMIT, MOVED = 5, 0.02  # rows with the largest force, and the part of the way of the motion meanwhile
TURNED = 0.4  # of the range of the force, on either side of zero: a converter that overflows
GAP, USUAL = 50.0, 10.0  # times the steps beside a gap, and the usual step
EVEN, UNEVEN, MOST = 0.02, 0.2, 0.98  # deviations from the usual step, in units of it; the part of the rows


def odd_numbers(columns: Sequence[Column], numbers: Array) -> Iterator[str]:
    """A line for each odd thing in numbers ``[t, 3]`` in s, mm and N (or 1 and MPa)."""
    time, moved, load = numbers.T
    name, unit = columns[2].quantity.name, BASE_UNITS.get(columns[2].quantity.name, "")
    for row, count in _at_limit(moved, load):
        yield (
            f"the {name} stays at exactly {number(load[row], 6)} {unit}, its largest value, in {count:,} rows while "
            f"the {columns[1].quantity.name} goes on; it may be the limit of the load cell"
        )
    if _rises_evenly(load) and not _rises_evenly(moved, UNEVEN):
        yield (
            f"the {name} rises by the same amount from row to row, as a motion does, and the "
            f"{columns[1].quantity.name} does not; the two titles may be exchanged: compare them with the test, and "
            "name the columns with --displacement-column and --force-column"
        )
    reach = float(np.ptp(load))
    both = np.minimum(np.abs(load[1:]), np.abs(load[:-1]))
    over = np.flatnonzero((both > TURNED * reach) & (load[1:] * load[:-1] < 0))
    if over.size:
        before, after = (number(load[at], 6) for at in (over[0], over[0] + 1))
        yield (
            f"the {name} turns from {before} to {after} {unit} from one row to the next, at "
            f"{number(time[over[0] + 1], 6)} s; a converter may have overflowed"
        )
    if columns[0].place != NOWHERE:
        yield from _gaps(time)


def _rises_evenly(numbers: Array, within: float = EVEN) -> bool:
    """Whether nearly all numbers rise by the same step; measured forces never do."""
    steps = np.diff(numbers)
    usual = float(np.median(steps)) if steps.size >= FEWEST_ROWS else 0.0
    return usual > 0 and float((np.abs(steps - usual) <= within * usual).mean()) >= MOST


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
            f"times go on from {number(time[row], 6)} to {number(time[row + 1], 6)} s from one row to the next; rows"
            " may be missing in between"
        )
