"""90 % intervals of the effects' parameters in one specimen, by profile likelihood.

A parameter is moved away from its best value while all others are fitted again, until the loss has risen by what chance
alone would raise it to in one case of ten (Venzon and Moolgavkar 1988). Near a straight valley that is what the
curvature says; a mode slower than the holds, whose strength and time make up for each other, has a bent one. And there
may be several valleys that are about as deep, as when matrix and fibres exchange their relaxation: an interval reaches
from the first to the last of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import RISE, Fitted, covariance, derivatives, fit, starts
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.simulate import Array

NEAR = 0.05  # relative tolerance of the root of the rise at an end
TRIES = 8  # fits for an end, at most
LOWER = 0.05  # of loss: a fit this much below the best so far replaces it
AGAIN = 4  # restarts from a better fit, at most
EDGE = 1e-6  # of the unit cube, within which a fit stays
STARTS = 10  # of the bare model, for the search of other minima
SEED = 14


@dataclass(frozen=True, eq=False)
class Profiled:
    """The best fit, which may have been found on the way, and the ``ends`` ``[m, 2]`` for the effects' parameters.

    Both on the unit cube. An end on a bound of the cube is there because the loss does not rise enough before it.
    """

    fitted: Fitted
    ends: Array


def profiled(candidate: Candidate, measured: Measured, fitted: Fitted) -> Profiled:
    """Intervals around a fit to all curves of a specimen."""
    bare = starts(candidate.having(), np.random.default_rng(SEED), STARTS)
    others = [fit(candidate, measured, np.concatenate([at, candidate.typical()])) for at in bare]
    valleys = sorted([fitted, *others], key=lambda one: one.loss)
    numbers = range(len(candidate.varied), candidate.size)
    for _ in range(AGAIN):
        met: list[Fitted] = []
        ends = [
            [_end(candidate, measured, valleys, number, direction, met) for direction in (-1.0, 1.0)]
            for number in numbers
        ]
        if not met:
            break
        lowest = min(met, key=lambda one: one.loss)
        valleys = sorted([fit(candidate, measured, lowest.at), lowest, *valleys], key=lambda one: one.loss)
    return Profiled(valleys[0], np.array(ends).reshape(-1, 2))


def _end(
    candidate: Candidate,
    measured: Measured,
    valleys: Sequence[Fitted],
    number: int,
    direction: float,
    met: list[Fitted],
) -> float:
    """The end of an interval on one side, from the deepest minimum or the outermost one that is deep enough."""
    best = valleys[0]
    deep = [one for one in valleys if one.loss - best.loss < RISE]
    outermost = max(deep, key=lambda one: direction * one.at[number])
    begins = [best] if outermost is best else [best, outermost]
    return max(
        (_walk(candidate, measured, best.loss, one, number, direction, met) for one in begins),
        key=lambda end: direction * end,
    )


def _walk(
    candidate: Candidate,
    measured: Measured,
    lowest: float,
    begin: Fitted,
    number: int,
    direction: float,
    met: list[Fitted],
) -> float:
    """Where the loss has risen enough above the ``lowest``; better fits on the way are added to ``met``."""
    _, slopes = derivatives(candidate, measured, begin.at, measured.curves)
    spread = covariance(slopes)
    along = spread[number] / spread[number, number]
    first = float(begin.at[number])
    room = max((1.0 - EDGE - first) if direction > 0 else (first - EDGE), 0.0)
    wanted = float(np.sqrt(RISE - (begin.loss - lowest)))  # roots of rises are about proportional to the distance
    near, far = (0.0, 0.0, begin.at), None  # distance, root and point: inside the end, and beyond it
    distance = wanted * float(np.sqrt(spread[number, number]))
    for _ in range(TRIES):
        distance = min(distance, room)
        value = first + direction * distance
        start = np.clip(near[2] + along * (value - near[2][number]), EDGE, 1.0 - EDGE)
        start[number] = value
        fitted_there = fit(candidate, measured, start, fixed=[number])
        if fitted_there.loss < lowest - LOWER:
            met.append(fitted_there)
        root = float(np.sqrt(max(fitted_there.loss - begin.loss, 0.0)))
        if root < wanted:
            near = (distance, root, fitted_there.at)
        else:
            far = (distance, root)
        if abs(root - wanted) < NEAR * wanted or (far is None and distance >= room):
            return value
        distance = _next(near, far, wanted)
    return first + direction * _next(near, far, wanted)


def _next(near: tuple[float, float, Array], far: tuple[float, float] | None, wanted: float) -> float:
    """An estimate of where the root of the rise is ``wanted``."""
    if far is None:
        return near[0] * min(wanted / max(near[1], 0.3 * wanted), 4.0)
    return near[0] + (far[0] - near[0]) * (wanted - near[1]) / (far[1] - near[1])
