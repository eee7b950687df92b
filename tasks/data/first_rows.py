"""Rows at the start of a test with one and the same time, which some machines write before their clock runs."""

from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]
STILL = 0.01  # of the range of motion and load, by which they may change in these rows
FEW = 0.1  # of all rows, at most, or two


def before_clock(numbers: Array) -> int:
    """How many rows of time, motion and load ``[t, 3]`` come before the one with which a test begins.

    0 where the first two times differ, and where something moves in rows with the same time: its times are coarse.
    """
    time_s, measured = numbers[:, 0], numbers[:, 1:]
    same = int(np.argmax(time_s != time_s[0]))  # 0 where all are
    moves = np.ptp(measured[:same], axis=0) > STILL * np.ptp(measured, axis=0) if same else np.array(True)
    return 0 if same > max(2.0, FEW * len(time_s)) or moves.any() else same - 1
