"""Force and displacement of one bar brought into balance from its first point to its last.

Nothing that happens later changes an earlier point, so points that are in balance stay so. Newton's method on the whole
curve is much faster, and fails for a few bars in ten thousand: where a bundle tears, say, its steps go to and fro
between the two sides of the kink.
"""

from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from sinew.tasks.model.effect import Bars
from sinew.tasks.simulate import Array

WORK = 2_000_000  # points of all curves that are computed for a bar, at most
NEARER = 0.5  # part of the residual that a step leaves, at most
ROUNDING = 100.0  # of the limit: residual that rounding may leave where forces are steep
DOUBLINGS = 60  # of the interval in which the displacement of a point is looked for


class Pulling(Protocol):
    """What bars do: :class:`sinew.tasks.simulate.effects._Run` for a single bar."""

    def pulled(self, bars: Bars) -> Bars: ...
    def left(self, grips: Bars, force: Array) -> Array: ...
    def correction(self, grips: Bars, bars: Bars, residual: Array) -> Array: ...


class _State(NamedTuple):
    bars: Bars
    residual: Array  # [t] mm, of grips, machine and gauge length


def balanced_in_time(pulling: Pulling, grips: Bars, begin: Bars, limit: float) -> Bars:
    """One bar ``[1, t]`` with residuals of at most ``limit`` (mm), begun at displacements of ``begin`` or the grips.

    Its force is NaN where it was not found. Each step changes as many points from the first that is not in balance as
    get nearer to it. Where that point alone does not, its displacement is found within an interval.
    """
    curves = _Curves(pulling, grips)
    state, reached = (curves.at(bar.displacement_mm[0]) for bar in (grips, begin))
    if np.abs(reached.residual).max() < np.abs(state.residual).max():
        state = reached
    points = width = len(state.residual)
    limits = np.full(points, limit)
    while curves.left > 0:
        over = ~(np.abs(state.residual) <= limits)
        if not over.any():
            return state.bars
        first = int(over.argmax())
        window = slice(first, first + width)
        asked = np.zeros_like(state.bars.displacement_mm)
        asked[:, window] = state.residual[window]
        displacement = state.bars.displacement_mm[0].copy()
        displacement[window] += pulling.correction(grips, state.bars, asked)[0, window]
        moved = curves.at(displacement)
        nearer = np.abs(moved.residual[window]) < NEARER * np.nanmax(np.abs(state.residual[window]), initial=0.0)
        if nearer.all():
            state, width = moved, min(2 * width, points)
        elif nearer[0]:
            width = int(nearer.argmin())
        else:
            state, width = _within_an_interval(curves, state, first), 1
            left = abs(state.residual[first])
            if not left <= ROUNDING * limit:
                break
            limits[first] = max(limit, left)
    return replace(state.bars, force_N=np.full_like(state.bars.force_N, np.nan))


class _Curves:
    """Computes the whole curve at given displacements; ``left``: points that may still be computed."""

    def __init__(self, pulling: Pulling, grips: Bars) -> None:
        self.pulling, self.grips, self.left = pulling, grips, WORK

    def at(self, displacement_mm: Array) -> _State:
        self.left -= displacement_mm.size
        moved = self.pulling.pulled(replace(self.grips, displacement_mm=displacement_mm[np.newaxis]))
        return _State(moved, (self.pulling.left(self.grips, moved.force_N) - moved.displacement_mm)[0])


def _within_an_interval(curves: _Curves, state: _State, point: int) -> _State:
    """The state with a residual near zero at ``point``, or as it is where none is found.

    The residual is above zero at short gauge lengths and below zero at long ones.
    """
    from scipy.optimize import brentq  # slow to import

    def at(change: float) -> Any:
        displacement = state.bars.displacement_mm[0].copy()
        displacement[point] += change
        return curves.at(displacement)

    end = begin = float(state.residual[point])
    for _ in range(DOUBLINGS):
        if not np.isfinite(end) or at(end).residual[point] * begin < 0.0:
            break
        end *= 2.0
    try:
        return at(brentq(lambda change: at(change).residual[point], 0.0, end, xtol=1e-15, rtol=1e-14))
    except (ValueError, RuntimeError):  # no change of sign, no number on the way, or no end of steps
        return state
