"""Columns that a person wants kept beside the force, such as the lateral strain of a camera."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units
from sinew.tasks.data.column_titles import names_and_units, places_named
from sinew.tasks.data.hints import Further
from sinew.tasks.data.marks import refuse_marks
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import HUGE
from sinew.tasks.data.titles import without_number
from sinew.tasks.study.measured import UNITS

Array = np.ndarray[Any, np.dtype[Any]]
NOTHING = ("", "nan")  # cells without a number


@dataclass(frozen=True, eq=False)
class Kept:
    """What is kept of a test: ``values`` ``[t]`` by name, NaN where nothing was measured, in sinew's own units.

    ``places`` are the columns, ``words`` say what each is. ``notes``: what is not there.
    """

    values: Mapping[str, Array] = field(default_factory=dict)
    places: tuple[int, ...] = ()
    words: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def kept(table: Table, rows: range, further: Sequence[Further], number: int = 0, beside: int = 1) -> Kept:
    """The columns that are ``further`` kept, in these rows; ``number``: which of the tests ``beside`` each other.

    Raises :class:`BadInput` for a unit that is not known, and for cells that hold something else than numbers.
    """
    titles, named = names_and_units(table)
    values: dict[str, Array] = {}
    places, words, notes = [], [], []
    for one in further:
        found = places_named(titles, named, one.column)
        if not found:
            notes.append(f"no column {shown(one.column)} to keep")
            continue
        if beside > 1 and len(found) == 1:
            found = _of_each_test(found[0], named, beside)
        if len(found) not in (1, beside):
            expected = "--keep-column NUMBER=NAME" if beside == 1 else f"one for each of {beside} tests, or one for all"
            raise BadInput(table.path, f"{shown(one.column)} names {len(found)} columns", expected)
        place = found[number if len(found) > 1 else 0]
        where = f"{table.path}: {shown(titles[place] or f'column {place + 1}')}"
        factor, unit = _factor(where, one, named[place][1])
        column = np.array([_number(table, row, place, where) for row in rows])
        refuse_marks(where, [table.rows[row][0] for row in rows], column)
        column = factor * column
        if np.isnan(column).all():
            notes.append(f"{shown(one.column)} is empty: not kept")
            continue
        values[one.name] = column
        places.append(place)
        words.append(f"{one.name} from '{titles[place] or place + 1}'{'' if unit == '1' else f' in {unit}'}")
    return Kept(values, tuple(places), tuple(words), tuple(notes))


def refuse_unknown(further: Sequence[Further], tests: Sequence[Mapping[str, Array]], titles: Sequence[str]) -> None:
    """Raises :class:`BadInput` for a column that none of the tests has; ``titles`` are those of one of them."""
    for one in further:
        if not any(one.name in values for values in tests):
            listed = ", ".join(shown(title) for title in titles[:12] if title)
            problem = f"no file has numbers in a column {shown(one.column)}"
            raise BadInput("--keep-column", problem, f"one of {listed}" if listed else "a title, or a number from 1")


def _of_each_test(place: int, named: Sequence[tuple[str, str]], beside: int) -> list[int]:
    """The columns with the name of this one, which may have the number of a test at its end: ``strain 1``."""
    names = [name for name, _ in named]
    same = [at for at, name in enumerate(names) if name == names[place]]
    if len(same) == beside:
        return same
    plain = list(map(without_number, names))
    return [at for at, name in enumerate(plain) if name == plain[place]]


def _factor(where: str, one: Further, unit: str) -> tuple[float, str]:
    """The factor of a column to the unit that its name ends in, or to sinew's own; and that unit."""
    told = units.to_own(unit) if unit and units.EITHER not in unit else None
    given = None if one.unit is None else units.to_own(one.unit)
    if one.unit is not None and given is None:
        raise BadInput("--keep-column", f"unit {shown(one.unit)} of {one.name}", "a unit such as mm, %, N, MPa or 1")
    if told is not None and given is not None and told != given:
        raise BadInput(where, f"unit {shown(unit)}, but --keep-column says {one.unit}", "one and the same unit")
    found = told or given
    if found is None:
        problem = f"unit {shown(unit)} is not clear or not known" if unit else "no unit can be found"
        expected = f"--keep-column '{one.column}={one.name}:UNIT', UNIT such as mm, %, N, MPa or 1"
        raise BadInput(where, problem, expected)
    factor, own = found
    ending = one.name.rpartition("_")[2]
    if ending not in UNITS or ending == one.name:
        return factor, own
    of_name = units.to_own(ending)
    if of_name is None or of_name[1] != own:
        has = "has no unit" if own == "1" else f"is in {unit or one.unit}"
        raise BadInput(where, f"{has}, but {one.name} ends in {ending}", "a name that ends in its unit, or in none")
    return factor / of_name[0], ending


def _number(table: Table, row: int, place: int, where: str) -> float:
    at, cells = table.rows[row]
    cell = cells[place].strip() if place < len(cells) else ""
    if cell.lower() in NOTHING:
        return float("nan")
    value = table.number(row, place)
    if value is None or not abs(value) < HUGE:
        raise BadInput(f"{where}, row {at}", shown(cell), "a number, or an empty cell where nothing was measured")
    return value
