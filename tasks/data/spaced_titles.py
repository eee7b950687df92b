"""The titles above a table whose columns are apart by spaces, or in another way than its titles."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence

from sinew.tasks.data.heads import Row
from sinew.tasks.data.text import SEPARATORS, cells, is_number

_CHANNEL = re.compile(r" (?=Ch(?:annel)? \d+ )")


def usual_width(rows: Sequence[tuple[int, Row]], decimal: str) -> int:
    """How many cells most rows of nothing but numbers have; 0 where there are none."""
    widths = Counter(len(row) for _, row in rows if row and all(is_number(cell, decimal) for cell in row))
    return widths.most_common(1)[0][0] if widths else 0


def apart_by_several(rows: Sequence[tuple[int, Row]], decimal: str) -> bool:
    """Whether titles and numbers are apart by several separators each, not by as many: no column is empty then.

    The numbers of all rows stand in the same places, and the titles, which are as many, in others.
    """
    places = [tuple(at for at, cell in enumerate(row) if cell) for _, row in rows]
    numbers = [
        at for at, (_, row) in enumerate(rows) if any(row) and all(is_number(c, decimal) for c in filter(None, row))
    ]
    first = numbers[0] if numbers else 0
    if first == 0 or len({places[at] for at in numbers}) > 1:
        return False
    titles = next((places[at] for at in range(first - 1, -1, -1) if places[at]), ())
    return len(titles) == len(places[first]) > 1 and titles != places[first]


def title_cells(line: str, width: int) -> Row:
    """The titles that a line may hold, above rows of ``width`` cells."""
    comment = line.startswith(("#", "%", "//"))
    line = line.lstrip("#%/ ")
    apart = re.split(r" {2,}", line.strip())  # titles of several words
    channels = [title for part in apart for title in _CHANNEL.split(part)]  # "Ch 1 Force Ch 1 Displacement"
    for ways in (apart, channels):
        if len(ways) == width > 1:
            return tuple(title.strip('"') for title in ways)
    for other in SEPARATORS:  # titles may be separated in another way than the numbers below them
        if other in line:
            return tuple(cells(line, other))
    found = tuple(title.strip('"') for title in _with_units(line))
    words_only = comment and len(found) != width and not any(mark in line for mark in "([,")
    return () if words_only else found  # "# Fix print output for fix def" above four columns


def cells_apart_otherwise(line: str, row: Row, width: int) -> Row:
    """The titles in a line, above rows of ``width`` cells: its cells ``row``, or those between other separators."""
    if sum(map(bool, row)) == width:
        return row
    ways = (tuple(cells(line, other)) for other in SEPARATORS if other in line)
    return next((way for way in ways if len(way) == width > 1 and all(way)), row)


def _with_units(line: str) -> Iterator[str]:
    """Titles between spaces, each with its unit: ``time (s) force (N)`` are two."""
    title, open_brackets = "", 0
    for word in line.split():
        starts = word[0] in "(["
        if title and not open_brackets and not starts:
            yield title
            title = ""
        title = f"{title} {word}" if title else word
        open_brackets += word.count("(") + word.count("[") - word.count(")") - word.count("]")
    if title:
        yield title
