"""Limits of processor time that hold on a slow machine too."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

#: Processor time of `_a_million_steps` on the machine that limits are given for, in s.
USUAL_S = 0.1


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """What is done inside takes at most `seconds` of a usual processor; a slower one may take as much longer."""
    begin = time.process_time()
    yield
    taken = time.process_time() - begin
    if taken > seconds:  # the machine is measured only then: there are hundreds of such tests
        slowness = max(1.0, _a_million_steps() / USUAL_S)
        assert taken <= seconds * slowness, (
            f"too slow: {taken:.1f} s on a machine {slowness:.1f} times slower than usual"
        )


def _a_million_steps() -> float:
    begin = time.process_time()
    total = 0
    for number in range(1_000_000):
        total += number
    return time.process_time() - begin
