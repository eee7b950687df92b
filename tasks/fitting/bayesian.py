"""Bayesian optimisation of rows: asynchronous, but reproducible.

The objective is a composite function: the sum of the RMSEs of the simulated curves. So a Gaussian process
(scikit-optimize; Matern 5/2 with a length scale for each parameter, and noise) models the residuals along the curves,
and the objective is computed from them (Astudillo and Frazier 2019). Each evaluation then gives hundreds of numbers
instead of one, and residuals are smooth where their RMSE has a kink. All residuals share one kernel and one variance,
so one factorisation serves all their principal components.

The next point has the largest expected improvement of the logarithm of the objective: a sum of RMSEs is positive and
spans decades. While ``pending`` points are being evaluated, the mean of the process stands in for their outcome (the
"kriging believer" of Ginsbourger, Le Riche and Carraro 2010). Proposal ``k`` always uses the outcomes of all earlier
points but the last ``pending``, so it does not depend on the speed of the workers.

Parameters are on the unit cube here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from sinew.tasks.fitting.gaussian_process import fitted
from sinew.tasks.simulate import Array

COMPONENTS = 12  # principal components of the residuals; the remainder is far below any noise
DRAWS = 32  # samples for one expected improvement
CANDIDATES, NEAR, POLISHED = 500, 2000, 2
POLISH_STEPS = 15
SLOPE_STEP = 1e-5
REFIT_EVERY = 2  # proposals between two fits of the length scales
TIE = 1e-6  # weight of the expected objective itself, which decides where no sample improves


@dataclass(frozen=True)
class Search:
    """The evaluations of a search, in the order in which they were asked for.

    ``points`` ``[n, d]``, the total objective of each ``[n]`` (N, infinite where the model failed), and ``residuals``
    ``[n, p, k]`` (N): simulated less measured along ``p`` curves, scaled so that the norm of the last axis is the RMSE.
    """

    points: Array
    totals: Array
    residuals: Array


@dataclass(frozen=True)
class Surrogate:
    """What is known when a point is proposed: ``points`` ``[n, d]`` with the components ``scores`` ``[n, m]`` of their
    residuals, ``roots`` ``[p, r, m + 1]`` that make an objective of those (see :func:`totals_of`), ``failed``
    ``[f, d]``, ``pending`` ``[k, d]``, the kernel's last ``theta`` (of :func:`.gaussian_process.fitted`;
    None: not fitted yet), and whether to fit it again.
    """

    points: Array
    scores: Array
    roots: Array
    failed: Array
    pending: Array
    theta: Array | None
    refit: bool


def propose(surrogate: Surrogate, seed: tuple[int, ...]) -> tuple[Array, Array]:
    """The next point ``[d]`` and the kernel's ``theta``."""
    rng = np.random.default_rng(seed)
    process, theta = fitted(surrogate.points, surrogate.scores, surrogate.theta, refit=surrogate.refit)
    if len(surrogate.pending):
        believed = np.concatenate([surrogate.scores, process.mean(surrogate.pending)])
        known = np.concatenate([surrogate.points, surrogate.pending])
        process, _ = fitted(known, believed, theta, refit=False)
    alive = _alive(surrogate, theta)
    totals = totals_of(surrogate.scores, surrogate.roots)
    half = rng.standard_normal((DRAWS // 2, surrogate.scores.shape[1]))
    draws = np.concatenate([half, -half])  # antithetic: their mean is exactly zero

    def gain(at: Array) -> Array:
        drawn = _drawn_totals(*process.mean_and_sd(at), draws, surrogate.roots)
        improvement = np.log(totals.min() / np.maximum(drawn, 1e-12))
        return alive(at) * np.maximum(improvement, 0.0).mean(axis=1) + TIE * improvement.mean(axis=1)

    candidates = _candidates(surrogate.points, totals, rng)
    gains = np.concatenate([gain(some) for some in np.array_split(candidates, 10)])  # parts fit a processor's cache
    starts = candidates[np.argsort(-gains, kind="stable")[:POLISHED]]
    ends = [_polished(gain, start) for start in starts]
    _, chosen = max(ends, key=lambda end: end[0])
    return chosen, theta


def components(residuals: Array) -> tuple[Array, Array]:
    """Of residuals ``[n, p, k]`` the ``scores`` ``[n, m]``, and ``roots`` ``[p, r, m + 1]`` for :func:`totals_of`."""
    flat = residuals.reshape(len(residuals), -1)
    mean = flat.mean(axis=0)
    _, _, directions = np.linalg.svd(flat - mean, full_matrices=False)
    scores = (flat - mean) @ directions[:COMPONENTS].T
    parts = np.concatenate([mean[np.newaxis], directions[:COMPONENTS]]).reshape(-1, *residuals.shape[1:])
    return scores, np.array([np.linalg.qr(parts[:, curve].T, mode="r") for curve in range(parts.shape[1])])


def totals_of(scores: Array, roots: Array) -> Array:
    """The objective ``[n]`` (N) of residuals with ``scores`` ``[n, m]``.

    A curve's residuals are its mean ones and ``m`` directions times the scores; ``roots`` ``[p, r, m + 1]`` hold, for
    each curve, all of these in as few coordinates as they span.
    """
    return _drawn_totals(scores, np.zeros(len(scores)), np.zeros((1, scores.shape[1])), roots)[:, 0]


def _drawn_totals(mean: Array, sd: Array, draws: Array, roots: Array) -> Array:
    """The objective ``[n, s]`` (N) of scores ``mean`` ``[n, m]`` plus ``sd`` ``[n]`` times ``draws`` ``[s, m]``.

    Squares of sums are expanded, so no array holds all scores of all draws.
    """
    directions = roots[:, :, 1:].transpose(0, 2, 1)
    middle = mean @ directions + roots[:, np.newaxis, :, 0]
    moved = draws @ directions
    both = middle @ moved.transpose(0, 2, 1)
    squares = np.sum(middle**2, axis=-1)[:, :, np.newaxis] + 2.0 * sd[:, np.newaxis] * both
    squares += sd[:, np.newaxis] ** 2 * np.sum(moved**2, axis=-1)[:, np.newaxis]
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)).sum(axis=0))


