"""Numbers that stand for what was not measured, such as -999: they are refused, and never taken for measurements."""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.drawing.blocks import number

Array = np.ndarray[Any, np.dtype[Any]]
#: 999, 9999.99, 99.9, and the largest numbers of converters with 16, 24 and 32 bits.
_MARK = re.compile(r"9{3,10}(\.9+)?|99\.9+|999\.25|32767|32768|65535|838860[78]|214748364[78]|4294967295")
OVERLOAD = 1e30  # 9.9E+37 and 9.91E+37 of instruments: no force in any unit
BEYOND = 10.0  # times the largest other number
FEW = 5  # numbers of a column, the largest ones, that may be marks


def refuse_marks(where: str, rows: Sequence[int], values: Array) -> None:
    """Refuse a column ``values`` ``[t]``, as the file has it, of these rows of it, that holds such marks.

    They are numbers by which programs mark what was not measured, if they are far beyond all other numbers, or the
    only ones below zero. NaN counts as nothing. Raises :class:`BadInput`.
    """
    size = np.abs(np.nan_to_num(values))
    largest_first = np.unique(size)[::-1][:FEW]
    marks = [one for one in largest_first if one >= OVERLOAD or _MARK.fullmatch(f"{one:.10g}")]
    others = np.nan_to_num(values[~np.isin(size, marks)])
    largest = float(np.abs(others).max(initial=0.0))
    for mark in marks:
        at = int(np.flatnonzero(size == mark)[0])
        alone = values[at] < 0 and largest > 0 and others.min() >= 0
        if mark >= OVERLOAD or alone or mark > BEYOND * largest > 0:
            problem = f"{values[at]:.10g}, a usual marker of missing data, where other numbers reach {number(largest)}"
            raise BadInput(f"{where}: row {rows[at]}", problem, "a file without such rows")
