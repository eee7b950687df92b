"""90 % intervals of the effects' parameters in one specimen, by profile likelihood.

A parameter is moved away from its best value while all others are fitted again, until the loss has risen by what chance
alone would raise it to in one case of ten (Venzon and Moolgavkar 1988). Near a straight valley that is what the
curvature says; a mode slower than the holds, whose strength and time make up for each other, has a bent one.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from tasks.discover.fit import WIDTH, Candidate, Fitted, derivatives, fit
from tasks.discover.measured import Measured
from tasks.simulate import Array

ROOT = float(norm.ppf(0.95))  # of the rise of the loss at the ends of a 90 % interval
NEAR = 0.05  # of that, by which an end may miss it
TRIES = 8  # fits for an end, at most
LOWER = 0.05  # of the loss: a better fit than the best so far
AGAIN = 4  # times that walks begin anew from a better fit
EDGE = 1e-6  # of the unit cube, within which a fit stays


@dataclass(frozen=True, eq=False)
class Profiled:
    """The best fit, which may have been met on the way, and the ``ends`` ``[m, 2]`` for the effects' parameters.

    Both on the unit cube. An end on a bound of the cube is there because the loss does not rise enough before it.
    """

    fitted: Fitted
    ends: Array


def profiled(candidate: Candidate, measured: Measured, fitted: Fitted) -> Profiled:
    """Intervals around a fit to all curves of a specimen."""
    first = len(candidate.varied)
    for last in [False] * AGAIN + [True]:
        ends, better = [], None
        for number in range(first, candidate.size):
            for direction in (-1.0, 1.0):
                end, met = _walk(candidate, measured, fitted, number, direction)
                ends.append(end)
                better = met if better is None or (met is not None and met.loss < better.loss) else better
        if better is None or last:
            break
        refined = fit(candidate, measured, better.at)
        fitted = refined if refined.loss < better.loss else better
    return Profiled(fitted, np.array(ends).reshape(-1, 2))


def _walk(
    candidate: Candidate, measured: Measured, best: Fitted, number: int, direction: float
) -> tuple[float, Fitted | None]:
    """The end of an interval on one side, and a better fit than ``best`` where one was met."""
    _, slopes = derivatives(candidate, measured, best.at, measured.curves)
    covariance = np.linalg.inv(slopes.T @ slopes + WIDTH * np.eye(best.at.size))
    along = covariance[number] / covariance[number, number]
    begin = float(best.at[number])
    room = (1.0 - EDGE - begin) if direction > 0 else (begin - EDGE)
    near, far = (0.0, 0.0, best.at), None  # distance, root of the rise, and where: before the end, and behind it
    distance = ROOT * float(np.sqrt(covariance[number, number]))
    better = None
    for _ in range(TRIES):
        distance = min(distance, room)
        if distance <= 0.0:
            break
        value = begin + direction * distance
        start = np.clip(near[2] + along * (value - near[2][number]), EDGE, 1.0 - EDGE)
        start[number] = value
        found = fit(candidate, measured, start, fixed=[number])
        rise = found.loss - best.loss
        if rise < -LOWER and (better is None or found.loss < better.loss):
            better = found
        root = float(np.sqrt(max(rise, 0.0)))
        if root < ROOT:
            near = (distance, root, found.at)
        else:
            far = (distance, root)
        if abs(root - ROOT) < NEAR * ROOT or (far is None and distance >= room):
            return begin + direction * distance, better
        distance = _next(near, far)
    return begin + direction * _next(near, far), better


def _next(near: tuple[float, float, Array], far: tuple[float, float] | None) -> float:
    """Where the root of the rise may be as wanted: it is about proportional to the distance."""
    if far is None:
        return near[0] * min(ROOT / max(near[1], 0.3), 4.0)
    return near[0] + (far[0] - near[0]) * (ROOT - near[1]) / (far[1] - near[1])
