"""Bounded least squares: a Levenberg-Marquardt iteration that asks for evaluations instead of making them.

The objective is that of Pekedis (2025): the sum over protocols of the RMSE over every measured point. Its value is
known exactly for each row. Its gradient comes from differences of those values, corrected for the curvature along
each difference. Its Gauss-Newton curvature comes from the points of the curves that the store keeps, each weighted by
the number of measured points that it represents. Differences cost one evaluation per parameter, so between them the
derivatives are updated from the steps themselves (Broyden 1965), as long as steps gain enough.
Damping is Marquardt's (1963); each step solves a linear least-squares problem with bounds (Branch, Coleman and Li 1999,
as in scipy).

Parameters are on the unit cube here: 0 is the lower bound of a parameter, 1 the upper.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from sinew.tasks.simulate import Array

STEP = 1e-4
DAMPINGS = (0.3, 3.0)
LARGEST_DAMPING = 1e6
SMALLEST_GAIN = 1e-6
WORTHWHILE = 0.01  # of the objective: a step that gains less calls for new differences
SNAP = 1e-9


@dataclass(frozen=True)
class Seen:
    """The results of ``n`` rows: ``objective`` ``[n, p]`` (N), forces at kept points ``[n, k]`` (N) of each curve.

    Rows that failed are NaN.
    """

    objective: Array
    forces: tuple[Array, ...]


@dataclass(frozen=True)
class Weighing:
    """For each curve: how many points were measured, and how many each kept point stands for ``[k]``."""

    counts: tuple[int, ...]
    shares: tuple[Array, ...]


@dataclass(frozen=True)
class Fit:
    """The end of a fit: ``at`` ``[d]``, ``objective`` ``[p]`` (N), its history, and the Jacobian of every curve.

    ``trace`` holds the number of evaluations asked for so far and the best total (N); ``jacobians`` are ``[d, k]``
    (N per unit). ``converged`` is False when the budget ended first.
    """

    at: Array
    objective: Array
    trace: tuple[tuple[int, float], ...]
    jacobians: tuple[Array, ...]
    converged: bool


def least_squares(
    start: Array, weighing: Weighing, budget: int, after_step: Callable[[Fit], None] = lambda fit: None
) -> Generator[Array, Seen, Fit | None]:
    """Fit from ``start`` ``[d]``: yields points ``[n, d]``, expects what was :class:`Seen` there, returns the fit.

    Returns None when the start itself cannot be evaluated. ``after_step`` is called with the fit so far.
    """
    at = np.clip(start, 0.0, 1.0)
    size = at.size
    seen = yield at[np.newaxis]
    used, best = 1, seen.objective[0]
    if not np.isfinite(best).all():
        return None
    trace = [(used, float(best.sum()))]
    damping, converged = 1e-2, False
    side, alive = np.ones(size), np.ones(size, dtype=bool)
    here = tuple(force[0] for force in seen.forces)
    jacobians: tuple[Array, ...] = tuple(np.zeros((size, force.size)) for force in here)
    gradients = np.zeros((len(here), size))  # gradient of half the squared residuals of each curve
    outdated = True
    while used + outdated * size + len(DAMPINGS) <= budget:
        current = outdated
        if outdated:
            steps = _difference_steps(at, side)
            moved = yield at + np.diag(steps)
            used += size
            alive = np.asarray(np.isfinite(moved.objective).all(axis=1))  # a direction that fails is left out this time
            side[~alive] *= -1  # and tried from the other side next time
            jacobians, gradients = _derivatives(moved, steps, alive, here, best, weighing)
        curvature = curvature_of(jacobians, weighing, best)
        gradient = _gradient(gradients, weighing, best)
        tried = [damping * factor for factor in DAMPINGS]
        candidates = np.array([_step(at, gradient, curvature, value) for value in tried])
        seen = yield candidates
        used += len(candidates)
        totals = seen.objective.sum(axis=1)
        totals[~np.isfinite(totals)] = np.inf
        chosen = int(np.argmin(totals))
        gain = float(best.sum() - totals[chosen])
        for number in np.argsort(-totals):  # the best last: it weighs most
            if np.isfinite(totals[number]):
                forces = tuple(force[number] for force in seen.forces)
                jacobians = _broyden(jacobians, candidates[number] - at, forces, here)
        if gain > 0:
            arrived = tuple(force[chosen] for force in seen.forces)
            gradients = _updated(gradients, jacobians, weighing, arrived, here)
            at, best, here = candidates[chosen], seen.objective[chosen], arrived
            damping = max(tried[chosen], 1e-9)
        else:
            damping *= 30.0
        trace.append((used, float(best.sum())))
        after_step(Fit(at, best, tuple(trace), jacobians, False))
        little = gain <= SMALLEST_GAIN * best.sum()
        if current and alive.all() and little and (gain > 0 or damping > LARGEST_DAMPING):
            converged = True
            break
        stuck = gain <= 0 and current  # the derivatives are of this very point: all that is left is a smaller step
        outdated = gain < WORTHWHILE * best.sum() and (not stuck or damping > LARGEST_DAMPING)
    return Fit(at, best, tuple(trace), jacobians, converged)


def _difference_steps(at: Array, side: Array) -> Array:
    """Steps ``[d]`` of the differences, to the preferred side (1 or -1) unless that leaves the unit cube."""
    steps: Array = side * np.where((at + side * STEP >= 0.0) & (at + side * STEP <= 1.0), STEP, -STEP)
    return steps


def _derivatives(
    moved: Seen, steps: Array, alive: Array, here: tuple[Array, ...], best: Array, weighing: Weighing
) -> tuple[tuple[Array, ...], Array]:
    """Jacobians ``[d, k]`` of the kept forces, and gradients ``[p, d]`` of half the squared residuals."""
    jacobians, gradients = [], []
    for number, (forces, base) in enumerate(zip(moved.forces, here, strict=True)):
        jacobian = np.where(alive[:, np.newaxis], (forces - base) / steps[:, np.newaxis], 0.0)
        slope = np.where(alive, (moved.objective[:, number] - best[number]) / steps, 0.0)
        bend = np.sum(jacobian**2 * weighing.shares[number], axis=1)
        gradients.append(weighing.counts[number] * best[number] * slope - np.where(alive, 0.5 * steps * bend, 0.0))
        jacobians.append(jacobian)
    return tuple(jacobians), np.array(gradients)


def _gradient(gradients: Array, weighing: Weighing, objective: Array) -> Array:
    """Gradient ``[d]`` of the sum of RMSEs, from those of half the squared residuals of each curve."""
    parts = [p / (n * max(r, 1e-12)) for p, n, r in zip(gradients, weighing.counts, objective, strict=True)]
    return np.sum(parts, axis=0)


def _updated(
    gradients: Array,
    jacobians: tuple[Array, ...],
    weighing: Weighing,
    forces: tuple[Array, ...],
    here: tuple[Array, ...],
) -> Array:
    """The ``gradients`` ``[p, d]`` of half the squared residuals, after a step from forces ``here`` to ``forces``."""
    changes = [j @ (s * (new - old)) for j, s, new, old in zip(jacobians, weighing.shares, forces, here, strict=True)]
    return gradients + np.array(changes)


def _broyden(
    jacobians: tuple[Array, ...], moved: Array, forces: tuple[Array, ...], here: tuple[Array, ...]
) -> tuple[Array, ...]:
    """The nearest Jacobians that are right along ``moved`` ``[d]``."""
    square = float(moved @ moved)
    if square < STEP**2:
        return jacobians
    return tuple(
        jacobian + np.outer(moved / square, force - base - moved @ jacobian)
        for jacobian, force, base in zip(jacobians, forces, here, strict=True)
    )


def curvature_of(jacobians: Sequence[Array], weighing: Weighing, objective: Array) -> Array:
    """Gauss-Newton curvature ``[d, d]`` of the sum of RMSEs."""
    parts = [
        (jacobian * share) @ jacobian.T / (count * max(rmse, 1e-12))
        for jacobian, share, count, rmse in zip(jacobians, weighing.shares, weighing.counts, objective, strict=True)
    ]
    return np.sum(parts, axis=0)


def _step(at: Array, gradient: Array, curvature: Array, damping: float) -> Array:
    """The minimum of the damped quadratic model inside the unit cube."""
    scale = np.trace(curvature) or 1.0
    damped = curvature + np.diag(damping * np.diag(curvature) + 1e-12 * scale)
    upper = np.linalg.cholesky(damped).T
    target = -solve_triangular(upper.T, gradient, lower=True)
    reach = 1e-15
    found = lsq_linear(upper, target, bounds=(-at - reach, 1.0 - at + reach)).x
    moved = np.clip(at + found, 0.0, 1.0)
    return np.where(moved < SNAP, 0.0, np.where(moved > 1.0 - SNAP, 1.0, moved))
