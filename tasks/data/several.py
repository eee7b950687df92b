"""Which tests a file holds: several in one table, or one whose tables go on from each other after a short pause."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.clocks import columns_by_clock
from sinew.tasks.data.column_titles import names_and_units, stations_of
from sinew.tasks.data.columns import NOWHERE, Column, alike_places, in_place, recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import BASE_UNITS
from sinew.tasks.data.questions import NoColumn, Unclear
from sinew.tasks.data.sizes import named_in
from sinew.tasks.data.tables import Table

TEST_COLUMN, CYCLE_COLUMN, TABLES = "--test-column", "--cycle-column", "--tables"
BOTH = ","  # between the names of two columns that tell tests apart together
FEWEST_ROWS = 3  # of a test
LATER = "begins a while after the end of the table before, by its times"
GOES_ON = "begins soon after the end of the table before, by its times"
LABELLED = 2  # cells: a label, and what it is of
FEWEST_ROWS_OF_A_CYCLE = 3
FEW_ROWS = 0.5  # of those of another test, with which it shares the times
BEGINS = 0.05  # of the range of motion and load: a test that begins nearer to the end of another one may go on from it
SOON = 10.0  # usual steps of time between two tables of one test
_DECIMAL, _SIZE = re.compile(r"\d+[.,]\d+"), re.compile(r"\d+(?:[.,]\d+)? ?[^\W\d_]?m\b")
Array = np.ndarray[Any, np.dtype[Any]]
Columns = tuple[Column, Column, Column]


@dataclass(frozen=True)
class Block:
    """Rows of a table, from ``start`` up to ``end``, that hold one test or cycle: what its column says of it."""

    name: str
    start: int
    end: int


def beside(table: Table, columns: Sequence[Column | None]) -> int:
    """How many tests stand beside each other: how often the columns of motion and load, and of time, are repeated.

    Tests that share one column of times have the same titles and units; columns in other units are of one test then.
    """
    return len(_beside(table, columns)[-1])


def units_alone(table: Table, columns: Sequence[Column | None]) -> bool:
    """Whether columns are taken by units in place of titles, of which several are alike: a table of other things."""
    _, named = names_and_units(table)
    there = [column for column in columns if column is not None and column.place != NOWHERE]
    alone = bool(there) and all(named[column.place][0].startswith("(") for column in there)
    return alone and any(column.alike for column in there) and beside(table, columns) == 1


def refuse_results(table: Table, columns: Sequence[Column], count: int, hints: Hints) -> None:
    """Raises :class:`Unclear` where tests beside each other share their times, and one has few of the rows of another.

    It may be a table of results with the same titles, whose rows stand beside times of other rows.
    """
    places = _beside(table, columns)
    if count == 1 or len(places[0]) > 1 or columns[0].place == NOWHERE or hints.tables == "apart":
        return
    filled = [sum(bool(cell_of(table, row, load)) for row in range(len(table.rows))) for load in places[2]]
    fewest, most = filled.index(min(filled)), filled.index(max(filled))
    if not FEWEST_ROWS <= filled[fewest] < FEW_ROWS * filled[most]:  # a test of fewer rows is left out anyway
        return
    motion, load = (each[most] + 1 for each in places[1:])
    called = f"column {places[2][fewest] + 1} is called as column {load}"
    raise Unclear(
        str(table.path),
        f"{called}, and has numbers in {filled[fewest]} of {filled[most]} rows: results, or another test",
        f"--displacement-column {motion} --force-column {load} beside results, or {TABLES} apart for tests",
        what="tests",
        which="are these tests (else name the columns of the one test)?",
        option=TABLES,
        choices=("apart",),
    )


def columns_of(table: Table, columns: Columns, number: int, hints: Hints | None = None) -> Columns:
    """The columns of one of the tests that stand beside each other, by its ``number`` from 0, each in its own unit."""
    places = _beside(table, columns)
    time, motion, load = (
        column
        if len(at) <= number or column.place == NOWHERE
        else in_place(table, hints or Hints(), column, at[number])
        for column, at in zip(columns, places, strict=True)
    )
    return time, motion, load


def _beside(table: Table, columns: Sequence[Column | None]) -> list[list[int]]:
    """The places of each column in the tests beside each other: one for shared times, and for a single test."""
    there = [column for column in columns if column is not None and column.place != NOWHERE]
    if len(there) == len(columns):
        places = [alike_places(table, column) if column.title else [] for column in there]
        if len(places[0]) > 1 and len({len(each) for each in places}) == 1:
            return places
    exact = [_places(table, column) for column in there]
    told = exact[1:] if len(there) == len(columns) and len(exact[0]) == 1 else exact  # one column of times for all
    one = [[column.place] if column is not None else [] for column in columns]
    if not told or len({len(each) for each in told}) != 1 or len(told[0]) == 1:
        return [*one[:-1], one[-1] or [NOWHERE]]
    found = {column.place: at for column, at in zip(there, exact, strict=True)}
    places = [found.get(column.place, [NOWHERE]) if column is not None else [] for column in columns]
    return places if places[-1] else [*places[:-1], told[0]]


def other_test(table: Table, hints: Hints, columns: Columns) -> range | None:
    """The columns of another test beside that of ``columns``, whose times have the same title; None where all is one.

    Its other columns have other titles: else :func:`beside` would count it.
    """
    time = columns[0].place
    if time == NOWHERE:
        return None
    clocks = columns_by_clock(names_and_units(table)[1], time)
    if not all(column.place in clocks[time] for column in columns):
        return None
    for place, its in clocks.items():
        if place == time:
            continue
        asked = replace(hints, time_column=str(place + 1), displacement_column=None, force_column=None)
        try:
            others = recognise(table, asked, first_of_alike=True)
        except NoColumn:
            continue
        except BadInput:  # only a person can tell a unit of it
            return its
        if all(column.place in its for column in others):
            return its
    return None


def names_beside(table: Table, tests: Sequence[Sequence[Column]]) -> list[str]:
    """The names of tests beside each other: what the nearest row has above each, if it differs; else numbers from 1.

    Dimensions are no names, and decimal numbers only where nothing else differs. Columns of all tests count for none.
    """
    firsts = list(map(min, own_places(tests)))
    told = [stations_of(table)[first] for first in firsts]
    if all(told):
        return [_as_written(table.titles[first], station) for first, station in zip(firsts, told, strict=True)]
    rows = [_above(row, firsts) for row in ((), *table.header[table.own :])]  # its own, not those of another sheet
    decimal: list[str] = []
    for above, names in reversed(list(pairwise(rows))):
        if not all(names) or len(set(names)) < len(tests) or any(map(named_in, above)) or any(map(_SIZE.match, names)):
            continue
        if not any(map(_DECIMAL.fullmatch, names)):
            return names
        decimal = decimal or names
    return decimal or [str(number) for number in range(1, len(tests) + 1)]


def _as_written(title: str, station: str) -> str:
    """The words in front of a title with their own capitals, as far as they are written as :func:`stations_of` says."""
    return title[: len(station)] if title.lower().startswith(station) else station


def own_places(tests: Sequence[Sequence[Column]]) -> list[set[int]]:
    """The places of the columns of each test beside others, without those that are of all."""
    places = [{column.place for column in columns if column.place != NOWHERE} for columns in tests]
    shared = set[int].intersection(*places)
    return [one - shared for one in places]


def _above(row: Sequence[str], firsts: Sequence[int]) -> list[str]:
    """The cell of a row above the first column of each test, and of the first test the one behind a label there.

    A label stands above the first test where that has one cell more than each of the others.
    """
    found = [row[first] if first < len(row) else "" for first in firsts]
    ends = [*firsts[1:], len(row)]
    filled = [[cell for cell in row[first:end] if cell] for first, end in zip(firsts, ends, strict=True)]
    if len(firsts) > 1 and len(filled[0]) == LABELLED and all(len(each) == 1 for each in filled[1:]):
        found[0] = filled[0][1]
    return found


def _places(table: Table, column: Column) -> list[int]:
    """The columns that have the same title and the same unit below it."""
    if column.place == NOWHERE or not column.title:
        return [column.place]

    if stations_of(table)[column.place]:
        return alike_places(table, column)

    def below(place: int) -> str:
        return table.units[place] if place < len(table.units) else ""

    same = [place for place, title in enumerate(table.titles) if title == column.title]
    return [place for place in same if below(place) == below(column.place)]


def blocks_of_tests(table: Table, rows: int, wanted: str) -> list[Block]:
    """The tests in the first ``rows`` of a table, by a column that a person names by its title or number.

    Several with a comma between them tell tests apart together. Raises :class:`BadInput` for no such column, and for a
    value that comes again after another one.
    """
    each = [wanted] if wanted.strip() in table.titles else wanted.split(BOTH)
    found = _blocks(table, rows, [place_named(table, one.strip(), TEST_COLUMN) for one in each])
    seen: set[str] = set()
    for block in found:
        if block.name in seen:
            where = f"{table.path}: row {table.rows[block.start][0]}, {wanted}"
            raise BadInput(where, f"{shown(block.name)} again, after another value", "the rows of each test together")
        seen.add(block.name)
    return found


def blocks_of_cycles(table: Table, rows: int, wanted: str, taken: Sequence[int]) -> list[Block]:
    """The same for the cycles of one test, whose numbers may come again.

    Raises :class:`BadInput` for one of the ``taken`` columns, and for a column that changes too often to tell cycles.
    """
    place = place_named(table, wanted, CYCLE_COLUMN)
    where = f"{table.path}: {CYCLE_COLUMN} {shown(wanted)}"
    if place in taken:
        raise BadInput(where, "the column of time, displacement or force", "a column with the number of the cycle")
    found = _blocks(table, rows, [place])
    if len(found) > max(rows // FEWEST_ROWS_OF_A_CYCLE, 1):
        problem = f"changes {len(found) - 1:,} times in {rows:,} rows"
        expected = f"a column with one value for each cycle, which has {FEWEST_ROWS_OF_A_CYCLE} rows or more"
        raise BadInput(where, problem, expected)
    return found


def _blocks(table: Table, rows: int, places: Sequence[int]) -> list[Block]:
    cells = cells_of(table, rows, places)
    starts = starts_of(cells)
    ends = [*starts[1:], rows]
    return [Block(" ".join(cells[start]), start, end) for start, end in zip(starts, ends, strict=False)]


def starts_of(cells: Sequence[tuple[str, ...]]) -> list[int]:
    """The rows whose cells are others than those of the row before."""
    return [row for row, cell in enumerate(cells) if row == 0 or cell != cells[row - 1]]


def place_named(table: Table, wanted: str, option: str) -> int:
    """The column of a title or number (from 1)."""
    same = [place for place, title in enumerate(table.titles) if title == wanted.strip()]
    if len(same) == 1:
        return same[0]
    width = max(len(table.titles), len(table.rows[0][1]))
    if not same and wanted.isascii() and wanted.isdigit() and len(wanted) < 5 and 1 <= int(wanted) <= width:
        return int(wanted) - 1
    listed = ", ".join(shown(title) for title in table.titles[:12])
    problem = f"{shown(wanted)} names {len(same)} columns" if same else f"{shown(wanted)} is no column"
    raise BadInput(f"{table.path}: {option}", problem, f"a number from 1 to {width}, or one of {listed}")


def cells_of(table: Table, rows: int, places: Sequence[int]) -> list[tuple[str, ...]]:
    return [tuple(cell_of(table, row, place) for place in places) for row in range(rows)]


def cell_of(table: Table, row: int, place: int) -> str:
    cells = table.rows[row][1]
    return cells[place] if place < len(cells) else ""


def go_on(times_s: Sequence[Array]) -> bool:
    """Whether each of several times ``[t]`` (s) begins soon after the end of the one before: they are of one test."""
    for one, other in pairwise(times_s):
        usual = float(np.median(np.diff(one))) if one.size > 1 else 0.0
        if not one[-1] < other[0] <= one[-1] + SOON * usual:
            return False
    return True


def rest_of_former(former: Array, test: Array, columns: Sequence[Column]) -> str:
    """A note where numbers ``[t, 3]`` of a test may be the rest of the table before: they begin where those end."""
    spans = np.ptp(np.concatenate([former, test]), axis=0)[1:]
    end, start = former[-1, 1:], test[0, 1:]
    if (np.abs(end - start) > BEGINS * spans).any() or (np.abs(start) <= BEGINS * spans).any():
        return ""
    place = " and ".join(
        f"{value:.4g} {BASE_UNITS.get(column.quantity.name, '')}".strip()
        for value, column in zip(start, columns[1:], strict=True)
    )
    return f"begins where the table before ends, at {place}"


def unclear_tables(path: Path, problem: str, *, again: bool) -> Unclear:
    """The question on a test that ``problem`` says may be the rest of the one in the table before.

    ``again``: its time starts again.
    """
    return Unclear(
        str(path),
        f"a test {problem}{', while its time starts again' if again else ''}",
        f"{TABLES} join for one test, or {TABLES} apart",
        what="tests",
        which="join such tables to one test, or keep them apart?",
        option=TABLES,
        choices=("join", "apart"),
    )


def going_on(time_s: Array, cycles: Sequence[Block]) -> Array:
    """Times ``[t]`` (s) that start again with some of the cycles, as one: the next row is one usual step later."""
    going, steps = time_s.copy(), np.diff(time_s)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for cycle in cycles[1:]:
        late = going[cycle.start - 1] - going[cycle.start]
        if late >= 0:
            going[cycle.start :] += late + usual
    return going
