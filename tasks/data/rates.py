"""How fast a test was loaded."""

import numpy as np

from sinew.tasks.model import Protocol
from sinew.tasks.model.phases import phases

LEAST = 0.1  # of the whole way: shorter phases are no loading of the test
SAME = 0.05  # speeds that differ by less are one
FEWEST_STEPS = 5  # of a loading; of fewer, the usual one is not known


def loading_speeds(protocol: Protocol) -> tuple[float, float] | None:
    """The slowest and the fastest of its loadings (mm/s), each the way over the time; None if it is never loaded.

    A first or last step that the loading shares with a rest or a hold does not count.
    """
    time_s, moved = protocol.time_s, protocol.displacement_mm
    whole = float(moved.max() - moved.min())
    ends = [_whole_steps(protocol, one.start, one.stop - 1) for one in phases(protocol) if one.kind == "load"]
    ways = [(abs(float(moved[end] - moved[start])), float(time_s[end] - time_s[start])) for start, end in ends]
    speeds = [way / time for way, time in ways if whole > 0 and way >= LEAST * whole]
    return (min(speeds), max(speeds)) if speeds else None


def _whole_steps(protocol: Protocol, start: int, end: int) -> tuple[int, int]:
    """The points of a loading without a first or last step that is shorter than usual."""
    steps = np.abs(np.diff(protocol.displacement_mm[start : end + 1]) / np.diff(protocol.time_s[start : end + 1]))
    if steps.size < FEWEST_STEPS:
        return start, end
    least = (1.0 - SAME) * float(np.median(steps))
    last = protocol.time_s.size - 1
    return start + int(start > 0 and steps[0] < least), end - int(end < last and steps[-1] < least)


def rate_words(protocol: Protocol, length_mm: float | None) -> str:
    """The strain rate (1/s) of the loadings, or their speed (mm/s) if nobody knows the gauge length; empty for none."""
    speeds = loading_speeds(protocol)
    if speeds is None:
        return ""
    slow, fast = (speed / (length_mm or 1.0) for speed in speeds)
    unit = "mm/s" if length_mm is None else "1/s"
    return f"{slow:.3g} {unit}" if fast - slow <= SAME * fast else f"{slow:.3g} to {fast:.3g} {unit}"
