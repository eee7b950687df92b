"""Where to run a model next, so that its emulator gets surer everywhere.

A run at a point makes a Gaussian process surer at others, by the square of their covariance over the variance at that
point (active learning of Cohn, 1996, Neural Netw. 9, 1071). Runs of a batch are chosen one after the other: each is
taken for done, which changes the covariances but needs no outcome.
"""

import numpy as np
from scipy.linalg import solve_triangular

from sinew.tasks.fitting.emulator import Emulator
from sinew.tasks.fitting.gaussian_process import Process
from sinew.tasks.simulate import Array

LIKELY = 0.5  # of a run that does not fail
LEADING = 4  # principal components that decide


def next_runs(emulator: Emulator, pool: Array, alive: Array, count: int) -> Array:
    """The numbers ``[count]`` of the points of ``pool`` ``[m, d]`` that are to be run next.

    ``alive`` ``[m]``: how probable it is that the model does not fail there. Where it likely does, the process knows
    nothing and never will: such points are neither run nor counted, unless there are too few others.
    """
    alive = np.where(alive >= LIKELY, alive, 0.0)
    processes = emulator.processes[:LEADING]
    known = [_covariance_after(process, pool) for process in processes]
    noise = [float(process.regressor.alpha) * process.scale**2 for process in processes]
    chosen: list[int] = []
    for _ in range(count):
        gain = np.zeros(len(pool))
        for covariance, own in zip(known, noise, strict=True):
            gain += (np.square(covariance) @ alive) / (np.diag(covariance) + own)
        gain *= alive
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        known = [_with(covariance, best, own) for covariance, own in zip(known, noise, strict=True)]
    return np.array(chosen, dtype=int)


def _covariance_after(process: Process, pool: Array) -> Array:
    """The covariance ``[m, m]`` of a process at the points of a pool, after what it was trained with."""
    regressor = process.regressor
    across = regressor.kernel_(pool, regressor.X_train_)
    told = solve_triangular(regressor.L_, across.T, lower=True, check_finite=False)
    return np.asarray((regressor.kernel_(pool) - told.T @ told) * process.scale**2)


def _with(covariance: Array, point: int, noise: float) -> Array:
    """The covariance once a point is known as well."""
    row = covariance[point]
    return np.asarray(covariance - np.outer(row, row) / (max(row[point], 0.0) + max(noise, 1e-12 * row.max())))
