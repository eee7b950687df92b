"""Tables of a benchmark with their headings, and lines beside them: on a console, and as Markdown for the docs."""

from collections.abc import Iterable, Sequence

from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.runner.errors import one_line
from sinew.tasks.drawing.blocks import plain_paragraph

Table = tuple[str, list[str], list[list[str]]]  # title, heads of columns, rows


def printed(tables: Iterable[Table], lines: Iterable[str], console: Console) -> None:
    """Tables first, then lines."""
    for title, header, rows in tables:
        grid = Grid(*header, title=title)
        for row in rows:
            grid.add_row(*(Text(cell) for cell in row))
        console.print(grid)
    for line in lines:
        console.print(one_line(line))


def as_markdown(tables: Iterable[Table], lines: Sequence[str]) -> str:
    """Lines first, then tables. Texts may come from elsewhere: none of them becomes an element or a link."""
    parts = [f"{plain_paragraph(line)}\n" for line in lines]
    for title, header, rows in tables:
        every = [header, ["---"] * len(header), *rows]
        table = "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in every)
        parts.append(f"**{title}**\n\n{table}\n")
    return "\n".join(parts)


def _cell(text: str) -> str:
    return plain_paragraph(text).replace("|", "\\|")
