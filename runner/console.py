"""Rich's console, for tables and bars; lines are printed by :func:`sinew.runner.printing.put`."""

from collections.abc import Iterable
from typing import Any

import rich.console
from rich.segment import Segment

from sinew.runner.printing import printable


class Console(rich.console.Console):
    """Rich's own control sequences pass, those in what it shows are escaped."""

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """As Rich's."""
        for segment in super().render(*arguments, **options):
            plain = segment.control or segment.text.isprintable()
            yield segment if plain else Segment(printable(segment.text), segment.style)
