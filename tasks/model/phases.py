"""The phases of a displacement history: loading, unloading and holds, found from the displacement alone.

A hold is a period in which the displacement changes much more slowly than usual and ends about where it began. A slow
ramp among fast ones is therefore still a ramp. In a compression, getting shorter is loading.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from sinew.tasks.model.specimen import Array, Protocol

Kind = Literal["load", "unload", "hold"]
SLOW = 0.1  # of the usual speed of the ramps
STAYS = 0.02  # of the whole range of the displacement
PUSHES = 5.0  # times farther than it pulls: a compression
SMOOTHED = 5  # points of the median filter of the speed, against noise of the displacement
PAUSE = 5.0  # usual steps of a displacement that changes in few rows: one that stays for longer rests


@dataclass(frozen=True)
class Phase:
    """Points ``start`` to ``stop`` (exclusive) of a protocol; the last of one phase is the first of the next.

    ``number`` counts phases of the same kind from 1: with cycles it is the cycle, with steps the step.
    """

    kind: Kind
    number: int
    start: int
    stop: int

    @property
    def points(self) -> slice:
        return slice(self.start, self.stop)


def is_compression(protocol: Protocol) -> bool:
    """Whether a test pushes the specimen together: from about its length, and far more than it ever pulls it."""
    moved = protocol.displacement_mm
    shortest = float(-moved.min())
    return shortest > PUSHES * max(float(moved.max()), 0.0) and abs(float(moved[0])) <= shortest / 2


def phases(protocol: Protocol) -> tuple[Phase, ...]:
    """All phases in order. A history that never moves is one hold."""
    time, moved = protocol.time_s, protocol.displacement_mm
    if is_compression(protocol):
        moved = -moved
    moved = _between_steps(moved)
    whole = float(np.ptp(moved))
    if moved.size < 3 or whole == 0.0:
        return (Phase("hold", 1, 0, moved.size),)
    speed = np.diff(moved) / np.diff(time)
    if speed.size > 2 * SMOOTHED:
        from scipy.ndimage import median_filter  # slow to import

        speed = median_filter(speed, SMOOTHED, mode="nearest")
    kinds = _directions(speed, np.diff(time), moved, STAYS * whole)
    for begin, end in _runs(kinds):  # a small reversal within a phase
        way = abs(moved[end] - moved[begin])
        if kinds[begin] != 0 and way <= STAYS * whole and begin > 0:
            kinds[begin:end] = kinds[begin - 1]
    counted = {0: 0, 1: 0, -1: 0}
    names: dict[int, Kind] = {0: "hold", 1: "load", -1: "unload"}
    found = []
    for begin, end in _runs(kinds):
        kind = int(kinds[begin])
        counted[kind] += 1
        found.append(Phase(names[kind], counted[kind], begin, end + 1))
    return tuple(found)


def _between_steps(moved: Array) -> Array:
    """A displacement ``[t]`` that is recorded less often than the rest, with straight lines between its changes.

    One that changes in more than half of the rows in which it does not rest stays as it is.
    """
    changed = 1 + np.flatnonzero(np.diff(moved))
    usual = float(np.median(np.diff(changed))) if changed.size > 2 else 0.0
    if usual < 2.0:
        return moved
    late = np.diff(changed, prepend=0) > PAUSE * usual
    rests = np.maximum(changed[late] - int(usual), 0)  # the last rows before it moves on
    known = np.unique([0, *rests, *changed, moved.size - 1])
    return np.interp(np.arange(moved.size), known, moved[known])


def _directions(speed: Array, steps: Array, moved: Array, stays: float) -> Array:
    """1, -1 or 0 for each step ``[t - 1]``. Slow steps that lead somewhere else are judged again on their own."""
    if not speed.any():  # a displacement in coarse steps, of which the filter leaves nothing
        return np.full(speed.size, int(np.sign(moved[-1] - moved[0])))
    speed = np.ldexp(speed, -np.frexp(np.abs(speed).max())[1])  # in units in which squares do not overflow
    usual = float(np.sum(speed**2 * steps) / np.sum(np.abs(speed) * steps))  # weighted by the distance travelled
    kinds = np.where(np.abs(speed) < SLOW * usual, 0, np.sign(speed)).astype(int)
    for begin, end in _runs(kinds):
        if kinds[begin] == 0 and abs(moved[end] - moved[begin]) > stays:
            part = slice(begin, end)
            kinds[part] = _directions(speed[part], steps[part], moved[begin : end + 1], stays)
    return kinds


def _runs(values: Array) -> list[tuple[int, int]]:
    """Where equal values begin and end (exclusive)."""
    return list(pairwise([0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), values.size]))
