"""Tables one under another that are one test: their times go on, or a person says so."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sinew.tasks.data import words
from sinew.tasks.data.columns import NOWHERE
from sinew.tasks.data.further import Kept
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.length_columns import Repeats
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.several import GOES_ON, LATER, TABLES, Block, go_on, going_on, rest_of_former, unclear_tables
from sinew.tasks.data.titles import name_and_unit

NOT_JOINED = f"{TABLES} join has no effect: no table begins where the one before ends"


def without_effect(hints: Hints, tables: int, tests: int) -> list[str]:
    """A note where a person wants tables joined, and all of several ``tables`` are ``tests`` of their own."""
    return [NOT_JOINED] if hints.tables == "join" and tests == tables > 1 else []


def times_go_on(tests: Sequence[Recording]) -> bool:
    """Whether each test begins after the end of the one before, by times of the file."""
    return tests[0].columns[0].place != NOWHERE and go_on([test.numbers[:, 0] for test in tests])


def are_steps(tests: Sequence[Recording]) -> bool:
    """Whether the times of each test are those of a step, by their title: sheets of one test."""
    return all(name_and_unit(test.columns[0].title)[0] in words.TIMES_OF_STEPS for test in tests)


def joined_tables(tests: Sequence[Recording], hints: Hints, *, named: bool) -> list[Recording]:
    """The tests of tables one under another; those that begin where the one before ends, as a person says.

    ``named``: tables have names, so that times alone join none. Raises :class:`Unclear` where nobody has said it.
    """
    groups = [[tests[0]]]
    for former, test in pairwise(tests):
        alike = all(one.is_as(other) for one, other in zip(former.columns[1:], test.columns[1:], strict=True))
        note = rest_of_former(former.numbers, test.numbers, test.columns) if alike else ""
        if alike and not named and test.columns[0].place != NOWHERE and test.numbers[0, 0] > former.numbers[-1, 0]:
            note = GOES_ON if times_go_on([former, test]) else note or LATER
        if alike and not note and are_steps([former, test]):
            note = f"is a step of its own, by '{test.columns[0].title}'"
        if note and hints.tables in (None, "first"):
            again = test.columns[0].place != NOWHERE and bool(test.numbers[0, 0] <= former.numbers[-1, 0])
            raise unclear_tables(test.path, note, again=again)
        if note and hints.tables == "join":
            groups[-1].append(test)
        else:
            groups.append([replace(test, notes=(*test.notes, note)) if note else test])
    return [
        as_one(group, f"that go on from each other, as {TABLES} says") if len(group) > 1 else group[0]
        for group in groups
    ]


def as_one(tests: Sequence[Recording], why: str) -> Recording:
    """One test of several tables. Where times start again, each table begins one usual step after the one before."""
    note = f"{len(tests)} tables {why}: read as one test"
    rows = tuple(row for test in tests for row in test.rows)
    numbers = np.concatenate([test.numbers for test in tests])
    ends = np.cumsum([len(test.rows) for test in tests])
    numbers[:, 0] = going_on(
        numbers[:, 0], [Block("", end - len(test.rows), end) for test, end in zip(tests, ends, strict=True)]
    )
    values = {
        name: np.concatenate([test.further.values.get(name, np.full(len(test.rows), np.nan)) for test in tests])
        for name in dict.fromkeys(name for test in tests for name in test.further.values)
    }
    further = replace(next((test.further for test in tests if test.further.values), Kept()), values=values)
    notes = (*tests[0].notes, note)
    return replace(tests[0], numbers=numbers, rows=rows, notes=notes, further=further, repeats=Repeats())
