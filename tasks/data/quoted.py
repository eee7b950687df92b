"""Cells and lines of a text that stand in quotation marks, in ways that the csv module does not take them."""

import re

_WRAPPED = re.compile(r'"(?:[^"]|"")*"')  # a single quoted cell


def unquoted(cell: str) -> str:
    """A cell without spaces around it, and without quotation marks that spaces stood in front of: ``, "mm"``."""
    cell = cell.strip()
    return cell[1:-1].strip() if len(cell) > 1 and cell[0] == cell[-1] == '"' else cell


def unwrapped(line: str) -> str:
    """The line in a single quoted cell with quoted cells, which is what a spreadsheet makes of a line that it saves."""
    return line[1:-1].replace('""', '"') if '""' in line[1:-1] and _WRAPPED.fullmatch(line) else line
