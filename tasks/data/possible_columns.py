"""Whether a column can hold a quantity, by its name, its unit and its numbers."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from sinew.tasks.data import units, words
from sinew.tasks.data.quantities import DISPLACEMENT, LENGTH, STRAIN, Quantity
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number
from sinew.tasks.data.titles import is_spread, name_and_unit

FOLLOWED, PARTS, FEWEST_PARTS = 2000, 50, 5  # rows, and parts of the machine's way, that an extensometer is compared in
FOLLOWS = 0.5  # rank correlation
FEW_VALUES = 10  # times more values that another column has
AXES = "xyz"  # in front of the names of what is measured along each: "XForce"
FEWEST_LETTERS = 3  # that a word has more of which names a quantity among others
LOOKED_AT = 200  # rows: a file of many tests is asked many times
MOST_TURNS = 0.1  # of the rows: a motion that turns more often is noisy, and its way is longer than that of the machine
Array = np.ndarray[Any, np.dtype[Any]]


def in_volts(name: str, unit: str) -> bool:
    """Whether an extensometer has a unit that is not known, such as V of its amplifier."""
    return name in words.EXTENSOMETER and bool(unit) and not any(map(units.is_unit, unit.split(units.EITHER)))


def changes(table: Table, place: int) -> bool:
    """Whether a column has more than one value."""
    cells = (row[place] for _, row in table.rows if place < len(row) and row[place])
    first = next(cells, "")
    return any(cell != first for cell in cells)


def untimed(table: Table, place: int) -> bool:
    """Whether no speed of the motion in a column tells the time: it has the same number in two rows, or turns often."""
    found = table.numbers(place)
    numbers = found[np.isfinite(found)]
    return bool((np.diff(numbers) == 0.0).any() or turns_often(numbers))


def turns_often(numbers: Array) -> int:
    """How often a motion ``[t]`` turns; 0 where it is seldom enough to be that of a machine and no noise."""
    turns = int(np.count_nonzero(np.diff(np.sign(np.diff(numbers)))))
    return turns if turns > MOST_TURNS * len(numbers) else 0


def follows(table: Table, place: int, machine: int) -> bool:
    """Whether an extensometer moves as the machine does: one that is not on the specimen shows noise, or nothing.

    It has numbers wherever the machine has, and its medians in parts of the machine's way are correlated with the way
    by ``FOLLOWS`` at least. (Parts of the way, and not of the time: holds and a jump at a break say nothing.)
    """
    step = -(-len(table.rows) // FOLLOWED)
    both = [(table.number(row, place), table.number(row, machine)) for row in range(0, len(table.rows), step)]
    pairs = [(one, other) for one, other in both if other is not None]
    if any(one is None for one, _ in pairs):
        return False
    sensor, moved = np.array(pairs, dtype=float).reshape(-1, 2).T
    way = np.ptp(moved) if moved.size else 0.0
    if way == 0.0:
        return True
    parts = np.minimum((moved - moved.min()) / way * PARTS, PARTS - 1).astype(int)
    medians = np.array([np.median(sensor[parts == part]) for part in np.unique(parts)])
    if medians.size < FEWEST_PARTS:
        return True
    ranks = np.unique(medians, return_inverse=True)[1]  # equal ones have one rank
    return bool(np.ptp(ranks) > 0 and abs(np.corrcoef(ranks, np.arange(medians.size))[0, 1]) >= FOLLOWS)


def holds_numbers(table: Table, place: int) -> bool:
    """Whether most of the first cells of a column that are filled hold numbers."""
    cells = [row[place] for _, row in table.rows[:LOOKED_AT] if place < len(row) and row[place]]
    return 2 * sum(is_number(cell, table.decimal) for cell in cells) > len(cells)


def hardly_moves(table: Table, place: int, other: int) -> bool:
    """Whether a column has few different values, where the ``other`` has many, as of a sensor that is not used."""
    some = table.rows[:: -(-len(table.rows) // FOLLOWED)]
    few, many = (len({row[at] for _, row in some if at < len(row)}) for at in (place, other))
    return few * FEW_VALUES <= many


def counts(table: Table, place: int) -> bool:
    """Whether a column counts the rows: whole numbers that rise by one."""
    numbers = [table.number(row, place) for row in range(min(len(table.rows), LOOKED_AT))]
    steps = {None if one is None or other is None else other - one for one, other in pairwise(numbers)}
    return steps == {1.0}


def titles_of_numbers(table: Table, places: Sequence[int]) -> tuple[str, ...]:
    """The titles of those columns that hold numbers and have a title of their own."""
    titles = table.titles
    return tuple(titles[place] for place in places if titles.count(titles[place]) == 1 and holds_numbers(table, place))


def titles_by_a_word(titles: Sequence[str], quantities: Sequence[Quantity]) -> list[str]:
    """The titles with one word that names a quantity and with its unit: ``Fore-Aft Load [N]``.

    The other words may make another quantity of it, as those of ``Load limit [N]`` do, so only a person can tell.
    """
    found: dict[str, list[str]] = {}
    for title in titles:
        name, unit = name_and_unit(title)
        parts = {part for part in name.split() if len(part) > FEWEST_LETTERS}
        parts |= {part[1:] for part in parts if part[0] in AXES}  # "XForce"
        fitting = (one for one in quantities if units.factor(one.units, unit) is not None and parts & set(one.titles))
        if (quantity := next(fitting, None)) is not None:
            found.setdefault(quantity.name, []).append(title)
    if DISPLACEMENT.name in found:
        found.pop(LENGTH.name, None)  # the size of the specimen along an axis, beside its displacement
    return [title for title in titles if any(title in each for each in found.values())]


def titles_by_unit(titles: Sequence[str], quantities: Sequence[Quantity]) -> list[str]:
    """The titles with a unit of one of these quantities, but for ratios: ``Z(m)``."""
    each = [one.units for one in quantities if one.units is not units.FRACTION and "-" not in one.units]
    measured = [(title, name_and_unit(title)[1]) for title in titles if not is_spread(title)]
    return [title for title, unit in measured if any(units.factor(one, unit) is not None for one in each)]


def possible(quantity: Quantity, name: str, unit: str, in_file: str) -> bool:
    """Whether a column can hold a quantity: one in mm is no ratio of lengths, and one in mm/s no displacement.

    ``unit``: that ``in_file``, else the one that a person gives.
    ``L`` is a ratio of lengths unless its unit, in the file or given, is one of length.
    """
    if units.is_rate(unit) or units.is_reciprocal(unit):
        return False
    if name == "l":
        return (units.factor(units.LENGTH, unit) is not None) == (quantity is LENGTH)
    if name in (*words.EXTENSOMETER, *words.ELONGATION) and units.factor(units.FRACTION, unit) is not None:
        return quantity is STRAIN
    if name in words.ELONGATION and quantity is STRAIN:
        return False
    return units.ambiguous(in_file) or not units.belongs_elsewhere(quantity.units, in_file)
