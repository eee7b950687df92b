"""Where a file holds numbers: the separator and the decimal mark of a text, and runs of rows that are a table."""

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput
from sinew.tasks.data.text import CELLS_AT_A_TIME, SEPARATORS, are_plain, cells, is_number

MOST_COLUMNS = 1000
FEWEST_COLUMNS = (3, 2)  # time, motion and load; where no table has three, motion and load
HEAD_LINES = 450  # where separator and decimal mark are looked for first; and at each end of long lines above a table
#: Characters and lines in which separator and decimal mark are looked for, where the first lines have no table.
LOOKED_AT, LINES_LOOKED_AT = 2**22, 100_000
EXPECTED = "three columns or more: time, displacement (or strain) and force (or stress)"
RUN = 3  # rows that must agree for a table to begin


class NoTable(BadInput):
    """A file without a table of numbers."""


@dataclass(frozen=True)
class Run:
    """Rows from ``start`` up to ``end`` that have numbers in ``columns``."""

    start: int
    end: int
    columns: frozenset[int]


def layout(path: Path, lines: Sequence[tuple[int, str]]) -> tuple[str, str, int]:
    """The separator, the decimal mark and the fewest columns of a table.

    The longest table counts, of several with as many rows the widest. Whole numbers read alike with both marks; the
    point goes first then.
    """
    for fewest in FEWEST_COLUMNS:
        for some in (lines[:HEAD_LINES], _first(lines, LOOKED_AT)):
            best, length = None, (0, 0)
            for separator in (*SEPARATORS, " "):
                split = [cells(line, separator) for _, line in some]
                quoted = any('"' in line for _, line in some)  # then a comma within a cell may be a decimal mark
                for decimal in ".,":
                    longest = (0, 0) if separator == decimal and not quoted else _longest(split, decimal, fewest)
                    if longest > length:
                        best, length = (separator, decimal, fewest), longest
            if best is not None:
                return best
    raise NoTable(path, "no table of numbers can be found", EXPECTED)


def _first(lines: Sequence[tuple[int, str]], most: int) -> Sequence[tuple[int, str]]:
    """The first lines, of so many characters together at most, and not too many of them."""
    for count, (_, line) in enumerate(lines[:LINES_LOOKED_AT]):
        most -= len(line)
        if most < 0:
            return lines[:count]
    return lines[:LINES_LOOKED_AT]


def _longest(rows: Sequence[Sequence[str]], decimal: str, fewest: int) -> tuple[int, int]:
    """The rows and the columns of the longest table; 0 if there is none."""
    lengths = ((run.end - run.start, len(run.columns)) for run in runs(rows, decimal, fewest))
    longest = max(lengths, default=(0, 0))
    return longest if fewest == FEWEST_COLUMNS[0] or longest[0] >= RUN else (0, 0)


def runs(rows: Sequence[Sequence[str]], decimal: str, fewest: int) -> Iterator[Run]:
    """Where rows have numbers in the same columns, until a row lacks a number that the first rows of a run have."""
    start = 0
    while start < len(rows):
        common = numeric_places(rows[start], decimal) if len(rows[start]) >= fewest else set()
        for row in rows[start + 1 : start + RUN]:
            if len(common) >= fewest:
                common &= numeric_places(row, decimal)
        if len(common) < fewest:
            start += 1
            continue
        end = _end(rows, start + 1, common, decimal)
        yield Run(start, end, frozenset(common))
        start = end


def _end(rows: Sequence[Sequence[str]], start: int, common: Set[int], decimal: str) -> int:
    """The first row from ``start`` on that lacks a number in one of the ``common`` columns.

    More and more rows are looked at together, so that neither a long table nor many short ones take long.
    """
    end, together = start, RUN
    while end < len(rows):
        part = rows[end : end + together]
        shortest = min(map(len, part))
        if not all(i < shortest and are_plain([row[i] for row in part], decimal) for i in common):
            for at, row in enumerate(part):
                if not all(i < len(row) and is_number(row[i], decimal) for i in common):
                    return end + at
        end += len(part)
        together = min(2 * together, CELLS_AT_A_TIME)
    return end


def numeric_places(row: Sequence[str], decimal: str) -> set[int]:
    """The columns of a row that hold numbers."""
    return {i for i, cell in enumerate(row) if is_number(cell, decimal)} if len(row) <= MOST_COLUMNS else set()


def otherwise_marked(row: Sequence[str], decimal: str) -> set[int]:
    """The columns of a row of nothing but numbers and clock times, some of them with the other decimal mark.

    An empty set for any other row: a title such as ``1.5`` stands beside words.
    """
    other = "," if decimal == "." else "."
    if len(row) > MOST_COLUMNS or not all(is_number(cell, decimal) or is_number(cell, other) for cell in row if cell):
        return set()
    strange = any(cell and not is_number(cell, decimal) for cell in row)
    return {i for i, cell in enumerate(row) if cell} if strange else set()
