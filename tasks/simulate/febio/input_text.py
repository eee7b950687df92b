"""The text of a rendered input, read and written again where something is added to it."""

from xml.etree.ElementTree import Element, tostring

import defusedxml.ElementTree

from sinew.tasks.simulate.row_by_row import Failed


def parsed(text: str) -> Element:
    """The root of an input that was rendered, and checked there."""
    root: Element = defusedxml.ElementTree.fromstring(text.encode(), forbid_dtd=True)
    return root


def as_text(root: Element) -> str:
    """The input. Raises :class:`Failed` for one that is nested too deeply to be written."""
    try:
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"
    except RecursionError:
        raise Failed("bad_input", "the input is nested too deeply") from None
