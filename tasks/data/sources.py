"""Where a curve comes from, for people: its file, the columns with their units, and what was changed."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput, one_line, shown

KEY = "sources"  # in ``specimen.json``: a text by protocol
MOST = 1000  # characters of one


def source_in_words(path: Path, test: str, what: Iterable[str]) -> str:
    """A line on the curve of a ``test`` (``""``: the only one) in a file; ``what`` was read from it."""
    where = f"{path.name}, test {test}" if test else path.name
    return one_line(f"{where}: {'; '.join(what)}")[:MOST]


def sources_of(path: Path, content: dict[str, Any]) -> dict[str, str]:
    """The sources by protocol in the ``content`` of a ``specimen.json``. Raises :class:`BadInput`."""
    found = content.get(KEY, {})
    if not isinstance(found, dict):
        raise BadInput(f"{path}: {KEY}", shown(found), "a text for each protocol")
    for protocol, text in found.items():
        if not isinstance(text, str) or len(text) > MOST:
            raise BadInput(
                f"{path}: {KEY}: {shown(protocol)[1:-1]}", shown(text), f"a text of at most {MOST:,} characters"
            )
    return {protocol: one_line(text) for protocol, text in found.items()}
