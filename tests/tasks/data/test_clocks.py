"""Columns of one clock: times come first in each test, or last."""

import pytest

from sinew.tasks.data.clocks import columns_by_clock

FIRST = [("time", "s"), ("extension", "mm"), ("load", "n"), ("time", "s"), ("crosshead", "mm"), ("force", "kn")]


@pytest.mark.parametrize(
    ("named", "place", "expected"),
    [
        (FIRST, 0, range(3)),
        (FIRST, 3, range(3, 6)),
        (FIRST[1:4] + FIRST[4:] + FIRST[:1], 2, range(3)),
        (FIRST[1:4] + FIRST[4:] + FIRST[:1], 5, range(3, 6)),
        ([("", ""), *FIRST], 1, range(1, 4)),
        (FIRST[:3], 0, range(3)),
        ([("", "s"), ("extension", "mm"), ("", "s")], 0, range(3)),
    ],
)
def test_columns_go_with_their_times(named, place, expected):
    found = columns_by_clock(named, place)
    assert found[place] == expected
    assert len(found) == (1 if len(named) == 3 else 2)
