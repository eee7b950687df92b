"""The rows of a protocol at which the solver stops, and the quantities between them."""

from functools import lru_cache

import numpy as np

from sinew.tasks.model import Protocol
from sinew.tasks.simulate import Array

SHORTEST_HOLD_S = 1.0


@lru_cache(maxsize=256)
def solver_steps(protocol: Protocol, ramp_s: float, hold_growth: float, still_mm: float) -> Array:
    """Rows of the protocol at which the solver stops, the first and the last among them.

    While the displacement moves, steps are at most ``ramp_s`` long (0: every row) and stop at each reversal. In a hold
    (at least 1 s within ``still_mm`` of a constant) the recursion of the model is exact for any step, so steps grow to
    ``hold_growth`` times the time since the hold began (0: every row).
    """
    time_s, u = protocol.time_s, protocol.displacement_mm
    rows = [0]
    for begin, end, still in _segments(protocol, still_mm):
        if (hold_growth if still else ramp_s) == 0:
            rows += range(begin + 1, end + 1)
            continue
        at = begin
        while at < end:
            longest = hold_growth * (time_s[at] - time_s[begin]) if still else ramp_s
            following = int(np.searchsorted(time_s, time_s[at] + longest * (1 + 1e-9), side="right")) - 1
            following = min(max(following, at + 1), end)
            if not still:
                for reversal in range(at + 1, following):
                    if (u[reversal] - u[reversal - 1]) * (u[reversal + 1] - u[reversal]) <= 0:
                        following = reversal
                        break
            rows.append(following)
            at = following
    return np.array(rows)


@lru_cache(maxsize=256)
def _segments(protocol: Protocol, still_mm: float) -> list[tuple[int, int, bool]]:
    """Holds and the motion between them, as (first row, last row, is a hold); last rows are the next first rows."""
    time_s, u = protocol.time_s, protocol.displacement_mm
    moved = np.flatnonzero(np.abs(np.diff(u)) > still_mm) + 1  # a hold begins after a row that moved
    segments: list[tuple[int, int, bool]] = []
    motion = 0
    start = 0
    while start < u.size - 1:
        following = int(moved[np.searchsorted(moved, start + 1)]) if moved.size and moved[-1] > start else u.size
        end = start + int(np.argmax(np.append(np.abs(u[start:following] - u[start]) > still_mm, True))) - 1
        if time_s[end] - time_s[start] >= SHORTEST_HOLD_S:
            if start > motion:
                segments.append((motion, start, False))
            segments.append((start, end, True))
            motion = end
        start = max(end, start + 1)
    if motion < u.size - 1:
        segments.append((motion, u.size - 1, False))
    return segments


def from_rest(protocol: Protocol, rows: Array, relaxed_s: float, *, loaded_at_rest: bool) -> tuple[Array, Array, int]:
    """The solver's times (s, from 0) and displacements (mm), and which of them is the protocol's first row.

    A protocol that starts displaced, or a bar that is loaded without, starts at rest: the solver goes there in 1 s and
    waits until all has relaxed.
    """
    times = protocol.time_s[rows] - protocol.time_s[0]
    displacements = protocol.displacement_mm[rows]
    if displacements[0] == 0 and not loaded_at_rest:
        return times, displacements, 0
    waited = 1.0 + relaxed_s
    times = np.concatenate([[0.0, 1.0], times + waited])
    return times, np.concatenate([[0.0, displacements[0]], displacements]), 2


def at_every_row(protocol: Protocol, rows: Array, force: Array, still_mm: float) -> Array:
    """Force at every row from the force at the solver's ``rows``: splines in holds, monotone cubics in motion."""
    if rows.size == protocol.time_s.size:
        return force
    from scipy.interpolate import CubicSpline, PchipInterpolator  # slow to import

    full = np.empty(protocol.time_s.size)
    for begin, end, still in _segments(protocol, still_mm):
        inside = (rows >= begin) & (rows <= end)
        times, values = protocol.time_s[rows[inside]], force[inside]
        curve = CubicSpline if still and times.size >= 4 else PchipInterpolator
        full[begin : end + 1] = curve(times, values)(protocol.time_s[begin : end + 1])
    full[rows] = force
    return full


@lru_cache(maxsize=32)
def load_points(times: bytes, displacements: bytes) -> tuple[str, str]:
    """Load curve points of the displacement, and of the must points where the solver has to stop."""
    at = np.frombuffer(times).tolist()
    moved = "".join(f"<pt>{t!r},{u!r}</pt>\n" for t, u in zip(at, np.frombuffer(displacements).tolist(), strict=True))
    longest = 2 * at[-1]  # the largest step allowed: larger than any, so that each step ends at the next must point
    return moved, "".join(f"<pt>{t!r},{longest!r}</pt>\n" for t in at)
