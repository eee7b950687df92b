"""The sheet of a spreadsheet that a person chooses."""

from dataclasses import replace

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.tables import Source

MOST_NAMES = 12  # of sheets, in an error


def of_sheet(source: Source, name: str | None) -> Source:
    """The same source with the tables of one sheet only, if a person names one; the others still tell sizes.

    Raises :class:`BadInput` for a name that no sheet has.
    """
    if name is None:
        return source
    names = [page.name for page in source.pages if page.name]
    if name not in names:
        expected = f"one of {', '.join(map(shown, names[:MOST_NAMES]))}"
        if not names:
            expected = "no --sheet, as this file is no spreadsheet"
        raise BadInput(f"{source.path}: --sheet", f"{shown(name)} is no sheet", expected)
    return replace(source, sheet=name)