def _alive(surrogate: Surrogate, theta: Array) -> Callable[[Array], Array]:
    """The probability ``[g]`` that the model does not fail at points ``[g, d]``, from nearby failures."""
    if not len(surrogate.failed):
        return lambda at: np.ones(len(at))
    points = np.concatenate([surrogate.points, surrogate.failed])
    failed = np.repeat([0.0, 1.0], [len(surrogate.points), len(surrogate.failed)])
    process, _ = fitted(points, failed[:, np.newaxis], theta, refit=False)
    return lambda at: 1.0 - np.clip(process.mean(at).ravel(), 0.0, 1.0)


def _candidates(points: Array, totals: Array, rng: np.random.Generator) -> Array:
    """Random points of the whole cube, and the best points with some of their coordinates changed."""
    size = points.shape[1]
    best = points[np.argsort(totals, kind="stable")[:5]]
    centres = best[rng.integers(len(best), size=NEAR)]
    spread = 10.0 ** rng.uniform(-2.5, -0.5, size=(NEAR, 1))
    moved = rng.random((NEAR, size)) < rng.choice([0.15, 0.4, 1.0], size=(NEAR, 1))
    near = centres + moved * spread * rng.standard_normal((NEAR, size))
    return np.concatenate([rng.random((CANDIDATES, size)), np.clip(near, 0.0, 1.0)])


def _polished(gain: Callable[[Array], Array], start: Array) -> tuple[float, Array]:
    """The local maximum of the gain near ``start``: its value and its point."""
    unit = max(abs(float(gain(start[np.newaxis])[0])), TIE)

    def loss(at: Array) -> tuple[float, Array]:
        steps = np.where(at + SLOPE_STEP <= 1.0, SLOPE_STEP, -SLOPE_STEP)
        gains = gain(np.concatenate([at[np.newaxis], at + np.diag(steps)])) / unit
        return -float(gains[0]), -(gains[1:] - gains[0]) / steps

    found = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * start.size, options={"maxiter": POLISH_STEPS}
    )
    return -float(found.fun) * unit, np.clip(found.x, 0.0, 1.0)


def bayesian(
    ask: Callable[[Array], None],
    next_result: Callable[[], tuple[float, Array]],
    propose_one: Callable[[int, Surrogate], tuple[Array, Array]],
    *,
    size: int,
    budget: int,
    initial: int,
    pending: int,
    seeds: Search,
    rng: np.random.Generator,
) -> Search:
    """Search the unit cube of ``size`` parameters by ``budget`` evaluations, of which ``initial`` are random.

    ``ask`` asks for ``[1, d]`` and does not wait; ``next_result`` gives the total objective (N, infinite if the row
    failed) and the residuals ``[p, k]`` (N) of the next row; ``propose_one(k, surrogate)`` calls :func:`propose`,
    here or on a worker. ``seeds``: evaluations that are known already.
    """
    points = list(rng.random((min(initial, budget), size)))
    for point in points:
        ask(point[np.newaxis])
    totals: list[float] = []
    residuals: list[Array] = []
    theta: Array | None = None
    while len(totals) < budget:
        while len(points) < budget and len(points) - len(totals) < pending:
            alive = np.isfinite([*seeds.totals, *totals])
            if alive.sum() < 2:
                points.append(rng.random(size))
            else:
                known = np.array([*seeds.points, *points[: len(totals)]])
                scores, roots = components(np.array([*seeds.residuals, *residuals])[alive])
                waiting = np.array(points[len(totals) :]).reshape(-1, size)
                refit = (len(points) - min(initial, budget)) % REFIT_EVERY == 0
                surrogate = Surrogate(known[alive], scores, roots, known[~alive], waiting, theta, refit)
                point, theta = propose_one(len(points), surrogate)
                points.append(point)
            ask(points[-1][np.newaxis])
        total, along = next_result()
        totals.append(total)
        residuals.append(along)
    return Search(np.array(points).reshape(-1, size), np.array(totals), np.array(residuals))


def informative(totals: Array, count: int) -> Array:
    """Of points with ``totals`` ``[n]``, the best half of ``count``, and others spread evenly over the rest."""
    order = np.argsort(totals, kind="stable")
    best, rest = order[: count // 2], order[count // 2 :]
    return np.concatenate([best, rest[np.linspace(0, rest.size - 1, min(rest.size, count - count // 2)).astype(int)]])
