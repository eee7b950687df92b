"""Rows with one and the same time: at the start, where a clock does not run yet, or a few at the steps of a machine."""

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
STILL = 0.01  # of the range of motion and load, by which they may change in these rows
FEW = 0.1  # of all rows, at most, or two: at the start
FEW_AGAIN = 0.01  # of all rows, at most: later


def before_clock(numbers: Array) -> int:
    """How many rows of time, motion and load ``[t, 3]`` come before the one with which a test begins.

    0 where the first two times differ, and where times are coarse: something moves in rows with the same time. The
    load alone may, if no later rows have the same time: it is that of another state of the machine.
    """
    time_s, measured = numbers[:, 0], numbers[:, 1:]
    same = int(np.argmax(time_s != time_s[0]))  # 0 where all are
    if not 0 < same <= max(2.0, FEW * len(time_s)):
        return 0
    motion, load = np.ptp(measured[:same], axis=0) > STILL * np.ptp(measured, axis=0)
    coarse = motion or (load and (np.diff(time_s[same:]) == 0).any())
    return 0 if coarse else same - 1


def behind_clock(numbers: Array) -> int:
    """How many rows of time, motion and load ``[t, 3]`` come behind the end of a test, with its first time or 0.

    Programs fill up a table so, where times are back at the start and stay there. They are few; else there are none.
    """
    if not len(numbers):
        return 0
    time_s = numbers[:, 0]
    runs = np.flatnonzero((time_s != time_s[-1]) | (time_s > max(time_s[0], 0.0)))
    behind = len(time_s) - 1 - int(runs[-1]) if runs.size else 0
    return behind if 0 < behind <= max(1.0, FEW_AGAIN * len(time_s)) and time_s[-1 - behind] > time_s[-1] else 0


def is_coarse(time_s: Array) -> bool:
    """Whether a clock that never goes back gives several rows ``[t]`` one time."""
    steps = np.diff(time_s)
    return bool((steps >= 0).all() and (steps == 0).any() and (steps > 0).any())


def spread(time_s: Array) -> Array:
    """Times ``[t]`` of a coarse clock with those that are equal spread evenly, up to its usual step or the next time.

    So each is later than it says by less than a step of the clock.
    """
    distinct, first, counts = np.unique(time_s, return_index=True, return_counts=True)
    step = float(np.median(np.diff(distinct)))
    room = np.minimum(np.append(np.diff(distinct), step), step)
    group = np.repeat(np.arange(distinct.size), counts)
    return np.asarray(time_s + (np.arange(time_s.size) - first[group]) / counts[group] * room[group])


def again(numbers: Array) -> Array:
    """The rows of time, motion and load ``[t, 3]`` that have the time of the row before, where these may be left out.

    Machines write one row at the end of a step and another one at the begin of the next. They are few, no two follow
    each other, and nothing moves in them; else times are coarse, and there are none.
    """
    steps = np.diff(numbers, axis=0)
    rows = np.flatnonzero(steps[:, 0] == 0.0)
    moves = np.abs(steps[rows, 1:]) > STILL * np.ptp(numbers[:, 1:], axis=0)
    coarse = len(rows) > FEW_AGAIN * len(numbers) or (np.diff(rows) == 1).any() or moves.any()
    return np.array([], dtype=int) if coarse or (steps[:, 0] < 0.0).any() else rows + 1
