"""From a file to its tables: rows of cells, with the titles, the units and the header lines above them.

This module knows how a table looks, and nothing of what its columns mean.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.data.heads import Head, Row, as_wide, head_of, is_label, is_row_of_units, refuse_factors
from sinew.tasks.data.labview import is_labview, read_labview
from sinew.tasks.data.layout import (
    EXPECTED,
    FEWEST_COLUMNS,
    HEAD_LINES,
    RUN,
    NoTable,
    Run,
    layout,
    numeric_places,
    otherwise_marked,
    runs,
)
from sinew.tasks.data.part import Part
from sinew.tasks.data.sheets import NOTHING_HIDDEN, Hidden, Sheet, is_sheet, read_sheets
from sinew.tasks.data.spaced_titles import apart_by_several, cells_apart_otherwise, title_cells, usual_width
from sinew.tasks.data.text import (
    cells,
    days_after,
    is_clock,
    milliseconds_unpadded,
    number,
    numbers,
    read_lines,
    records,
    seconds_of,
    tells_mark,
)

Array = np.ndarray[Any, Any]
MOST_TABLES = 500  # of one file
MOST_BEFORE = 10 * HEAD_LINES  # rows of the sheets before a table
SECONDS_OF_A_DAY = 86_400.0


@dataclass(frozen=True, eq=False)
class Table:
    """A table of a file.

    ``titles`` are in row ``title_row`` of the file, and ``units`` in the row below; both may be empty. ``rows`` holds
    the rows from the first one with numbers to the end of the table, each with its number in the file (from 1).
    ``header`` holds the rows above the titles, without earlier tables of the same titles; those from ``own`` on stand
    behind the last of these. Of many rows, it holds those at both ends. ``hidden``: what of its sheet is not shown.
    """

    path: Path
    header: tuple[Row, ...]
    titles: Row
    units: Row
    rows: Sequence[tuple[int, Row]]
    separator: str
    decimal: str
    title_row: int = 0
    sheet: str = ""
    own: int = 0
    hidden: Hidden = NOTHING_HIDDEN

    @property
    def first(self) -> int:
        """The row of the file that the numbers begin in."""
        return self.rows[0][0]

    @property
    def common_titles(self) -> Row:
        """Those by which tables are alike: all but the first, which may name a test, and empty ones at the end."""
        last = max((place for place, title in enumerate(self.titles) if title), default=0)
        return self.titles[1 : last + 1]

    def number(self, row: int, column: int) -> float | None:
        """The number in a cell; None if there is none. Clock times count in a column of clock times.

        They count on over midnight where they have dates as in ISO 8601.
        """
        if (known := self._numbers.get(column)) is not None:
            return None if np.isnan(known[row]) else float(known[row])
        found, first = self.rows[row][1], self.rows[0][1]
        if column >= len(found):
            return None
        cell = found[column]
        if not is_clock(cell) and not self.has_clock(column):
            return number(cell, self.decimal)
        days = days_after(first[column] if column < len(first) else "", cell)
        if days is None:
            return None
        return SECONDS_OF_A_DAY * days + seconds_of(cell, milliseconds=column in self.unpadded)

    def numbers(self, column: int) -> Array:
        """:meth:`number` of every row, NaN where there is none. It is kept, and takes a fraction of the time."""
        if column not in self._numbers:
            cells = [row[column] if 0 <= column < len(row) else "" for _, row in self.rows]
            clocks = any(":" in cell for cell in cells)
            every = range(len(self.rows))
            found = [self.number(row, column) for row in every] if clocks else numbers(cells, self.decimal)
            self._numbers[column] = np.array(found, dtype=float)  # None becomes NaN
        return self._numbers[column]

    @cached_property
    def _numbers(self) -> dict[int, Array]:
        return {}

    def unseen(self, rows: range, columns: Mapping[int, str]) -> tuple[str, ...]:
        """What a person who opens the file does not see of these rows and columns (by place: title), in words."""
        words = (f"its sheet '{self.sheet}' is hidden",) if self.hidden.sheet else ()
        count = sum(self.rows[row][0] in self.hidden.rows for row in rows) if self.hidden.rows else 0
        titles = [f"'{title}'" for place, title in columns.items() if place + 1 in self.hidden.columns]
        what = [f"{count} of its {len(rows)} rows"] * bool(count) + [f"column {title}" for title in titles]
        return (*words, f"hidden in the spreadsheet, but read: {', '.join(what)}") if what else words

    @cached_property
    def unpadded(self) -> frozenset[int]:
        """Columns of clock times whose milliseconds have no leading zeros."""
        clocks = (place for place in range(len(self.rows[0][1])) if self.has_clock(place))
        cells = {place: [row[place] for _, row in self.rows if place < len(row)] for place in clocks}
        return frozenset(
            place for place, each in cells.items() if milliseconds_unpadded([cell for cell in each if is_clock(cell)])
        )

    def has_clock(self, column: int) -> bool:
        """Whether a column holds clock times: its numbers are seconds, whatever its title says."""
        found = self.rows[0][1]
        return column < len(found) and is_clock(found[column])


@dataclass(frozen=True)
class _Page:
    """The rows of a text or a sheet, each with its number (from 1), and how each reads if it holds ``titles``."""

    name: str
    rows: Sequence[tuple[int, Row]]
    titles: Sequence[Row]
    hidden: Hidden = NOTHING_HIDDEN


@dataclass(frozen=True, eq=False)
class Source:
    """The rows of a file, read once. ``fewest``: columns that a table must have; of several, the first that fits.

    ``sheet``: the only one of which tables are read, empty for all.
    """

    path: Path
    pages: tuple[_Page, ...]
    separator: str
    decimal: str
    fewest: tuple[int, ...]
    sheet: str = ""


def read_source(path: Path) -> Source:
    """The rows of a file. Raises :class:`NoTable` if a text has no table.

    Of all separators and decimal marks of a text, those count that give the longest table.
    """
    if is_sheet(path):
        return Source(path, tuple(map(_page, read_sheets(path))), "", ".", FEWEST_COLUMNS)
    lines = records(read_lines(path))
    if is_labview(lines):
        rows, separator, decimal = read_labview(path, lines)
        return Source(path, (_Page("", rows, [row for _, row in rows]),), separator, decimal, FEWEST_COLUMNS)
    filled = [line.strip() for _, line in lines[:HEAD_LINES] if line.strip()]
    if filled and all(line.startswith("[") and line.endswith("]") for line in filled):
        raise NoTable(path, "lists in brackets, and no table", EXPECTED)
    separator, decimal, fewest = layout(path, lines)
    rows = _without_blank_end([(at, tuple(cells(line, separator))) for at, line in lines])
    if separator == "\t" and apart_by_several(rows[:HEAD_LINES], decimal):
        rows = [(at, tuple(filter(None, row))) for at, row in rows]
    titles = [row for _, row in rows]
    if separator == " ":
        width = usual_width(rows, decimal)
        titles = [title_cells(line, width) for _, line in lines]
    else:
        width = usual_width(rows[:HEAD_LINES], decimal)
        top = zip(lines[:HEAD_LINES], titles, strict=False)
        titles[:HEAD_LINES] = [cells_apart_otherwise(line, row, width) for (_, line), row in top]
    return Source(path, (_Page("", rows, titles),), separator, decimal, (fewest,))


def _page(sheet: Sheet) -> _Page:
    rows = _without_blank_end(list(enumerate(sheet.rows, start=1)))
    return _Page(sheet.name, rows, [row for _, row in rows], sheet.hidden)


def _without_blank_end(rows: list[tuple[int, Row]]) -> list[tuple[int, Row]]:
    while rows and not any(rows[-1][1]):
        rows.pop()
    return rows


def read_tables(path: Path) -> Iterator[Table]:
    """The tables of a file, as :func:`tables_of` finds them."""
    yield from tables_of(read_source(path))


def tables_of(source: Source) -> Iterator[Table]:
    """The tables of a file, from top to bottom. Raises :class:`NoTable` if there is none, :class:`BadInput` for many.

    A table begins where three rows (or all that are left) have numbers in the same columns, three at least; two, in
    three rows or more, where no table has three. It ends with the file or sheet, or where titles and units are
    repeated. Above the tables of a sheet, its header also holds the sheets before it, unless they are hidden.
    """
    for fewest in source.fewest:
        before: tuple[Row, ...] = ()
        found = 0
        for page in source.pages:
            tables: Iterable[Table] = _tables(source, page, fewest) if source.sheet in ("", page.name) else ()
            if source.separator:
                tables = list(tables)
                _refuse_unclear_mark(tables)
            for table in tables:
                found += 1
                if found > MOST_TABLES:
                    raise BadInput(source.path, f"more than {MOST_TABLES:,} tables", "fewer of them in one file")
                own = len(before) + table.own
                yield replace(table, header=(*before, *table.header), own=own) if page.name else table
            if not page.hidden.sheet:
                before += tuple(row for _, row in page.rows[:HEAD_LINES] if any(row))
            if len(before) > MOST_BEFORE:  # each table keeps them
                before = before[: MOST_BEFORE // 2] + before[-MOST_BEFORE // 2 :]
        if found:
            return
    raise NoTable(source.path, "no sheet has a table of numbers", EXPECTED)


def _refuse_unclear_mark(tables: Sequence[Table]) -> None:
    """Raises :class:`BadInput` where no number of a text tells whether its marks are decimal marks or of thousands."""
    unclear: tuple[Table, int, int, str] | None = None
    looked = 0  # up to which row of the file: tables that end with it have most of their rows in common
    for table in tables:
        for at, cells_of_row in table.rows[bisect_right(table.rows, looked, key=itemgetter(0)) :]:
            looked = at
            for place, cell in enumerate(cells_of_row):
                told = tells_mark(cell, table.decimal)
                if told:
                    return
                if told is False and unclear is None:
                    unclear = table, at, place, cell
    if unclear is not None:
        table, at, place, cell = unclear
        title = table.titles[place] if place < len(table.titles) else ""
        where = f"{table.path}: row {at}, {title or f'column {place + 1}'}"
        one, other = cell.replace(table.decimal, ".", 1), cell.replace(table.decimal, "")
        problem = f"'{cell}' may be {one} or {other}, and no number beside it tells which"
        raise BadInput(
            where, problem, "the file saved without thousands separators, or with a number of decimals other than three"
        )


def _tables(source: Source, page: _Page, fewest: int) -> Iterator[Table]:
    """The tables of a text or of a sheet."""
    path, rows, titles, decimal = source.path, page.rows, page.titles, source.decimal
    places: list[tuple[int, int]] = []
    end = 0
    for run in runs([row for _, row in rows], decimal, fewest):
        if fewest < FEWEST_COLUMNS[0] and run.end - run.start < RUN:
            continue  # two numbers in a line of text
        start, titles_at = _top(rows, run, decimal, end)
        units_again = end > 0 and titles_at == end and is_row_of_units(rows[end][1])
        if start >= end and not units_again:  # else it belongs to the table above, behind a broken row
            places.append((start, titles_at))
        end = run.end
        if len(places) > MOST_TABLES:
            raise BadInput(path, f"more than {MOST_TABLES:,} tables", "fewer of them in one file")
    heads = [as_wide(head_of(titles, at), [row for _, row in rows[start : start + RUN]]) for start, at in places]
    before: dict[Row, tuple[int, int]] = {}  # by titles: the top of the first table, and the end of the last one
    for (start, _), head, stop in zip(places, heads, _stops(heads), strict=True):
        words = head.titles
        end = len(rows) if stop is None else _last_numbers(rows, start, stop, decimal)
        top = max(head.top, 0)
        first, last = before.get(words[1:], (top, top)) if any(words[1:]) else (top, top)
        before[words[1:]] = first, end
        above = _ends(rows, 0, first)
        header = (*above, *_ends(rows, last, top))
        own = len(above) if last < top or first < top else 0
        title_row = rows[top][0] if head.top >= 0 else 0
        refuse_factors(path, rows[top:start])
        part = Part(rows, start, end)
        yield Table(
            path, header, words, head.units, part, source.separator, decimal, title_row, page.name, own, page.hidden
        )


def _ends(rows: Sequence[tuple[int, Row]], start: int, stop: int) -> tuple[Row, ...]:
    """The rows from ``start`` to ``stop``, of many those at both ends: a file may hold thousands of tables."""
    if stop - start <= 2 * HEAD_LINES:
        return tuple(row for _, row in rows[start:stop])
    return tuple(row for _, row in (*rows[start : start + HEAD_LINES], *rows[stop - HEAD_LINES : stop]))


def _stops(heads: Sequence[Head]) -> list[int | None]:
    """Where each table ends: at the next one with the same titles, or with units if it has units; None: at the end.

    The first title may be the number of a specimen.
    """
    found: list[int | None] = []
    same: dict[Row, int] = {}
    measured: int | None = None
    for head in reversed(heads):
        repeated = same.get(head.titles[1:]) if any(head.titles[1:]) else None
        next_tables = [one for one in (repeated, measured if head.units else None) if one is not None]
        found.append(min(next_tables, default=None))
        same[head.titles[1:]] = head.top
        measured = head.top if head.units else measured
    return found[::-1]


def _last_numbers(rows: Sequence[tuple[int, Row]], start: int, stop: int, decimal: str) -> int:
    """Where the rows from ``start`` to ``stop`` end that are not blank or titles of what comes next."""
    columns = numeric_places(rows[start][1], decimal)
    while stop > start and len(numeric_places(rows[stop - 1][1], decimal) & columns) < FEWEST_COLUMNS[-1]:
        stop -= 1  # "Length,20,mm" has one number, and one with the time of a record in columns of its own
    return stop


def _top(rows: Sequence[tuple[int, Row]], run: Run, decimal: str, end: int) -> tuple[int, int]:
    """The first row of a table and the row above it that is not blank (-1: none).

    Rows above a run that have numbers in half of its columns or more are broken rows of the same table, and so is a
    single word below numbers in all of them, such as an event. What reaches into the table above, which has its ``end``
    there, is not followed farther: it belongs to that table.
    """
    start = run.start
    while start >= end:
        above = _filled_above(rows, start)
        higher = _filled_above(rows, above)
        if above < 0 or is_label(rows[above][1]):
            return start, above
        row = rows[above][1]
        numeric = otherwise_marked(row, decimal) or numeric_places(row, decimal)
        if 2 * len(numeric & run.columns) < len(run.columns):
            word = sum(map(bool, rows[above][1])) == 1 and len(run.columns) >= FEWEST_COLUMNS[0]
            if not word or higher < end or not run.columns <= numeric_places(rows[higher][1], decimal):
                return start, above
            above = higher
        start = above
    return start, -1


def _filled_above(rows: Sequence[tuple[int, Row]], at: int) -> int:
    """The row above one that is not blank; -1 if there is none."""
    above = at - 1
    while above >= 0 and not any(rows[above][1]):
        above -= 1
    return max(above, -1)
