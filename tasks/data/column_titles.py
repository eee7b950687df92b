"""The titles of a table: one for each column, with the name and the unit in it."""

from collections.abc import Sequence
from itertools import pairwise
from weakref import WeakKeyDictionary

from sinew.runner.errors import BadInput
from sinew.tasks.data import units, words
from sinew.tasks.data.heads import Row
from sinew.tasks.data.quantities import FORCE, OF_A_TEST, TIME
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number
from sinew.tasks.data.titles import (
    known_within,
    name_and_unit,
    stations,
    without_fillers,
    without_number,
    without_numbers,
    without_station,
    without_suffix,
)
from sinew.tasks.data.told_lines import role_of, units_above

#: Of tables in use: a table of many tests is asked many times.
_KNOWN: WeakKeyDictionary[Table, tuple[Row, list[tuple[str, str]], list[str]]] = WeakKeyDictionary()


def names_and_units(table: Table) -> tuple[Row, list[tuple[str, str]]]:
    """The title of each column that has one or holds numbers, and its name and unit, which may be empty."""
    return _known(table)[:2]


def stations_of(table: Table) -> list[str]:
    """The words in front of each column's name that tell tests beside each other apart; empty where none do."""
    found = _known(table)[2]
    return found if len({*found} - {""}) > 1 else [""] * len(found)


def _known(table: Table) -> tuple[Row, list[tuple[str, str]], list[str]]:
    if table not in _KNOWN:
        _KNOWN[table] = _read(table)
    return _KNOWN[table]


def _read(table: Table) -> tuple[Row, list[tuple[str, str]], list[str]]:
    titles = (*table.titles, *[""] * (_width(table.rows[0][1]) - len(table.titles)))
    plain = [without_suffix(title, titles) for title in titles]
    found = [name_and_unit(title, below) for title, below in zip(plain, _below(table, len(titles)), strict=True)]
    names = without_numbers([name for name, _ in found])
    above = units_above(table.header)
    _, (_, motions), (_, loads) = OF_A_TEST
    before = stations(names, motions, loads)
    names = [without_station(*both) for both in zip(names, before, strict=True)]
    names = _known_names(names, [unit for _, unit in found])
    told = [units.agreed([unit, *above.get(role_of(name), ())]) for name, (_, unit) in zip(names, found, strict=True)]
    left = _simulated(table)
    names = ["" if place in left else name for place, name in enumerate(names)]
    named = [(names[place], "s" if table.has_clock(place) else unit) for place, unit in enumerate(told)]
    return titles, named, before


def _simulated(table: Table) -> set[int]:
    """The columns below a cell right above the titles that says they are simulated, up to the next cell there."""
    above = table.header[-1] if len(table.header) > table.own else ()
    filled = [place for place, cell in enumerate(above) if cell]
    return {
        place
        for first, end in pairwise([*filled, len(table.titles)])
        if first > 0 and above[first].casefold().startswith("simul")
        for place in range(first, end)
    }


def places_named(titles: Sequence[str], named: Sequence[tuple[str, str]], wanted: str) -> list[int]:
    """The columns of a title, of a name without its unit, or of a number from 1, as a person gives it."""
    exact = [place for place, title in enumerate(titles) if title == wanted.strip()]
    name = name_and_unit(wanted)[0]
    found = exact or [place for place, (other, _) in enumerate(named) if other and other == name]
    if not found and wanted.isascii() and wanted.isdigit() and len(wanted) < 5 and 1 <= int(wanted) <= len(titles):
        return [int(wanted) - 1]
    return found


def _known_names(names: Sequence[str], measured: Sequence[str]) -> list[str]:
    """The names without words that change nothing of them, where no column is called by the name alone.

    ``measured``: the units; one of another quantity leaves a name as it is, and so does none beside that of a channel.
    """
    names = list(names)
    for quantities, known in OF_A_TEST:
        if any(name in known for name in names):
            continue
        words = [known_within(name, known) for name in names]
        for place, (word, unit) in enumerate(zip(words, measured, strict=True)):
            fits = any(units.factor(one.units, unit) is not None for one in quantities if word in one.titles)
            fits = fits or (unit in units.MASSES and word in FORCE.titles)  # whose unit is asked for
            numbered = quantities == (TIME,) and without_number(names[place]) == word  # "Time_0"
            if word and (fits or (not unit and (numbered or without_fillers(names[place]) == word))):
                names[place] = word
    return names


def _width(row: Sequence[str]) -> int:
    """How many cells a row has, without empty ones at its end."""
    return max((i for i, cell in enumerate(row, start=1) if cell), default=0)


def _below(table: Table, count: int) -> list[str]:
    cells = [cell.strip("()[] ") for cell in table.units[:count]]
    return [*cells, *[""] * (count - len(cells))]


def check_width(table: Table) -> None:
    """Refuse titles that are too few or too many to belong to the columns below them."""
    count, row = _width(table.titles), table.rows[0][1]
    if table.sheet and "" in row[count:]:  # no cell of a sheet shifts: behind an empty column stands something else
        row = row[: row.index("", count)]
    numbers = _width([cell if is_number(cell, table.decimal) else "" for cell in row])
    untitled = numbers > len(table.titles) or numbers >= 2 * count
    shifted = len(row) < count and any(units.is_unit(title) for title in table.titles)
    if table.separator == " " and len(row) < count:  # no cell is empty, but remarks may stand in some rows only
        shifted = not all(title.casefold() in words.REMARKS for title in table.titles[len(row) : count])
    if untitled or shifted:
        problem = f"{count} names above {_width(row)} columns of numbers"
        expected = "as many; commas cannot separate columns and be decimal marks at the same time"
        if table.sheet:
            expected = "a title above each column, and numbers beside the table in a sheet of their own"
        elif table.separator == " ":
            expected = "as many; titles of several words need two spaces or tabs between them, and each title a column"
        raise BadInput(f"{table.path}: row {table.first}", problem, expected)
