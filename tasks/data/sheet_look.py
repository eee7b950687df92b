"""How a sheet is shown, and what all kinds of spreadsheets have in common where that is found out."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import IO
from xml.etree.ElementTree import Element

MAX_CELLS = 4 * 10**6  # of all sheets, with those that are empty
Cells = dict[int, dict[int, str]]  # by row and column, both from 0: how the number is shown


class TooMuch(Exception):
    """What is not read: of what there is too much, or what is wrong, and what is ``expected``."""

    def __init__(self, words: str, expected: str) -> None:
        super().__init__(words)
        self.expected = expected


@dataclass
class Look:
    """How a sheet is shown: ``cells`` that are not shown as they are; hidden ``rows`` and ``columns``, from 1."""

    cells: Cells = field(default_factory=dict)
    rows: set[int] = field(default_factory=set)
    columns: set[int] = field(default_factory=set)


def parsed(file: IO[bytes]) -> Iterator[tuple[str, Element]]:
    """The elements of a member, each where it begins and where it ends."""
    from defusedxml.ElementTree import iterparse  # in the process that reads spreadsheets only

    yield from iterparse(file, ("start", "end"), forbid_dtd=True)


def local(name: str) -> str:
    """A name of XML without its namespace."""
    return name.rpartition("}")[2]
