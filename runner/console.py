"""Rich's console, for tables and bars; lines are printed by :func:`sinew.runner.printing.put`."""

from collections.abc import Iterable
from typing import Any

import rich.console
from rich.segment import Segment

from sinew.runner.printing import printable


class Console(rich.console.Console):
    """Rich's own control sequences pass, those in what it shows are escaped; text is no markup, and nothing is a link.

    Styled words are a :class:`rich.text.Text`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render(self, *arguments: Any, **options: Any) -> Iterable[Segment]:
        """As Rich's."""
        for segment in super().render(*arguments, **options):
            text, style = segment.text, segment.style
            linked = style is not None and style.link is not None
            if not segment.control and (linked or not text.isprintable()):
                yield Segment(printable(text), style.update_link(None) if style else None)
            else:
                yield segment
