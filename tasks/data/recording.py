"""One test as its file holds it: numbers of time, motion and load, their columns, and what stands beside them."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.data.columns import Column
from sinew.tasks.data.further import Kept
from sinew.tasks.data.heads import Row
from sinew.tasks.data.length_columns import Repeats
from sinew.tasks.data.questions import Doubt
from sinew.tasks.data.sizes import Size
from sinew.tasks.data.titles import is_spread

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True, eq=False)
class Recording:
    """What the file of one test holds.

    ``numbers`` ``[t, 3]``: time (s), motion (mm, or 1 for strain and stretch) and load (N, or MPa for stress), each
    from one of the ``rows`` of the file. ``columns`` says which columns these are, ``left_out`` names the others, and
    ``others`` those of them that hold numbers and have a title of their own.
    ``header`` holds the rows above the titles, and ``sizes`` what they tell of the specimen. ``test`` is the name of
    the test if its file holds several. ``notes``: what a person should know of how it was read. ``remedy``: what may
    help if times do not increase. ``doubts``: what may be meant otherwise. ``further``: columns that are kept beside
    the force. ``lengths``: the gauge lengths at the two zeros of a displacement that is set to zero again.
    ``repeats``: what strains and stresses in the same table say.
    """

    path: Path
    numbers: Array
    columns: tuple[Column, Column, Column]
    rows: tuple[int, ...]
    header: tuple[Row, ...]
    sizes: Mapping[str, Size]
    left_out: tuple[str, ...]
    others: tuple[str, ...] = ()
    test: str = ""
    notes: tuple[str, ...] = ()
    remedy: str = ""
    doubts: tuple[Doubt, ...] = ()
    further: Kept = field(default_factory=Kept)
    lengths: tuple[Size | None, Size | None] = (None, None)
    repeats: Repeats = field(default_factory=Repeats)

    @property
    def motion(self) -> Column:
        return self.columns[1]

    @property
    def load(self) -> Column:
        return self.columns[2]

    def part(self, rows: slice | Array, note: str) -> "Recording":
        """Some rows of it only, with a note on that. What all rows told of sizes is not known of a part."""
        values = {name: each[rows] for name, each in self.further.values.items()}
        return replace(
            self,
            numbers=self.numbers[rows],
            rows=self.rows[rows] if isinstance(rows, slice) else tuple(np.array(self.rows)[rows].tolist()),
            notes=(*self.notes, note),
            further=replace(self.further, values=values),
            repeats=Repeats(),
        )

    @property
    def titles(self) -> tuple[str, ...]:
        """All titles of the table, those of its own columns first."""
        return (*(column.title for column in self.columns), *self.left_out)

    @property
    def spreads(self) -> tuple[str, ...]:
        """Titles of columns with the spread of a mean."""
        return tuple(title for title in self.left_out if is_spread(title))
