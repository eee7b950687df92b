"""Which columns of a table belong to which column of times, where several columns of times have one title.

Such a table holds tests beside each other, or what several instruments recorded. Columns of two of them are never
taken together where one of them has all that a test needs.
"""

from collections.abc import Sequence


def columns_of_clock(named: Sequence[tuple[str, str]], place: int) -> range | None:
    """The columns of the same test as the column of times at ``place``; None where no other has its name.

    ``named``: name and unit of each column. Times come first in each test, or last.
    """
    times = [at for at, (name, _) in enumerate(named) if name and name == named[place][0]]
    if len(times) < 2:
        return None
    if any(name for name, _ in named[: times[0]]) and not any(name for name, _ in named[times[-1] + 1 :]):
        before = [at for at in times if at < place]
        return range(before[-1] + 1 if before else 0, place + 1)
    return range(place, next((at for at in times if at > place), len(named)))
