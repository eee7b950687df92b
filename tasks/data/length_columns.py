"""A column of current lengths beside one of displacements: together they tell the gauge length."""

from typing import Any

import numpy as np

from sinew.tasks.data.columns import Column, partly
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import LENGTH
from sinew.tasks.data.sizes import Size
from sinew.tasks.data.tables import Table

Array = np.ndarray[Any, np.dtype[Any]]
SAME = 1e-3  # of a gauge length that two columns tell


def length_beside(table: Table, displacement_mm: Array, first: int = 0) -> Size | None:
    """The gauge length by a column of current lengths: these less the displacements ``[t]`` are always the same.

    ``first``: the row of the table in which the displacements begin. None where there is no such column.
    """
    lengths = partly(table, Hints(), only=LENGTH)[0][1]
    if lengths is None or not lengths.unit or not displacement_mm.size:
        return None
    at_rest = column_of(table, lengths)[first : first + displacement_mm.size] - displacement_mm
    if at_rest.size != displacement_mm.size or not np.ptp(at_rest) <= SAME * abs(at_rest[0]) or at_rest[0] <= 0.0:
        return None
    return Size(float(at_rest[0]), True, lengths.title)


def column_of(table: Table, column: Column) -> Array:
    """The numbers ``[t]`` of a column, NaN where a cell has none; clock times since the first row."""
    cells = (table.number(row, column.place) for row in range(len(table.rows)))
    found = np.array([np.nan if cell is None else cell * column.factor for cell in cells])
    return found - found[0] if table.has_clock(column.place) else found
