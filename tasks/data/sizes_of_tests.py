"""Which of the sizes that a file tells belong to which of its tests."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from sinew.tasks.data import units
from sinew.tasks.data.column_titles import names_and_units
from sinew.tasks.data.heads import Row
from sinew.tasks.data.several import LABELLED, Columns, own_places
from sinew.tasks.data.sizes import FAR, Size, columns_of_sizes, meant, named_in, narrow, read_sizes, size_in
from sinew.tasks.data.tables import Table
from sinew.tasks.data.text import is_number

BY_ORDER = "sizes by the order of the rows in the table of results, which does not name the tests"


def without_others(table: Table, before: Sequence[Table]) -> Table:
    """A table without the lines above it that belong to tests ``before`` it.

    Lines above a test of another sheet are of that test alone. Where the lines right above the table tell a size, it
    takes none from those above another test of its sheet. Lines are compared by what is in them.
    """
    own = table.header[table.own :]
    again = any(one.sheet == table.sheet for one in before)
    if again and any(size.mm is not None and size.has_unit for size in read_sizes(own, 0, table.decimal).values()):
        return replace(table, header=own, own=0)
    theirs = {row for one in before if one.sheet != table.sheet for row in one.header[one.own :]}
    shared = tuple(row for row in table.header[: table.own] if row not in theirs)
    return replace(table, header=(*shared, *own), own=len(shared))


def sizes_beside(table: Table, tests: Sequence[Columns]) -> list[Mapping[str, Size]]:
    """The sizes of each of several tests beside each other: those above its own columns, or else those of all.

    A size is not of all where its row names it twice, or has two numbers.
    """
    each: list[Mapping[str, Size]] = [_told_once(rows, table) for rows in _above(table, tests)]
    return each if any(each[1:]) else [_told_once(table.header, table)] * len(tests)


def sizes_in_columns(table: Table, rows: range, taken: Collection[int]) -> dict[str, Size]:
    """Sizes in columns of their own that are not ``taken``: a number in the first of ``rows``, and no other in them."""
    found: dict[str, Size] = {}
    for place, (title, unit) in enumerate(names_and_units(table)[1]):
        name = meant(title) if place not in taken and units.is_unit(unit) else None
        if name is None or name in found:
            continue
        cells = {row[place] if place < len(row) else "" for _, row in table.rows[rows.start : rows.stop]}
        first = table.rows[rows.start][1][place : place + 1]
        if first and first[0] and cells <= {first[0], ""}:
            found[name] = size_in(name, first[0], unit, table.decimal)
    return found


def _told_once(header: Sequence[Row], table: Table) -> Mapping[str, Size]:
    """The sizes in rows above a table, without those whose row names them twice, or has two numbers."""
    found = read_sizes(header, table.own, table.decimal)
    return {name: size for name, size in found.items() if not _stands_twice(header, name)}


def _above(table: Table, tests: Sequence[Columns]) -> list[list[Row]]:
    """The rows above the columns of each test; columns of all tests are those of the first.

    A label of a size above the first test is that of all, where there is one number behind it and one above the first
    column of each other test. Of other numbers in its row, nobody knows whose they are, and the row tells nothing.
    """
    own_of_each = own_places(tests)
    ends = [max(own, default=-1) + 1 for own in own_of_each]
    firsts = [min(own, default=-1) for own in own_of_each]
    found: list[list[Row]] = [[] for _ in tests]
    for row in table.header:
        parts = [tuple(row[start:end]) for start, end in zip([0, *ends], [*ends[:-1], None], strict=False)]
        first, *others = ([cell for cell in part if cell] for part in parts)
        rest = [cell for each in others for cell in each]
        if first and named_in(first[0]) and rest and not any(map(named_in, rest)):
            alone = all(len(each) == 1 for each in others)
            above = [row[place] if 0 <= place < len(row) else "" for place in firsts[1:]]
            whose = len(first) == LABELLED and alone and all(is_number(cell, table.decimal) for cell in above)
            parts = [parts[0], *((first[0], *part) for part in parts[1:])] if whose else [()] * len(parts)
        for own, part in zip(found, parts, strict=True):
            own.append(part)
    return found


def _stands_twice(header: Sequence[Row], name: str) -> bool:
    for row in narrow(header):
        named = sum(named_in(cell) == name for cell in row)
        if named > 1 or (named and sum(cell[:1].isdigit() for cell in row) > 1):
            return True
    return False


def sizes_by_results(
    header: Sequence[Row], names: Sequence[str], decimal: str = ""
) -> tuple[list[dict[str, Size]], tuple[str, ...]]:
    """The sizes of each test by a table of results with a row for each; empty dicts without one. And a note.

    ``names``: those of the tests. Rows are found by these names, or else taken in their order, which is noted. A cell
    without a number leaves the size of its test open: that of another test is none of it.
    """
    count = len(names)
    found: list[dict[str, Size]] = [{} for _ in names]
    notes: dict[str, None] = {}
    if count < 2:
        return found, ()
    header = narrow(header[:FAR])
    for at, (labels, below) in enumerate(pairwise(header)):
        columns, height = columns_of_sizes(labels, below)
        rows = header[at + height : at + height + count + 1]  # and the one behind them, which tells nothing
        if len(rows) < count or not columns:
            continue
        order = _order(rows[:count], names)
        for place, (name, unit) in columns.items():
            cells = [row[place] if place < len(row) else "" for row in rows]
            one_more = any(is_number(cell, mark) for cell in cells[count:] for mark in ".,")
            if name in found[0] or not all(cells[:count]) or one_more:
                continue
            sizes = [size_in(name, cell, unit, decimal) for cell in cells[:count]]
            if any(size.mm is not None for size in sizes):
                notes |= {} if order else {BY_ORDER: None}
                for own, row in zip(found, order or range(count), strict=True):
                    own[name] = sizes[row]
    return found, tuple(notes)


def _order(rows: Sequence[Row], names: Sequence[str]) -> list[int] | None:
    """The row of each test: by a cell that names it, or by numbers in their order; None where rows name no tests."""
    wanted = [name.strip().casefold() for name in names]
    numbers = [str(number) for number in range(1, len(rows) + 1)]
    first: list[str] = []
    for place in range(max(map(len, rows))):
        cells = [row[place].strip().casefold() if place < len(row) else "" for row in rows]
        if sorted(cells) == sorted(wanted) and len(set(cells)) == len(cells):
            return [cells.index(name) for name in wanted]
        first = first or (cells if any(cells) else [])
    return list(range(len(rows))) if first == numbers or wanted == numbers else None
