"""What two columns of a file tell together of a specimen's size: a length and a displacement, a force and a stress."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sinew.tasks.data import units, words
from sinew.tasks.data.column_titles import names_and_units
from sinew.tasks.data.columns import LIKELY, Column, partly
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.possible_columns import AXES
from sinew.tasks.data.quantities import DISPLACEMENT, FORCE, LENGTH, STRAIN, STRESS, Quantity
from sinew.tasks.data.sizes import LONGEST_MM, SAME, Size
from sinew.tasks.data.tables import Table
from sinew.tasks.data.titles import by_extensometer

Array = np.ndarray[Any, np.dtype[Any]]
NEAR = 0.05  # by how much a length and the one that strains imply may differ
LARGEST = 1e30  # of a number that is compared: what is larger stands for none
ON_A_LINE = 0.99  # the correlation of two columns that tell the same
FEWEST = 3  # rows of a line


def length_beside(table: Table, moved: Column, displacement_mm: Array, first: int = 0) -> Size | None:
    """The length at which a displacement ``[t]`` is 0, by a column of current lengths beside it; None without one.

    ``moved``: the column of the displacement. ``first``: the row of the table in which the displacement begins.
    """
    lengths = _length_along(table, moved) or _column_of(table, LENGTH)
    if lengths is None or not displacement_mm.size:
        return None
    current = numbers_of(table, lengths, range(first, first + displacement_mm.size))
    for at_rest in (current - displacement_mm, current + displacement_mm):  # a compression may be counted as positive
        if np.ptp(at_rest) <= SAME * abs(at_rest[0]) and at_rest[0] > 0.0:
            return Size(float(at_rest[0]), True, lengths.title, column=True)
    return None


def lengths_at_zeros(
    table: Table, moved: Column, displacement_mm: Array, zeros: Sequence[int], first: int = 0
) -> tuple[Size | None, Size | None]:
    """The same before the first and behind the last of the ``zeros``: rows in which the displacement is set to zero."""
    last = zeros[-1]
    before = length_beside(table, moved, displacement_mm[: zeros[0]], first)
    return before, length_beside(table, moved, displacement_mm[last:], first + last)


def length_by_strain(table: Table, rows: range, moved: Column) -> tuple[float, str] | None:
    """The length (mm) by which displacements and a column of strains agree, and the title of the strains.

    ``moved``: the displacements that are read. It is the slope of a line, for the two may count from different zeros.
    None without strains that have a unit, or where the two are not on one line: an extensometer that was taken off, or
    displacements that were set to zero again.

    Some machines write the distance of the grips above the table, and strains of another length.
    """
    strains = _column_of(table, STRAIN)
    if moved.quantity is not DISPLACEMENT or not moved.unit or strains is None or by_extensometer(strains.title):
        return None  # an extensometer has a length of its own
    slope = _slope(table, rows, moved, strains)
    return (slope, strains.title) if slope is not None and slope < LONGEST_MM else None


def contradiction(table: Table, rows: range, moved: Column, length_mm: float) -> str:
    """How the strains of a table contradict a length that is told above it, in words; empty if they do not."""
    implied = length_by_strain(table, rows, moved)
    if implied is None or abs(implied[0] - length_mm) <= NEAR * length_mm:
        return ""
    return f"{length_mm:g} mm in the lines above, but {implied[0]:.4g} mm by '{implied[1]}'"


@dataclass(frozen=True)
class Repeats:
    """What a table says once more: how far the ``strain`` goes, and the ``area_mm2`` that force and stress tell.

    Each with the title of its column; None where there is none. ``falls``: the title of current lengths that fall as
    the motion rises, empty where there are none.
    """

    strain: tuple[str, float] | None = None
    area_mm2: tuple[str, float] | None = None
    falls: str = ""


def repeats_of(table: Table, rows: range, moved: Column, load: Column) -> Repeats:
    """What strains, stresses and lengths beside a motion and a force say."""
    strain = area = None
    strains, stresses = (_column_of(table, each) for each in (STRAIN, STRESS))
    if moved.quantity is DISPLACEMENT and strains is not None and strains.place != moved.place:
        numbers = numbers_of(table, strains, rows)
        numbers = numbers[np.abs(numbers) < LARGEST]
        if numbers.size and np.ptp(numbers) > 0.0:
            strain = (strains.title, float(np.ptp(numbers)))
    if load.quantity is FORCE and load.unit and stresses is not None and stresses.place != load.place:
        slope = _slope(table, rows, load, stresses)
        area = None if slope is None else (stresses.title, slope)
    lengths = _column_of(table, LENGTH, measured=False)
    falls = ""
    if moved.quantity in (DISPLACEMENT, STRAIN) and lengths is not None and lengths.place != moved.place:
        opposite = replace(lengths, factor=-lengths.factor)
        falls = "" if _slope(table, rows, opposite, moved) is None else lengths.title
    return Repeats(strain, area, falls)


def _length_along(table: Table, moved: Column) -> Column | None:
    """The current lengths along the axis of a displacement: ``XSize_um`` beside ``XDisplacement_um``; None without."""
    titles, named = names_and_units(table)
    name = named[moved.place][0]
    if name[:1] not in AXES or name[1:].strip() not in words.DISPLACEMENT:
        return None
    for place, (other, unit) in enumerate(named):
        factor = units.factor(units.LENGTH, unit)
        if other[:1] == name[:1] and other[1:].strip() in words.LENGTH and factor is not None:
            return Column(LENGTH, place, titles[place], unit, factor, LIKELY)
    return None


def _column_of(table: Table, quantity: Quantity, *, measured: bool = True) -> Column | None:
    """The column of a quantity, if it has a unit where that must be ``measured``."""
    columns, _ = partly(table, Hints(), only=quantity)
    found = (one for one in columns if one is not None and one.quantity is quantity)
    return next((one for one in found if one.unit or not measured), None)


def _slope(table: Table, rows: range, column: Column, over: Column) -> float | None:
    """By how much a column grows for each unit of another; None where the two are not on one rising line."""
    both = np.column_stack([numbers_of(table, column, rows), numbers_of(table, over, rows)])
    both = both[(np.abs(both) < LARGEST).all(axis=1)]
    if len(both) < FEWEST or not np.ptp(both, axis=0).all():
        return None
    slope, correlation = np.polyfit(both[:, 1], both[:, 0], 1)[0], np.corrcoef(both.T)[0, 1]
    return float(slope) if correlation > ON_A_LINE else None


def numbers_of(table: Table, column: Column, rows: range) -> Array:
    """The numbers ``[t]`` of a column, NaN where a cell has none; clock times since the first row."""
    found = table.numbers(column.place)[rows] * column.factor
    return found - found[0] if table.has_clock(column.place) else found
