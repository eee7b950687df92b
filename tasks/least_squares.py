"""Least squares in a box, by rows: a Levenberg-Marquardt iteration that asks for evaluations and never makes any.

The objective is that of Pekedis (2025): the sum over protocols of the RMSE over every measured point. Its value is
known exactly for each row. Its gradient comes from differences of those values, corrected for the curvature along
each difference, and its curvature, after Gauss and Newton, from the points of the curves that the store keeps, each
weighted by the number of measured points that it stands for. Damping is Marquardt's (1963); each step solves a linear
least-squares problem with bounds (Branch, Coleman and Li 1999, as in scipy).

Parameters are on the unit cube here: 0 is the lower bound of a parameter, 1 the upper.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from tasks.simulate import Array

STEP = 1e-4
DAMPINGS = (0.2, 1.0, 5.0, 50.0)
SMALLEST_GAIN = 1e-6
SNAP = 1e-9


@dataclass(frozen=True)
class Seen:
    """What became of ``n`` rows: ``objective`` ``[n, p]`` (N), forces at kept points ``[n, k]`` (N) of each curve.

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
    """Where a fit ended: ``at`` ``[d]``, ``objective`` ``[p]`` (N), its way there, and the Jacobian of every curve.

    ``trace`` holds the number of evaluations asked for so far and the best total (N); ``jacobians`` are ``[d, k]``
    (N per unit). ``converged`` is False when the budget ended first.
    """

    at: Array
    objective: Array
    trace: tuple[tuple[int, float], ...]
    jacobians: tuple[Array, ...]
    converged: bool


def least_squares(start: Array, weighing: Weighing, budget: int) -> Generator[Array, Seen, Fit | None]:
    """Fit from ``start`` ``[d]``: yields points ``[n, d]``, wants what was :class:`Seen` there, returns the fit.

    Returns None when the start itself cannot be evaluated.
    """
    at = np.clip(start, 0.0, 1.0)
    size = at.size
    seen = yield at[np.newaxis]
    used, best = 1, seen.objective[0]
    if not np.isfinite(best).all():
        return None
    trace = [(used, float(best.sum()))]
    damping, converged = 1e-2, False
    side = np.ones(size)
    jacobians: tuple[Array, ...] = tuple(np.zeros((size, force.shape[1])) for force in seen.forces)
    here = tuple(force[0] for force in seen.forces)
    while used + size + len(DAMPINGS) <= budget:
        steps = side * np.where((at + side * STEP >= 0.0) & (at + side * STEP <= 1.0), STEP, -STEP)
        moved = yield at + np.diag(steps)
        used += size
        alive = np.asarray(np.isfinite(moved.objective).all(axis=1))  # what fails is not gone to this time
        side[~alive] *= -1  # and looked at from the other side the next time
        jacobians = tuple(
            np.where(alive[:, np.newaxis], (force - base) / steps[:, np.newaxis], 0.0)
            for force, base in zip(moved.forces, here, strict=True)
        )
        curvature = _curvature(jacobians, weighing, best)
        slopes = np.where(alive, (moved.objective.sum(axis=1) - best.sum()) / steps, 0.0)
        gradient = np.where(alive, slopes - 0.5 * steps * np.diag(curvature), 0.0)
        tried = [damping * factor for factor in DAMPINGS]
        candidates = np.array([_step(at, gradient, curvature, value) for value in tried])
        seen = yield candidates
        used += len(candidates)
        totals = seen.objective.sum(axis=1)
        totals[~np.isfinite(totals)] = np.inf
        chosen = int(np.argmin(totals))
        gain = float(best.sum() - totals[chosen])
        if gain > 0:
            at, best = candidates[chosen], seen.objective[chosen]
            here = tuple(force[chosen] for force in seen.forces)
            damping = max(tried[chosen], 1e-9)
        else:
            damping *= 500.0
        trace.append((used, float(best.sum())))
        if alive.all() and gain <= SMALLEST_GAIN * best.sum() and (gain > 0 or damping > 1e6):
            converged = True
            break
    return Fit(at, best, tuple(trace), jacobians, converged)


def _curvature(jacobians: Sequence[Array], weighing: Weighing, objective: Array) -> Array:
    """Gauss-Newton curvature ``[d, d]`` of the sum of RMSEs."""
    parts = [
        (jacobian * share) @ jacobian.T / (count * max(rmse, 1e-12))
        for jacobian, share, count, rmse in zip(jacobians, weighing.shares, weighing.counts, objective, strict=True)
    ]
    return np.sum(parts, axis=0)


def _step(at: Array, gradient: Array, curvature: Array, damping: float) -> Array:
    """The point that the damped quadratic model likes best inside the unit cube."""
    scale = np.trace(curvature) or 1.0
    damped = curvature + np.diag(damping * np.diag(curvature) + 1e-12 * scale)
    upper = np.linalg.cholesky(damped).T
    target = -solve_triangular(upper.T, gradient, lower=True)
    reach = 1e-15
    found = lsq_linear(upper, target, bounds=(-at - reach, 1.0 - at + reach)).x
    moved = np.clip(at + found, 0.0, 1.0)
    return np.where(moved < SNAP, 0.0, np.where(moved > 1.0 - SNAP, 1.0, moved))
