"""Which columns of a table belong to which column of times, where several columns of times have one title.

Such a table holds tests beside each other, or what several instruments recorded. Columns of two of them are never
taken together where one of them has all that a test needs.
"""

from collections.abc import Sequence
from itertools import pairwise


def columns_by_clock(named: Sequence[tuple[str, str]], place: int) -> dict[int, range]:
    """The columns of each test, by the place of its times, which have the name of those at ``place``.

    All columns where no others have that name. ``named``: name and unit of each column. Times come first in each test,
    or last.
    """
    times = [at for at, (name, _) in enumerate(named) if name and name == named[place][0]]
    if len(times) < 2:
        return {place: range(len(named))}
    last = any(name for name, _ in named[: times[0]]) and not any(name for name, _ in named[times[-1] + 1 :])
    ends = [0, *(at + 1 for at in times)] if last else [*times, len(named)]
    return {at: range(*between) for at, between in zip(times, pairwise(ends), strict=True)}
