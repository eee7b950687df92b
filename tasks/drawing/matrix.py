"""A table of two directions on the console, which is legible however many rows and columns there are."""

from collections.abc import Callable, Sequence

from rich.table import Column
from rich.table import Table as Grid

from sinew.runner.console import Console

COLUMNS = 4  # beside the names of the rows: on a terminal of 80 columns, names up to about 12 letters stay in a line


def print_matrix(
    console: Console,
    title: str,
    rows: tuple[str, Sequence[str]],
    columns: tuple[str, Sequence[str]],
    cell: Callable[[int, int], str],
) -> None:
    """Print ``cell(row, column)`` for all ``rows`` and ``columns``, each of which are what they are and their names.

    If there are more columns than rows, they are exchanged; and if there are still too many, several tables are
    printed, one below the other.
    """
    if len(columns[1]) > len(rows[1]):
        print_matrix(console, title, columns, rows, lambda i, j: cell(j, i))
        return
    what, names = rows
    for first in range(0, len(columns[1]), COLUMNS):
        shown = range(first, min(first + COLUMNS, len(columns[1])))
        heads = [Column(head, overflow="fold") for head in (what, *(columns[1][j] for j in shown))]
        grid = Grid(*heads, title="" if first else title)
        for i, name in enumerate(names):
            grid.add_row(name, *(cell(i, j) for j in shown))
        console.print(grid)
