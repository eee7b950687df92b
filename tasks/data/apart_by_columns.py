"""Columns that tell the tests or cycles of one table apart, where they stand one under another."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

from sinew.runner.errors import shown
from sinew.tasks.data import words
from sinew.tasks.data.hints import NO_COLUMN
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.several import (
    BOTH,
    CYCLE_COLUMN,
    FEWEST_ROWS_OF_A_CYCLE,
    TEST_COLUMN,
    cell_of,
    cells_of,
    starts_of,
)
from sinew.tasks.data.tables import Table
from sinew.tasks.data.titles import name_and_unit

MOST_TOGETHER = 8  # columns that tell tests apart


@dataclass(frozen=True)
class Apart:
    """A column that tells tests or cycles apart: its title, how many there are, and the option that uses it."""

    title: str
    count: int
    option: str

    @property
    def tests(self) -> int:
        return self.count if self.option == TEST_COLUMN else 1


def refuse_several(table: Table, rows: int, taken: Sequence[int], again: Sequence[int]) -> None:
    """Raises :class:`Unclear` where a column may tell tests apart and times, which a person tells, never go back.

    ``again``: the rows in which the motion begins again.
    """
    apart = told_apart_without_times(table, rows, again, taken)
    if apart is None or apart.option != TEST_COLUMN:
        return
    column = shown(apart.title)
    raise Unclear(
        str(table.path),
        f"{apart.count:,} values of {column}, one under another, may each be a test of its own",
        f"{TEST_COLUMN} {column}, or {TEST_COLUMN} {NO_COLUMN} for one test",
        what="tests",
        which=f"one for each value of {column}, or one in all ({NO_COLUMN})?",
        option=TEST_COLUMN,
        choices=(apart.title, NO_COLUMN),
    )


def told_apart(table: Table, rows: int, back: Sequence[int], taken: Sequence[int]) -> Apart | None:
    """The column that tells tests or cycles apart; None if none does.

    Its value must change wherever the time goes ``back``; else two columns together tell tests apart, of which the
    second counts within the first. If time never goes back, or is not there, a column counts whose title says that it
    tells tests apart. ``taken``: columns that hold something else.
    """
    found: list[tuple[bool, int, int, Apart]] = []
    for place, title in enumerate(table.titles):
        name = name_and_unit(title)[0]
        if not title or place in taken or (not back and name not in words.TESTS):
            continue
        if any(cell_of(table, row - 1, place) == cell_of(table, row, place) for row in back):
            continue
        values, again = _values(table, rows, [place])
        some = 1 < values <= rows // FEWEST_ROWS_OF_A_CYCLE and (not again or name in words.CYCLES)
        if some and len(_different(table, rows, place)) > 1:  # else there is one name in the first rows only
            option = CYCLE_COLUMN if name in words.CYCLES else TEST_COLUMN
            named = name in words.TESTS or name in words.CYCLES
            found.append((not named, values, place, Apart(title, values, option)))
    unnamed, *_, best = min(found) if found else (True, 0, 0, None)
    return (_told_by_several(table, rows, back, taken) or best) if unnamed else best


def told_apart_without_times(table: Table, rows: int, again: Sequence[int], taken: Sequence[int]) -> Apart | None:
    """As :func:`told_apart`, where the motion begins ``again``; else by titles alone."""
    return (told_apart(table, rows, again, taken) if again else None) or told_apart(table, rows, [], taken)


def _told_by_several(table: Table, rows: int, back: Sequence[int], taken: Sequence[int]) -> Apart | None:
    """As :func:`told_apart`: columns of which at least one changes wherever the time goes ``back``.

    Two, if two are enough; else as few as are left when each that is not needed is taken away.
    """
    changes = {
        place: {row for row in back if cell_of(table, row - 1, place) != cell_of(table, row, place)}
        for place, title in enumerate(table.titles)
        if title and place not in taken and BOTH not in title and table.titles.count(title) == 1
    }
    most, some = rows // FEWEST_ROWS_OF_A_CYCLE, [place for place, changed in changes.items() if changed]
    few = {place: again for place in some for values, again in [_values(table, rows, [place])] if values <= most}

    def tests(places: Sequence[int]) -> int:
        """How many tests these columns tell apart; 0 if they do not."""
        if set().union(*(changes[place] for place in places)) != set(back):
            return 0
        values, again = _values(table, rows, places)
        return 0 if again or values > most else values

    pairs = ([*pair] for pair in permutations(few, 2) if not few[pair[0]] and few[pair[1]])
    needed = next(filter(tests, pairs), [*few] if 2 < len(few) <= MOST_TOGETHER else [])
    if not needed or not tests(needed):
        return None
    for place in needed[::-1] if len(needed) > 2 else ():
        without = [other for other in needed if other != place]
        needed = without if tests(without) else needed
    return Apart(f"{BOTH} ".join(table.titles[place] for place in needed), tests(needed), TEST_COLUMN)


def _different(table: Table, rows: int, place: int) -> set[str]:
    """The different cells of a column, without empty ones."""
    return {cell_of(table, row, place) for row in range(rows)} - {""}


def _values(table: Table, rows: int, places: Sequence[int]) -> tuple[int, bool]:
    """How many values columns have one after another, and whether one of them comes again."""
    cells = cells_of(table, rows, places)
    values = [cells[start] for start in starts_of(cells)]
    return len(values), len(set(values)) < len(values)
