"""Tables of a benchmark with their headings, and lines beside them: on a console, and as Markdown for the docs."""

from collections.abc import Iterable, Sequence

from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console

Table = tuple[str, list[str], list[list[str]]]  # title, heads of columns, rows


def printed(tables: Iterable[Table], lines: Iterable[str], console: Console) -> None:
    """Tables first, then lines."""
    for title, header, rows in tables:
        grid = Grid(*header, title=title)
        for row in rows:
            grid.add_row(*(Text(cell) for cell in row))
        console.print(grid)
    for line in lines:
        console.print(line)


def as_markdown(tables: Iterable[Table], lines: Sequence[str]) -> str:
    """Lines first, then tables."""
    parts = [f"{line}\n" for line in lines]
    for title, header, rows in tables:
        every = [header, ["---"] * len(header), *rows]
        table = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in every)
        parts.append(f"**{title}**\n\n{table}\n")
    return "\n".join(parts)
