"""How fast a test was loaded."""

from sinew.tasks.model import Protocol
from sinew.tasks.model.phases import phases

LEAST = 0.1  # of the whole way: shorter phases are no loading of the test
SAME = 0.05  # speeds that differ by less are one


def loading_speeds(protocol: Protocol) -> tuple[float, float] | None:
    """The slowest and the fastest of its loadings (mm/s), each the way over the time; None if it is never loaded."""
    time_s, moved = protocol.time_s, protocol.displacement_mm
    whole = float(moved.max() - moved.min())
    ends = [(one.start, one.stop - 1) for one in phases(protocol) if one.kind == "load"]
    ways = [(abs(float(moved[end] - moved[start])), float(time_s[end] - time_s[start])) for start, end in ends]
    speeds = [way / time for way, time in ways if whole > 0 and way >= LEAST * whole]
    return (min(speeds), max(speeds)) if speeds else None


def rate_words(protocol: Protocol, length_mm: float | None) -> str:
    """The strain rate (1/s) of the loadings, or their speed (mm/s) if nobody knows the gauge length; empty for none."""
    speeds = loading_speeds(protocol)
    if speeds is None:
        return ""
    slow, fast = (speed / (length_mm or 1.0) for speed in speeds)
    unit = "mm/s" if length_mm is None else "1/s"
    return f"{slow:.3g} {unit}" if fast - slow <= SAME * fast else f"{slow:.3g} to {fast:.3g} {unit}"
