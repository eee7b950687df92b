"""Bayesian optimisation by rows, asynchronous and still the same every time.

A Gaussian process (scikit-optimize; Matern 5/2 with a length scale for each parameter, and noise) stands for the
logarithm of the objective: a sum of RMSEs is positive and spans decades. The next point has the largest expected
improvement. While ``pending`` points are being evaluated, the process takes its own mean for their outcome (the
"kriging believer" of Ginsbourger, Le Riche and Carraro 2010). Proposal ``k`` knows the outcomes of all but the last
``pending`` before it, never more, so it does not depend on which worker was fast.

Parameters are on the unit cube here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize
from skopt.acquisition import gaussian_ei
from skopt.learning import GaussianProcessRegressor
from skopt.learning.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

from tasks.simulate import Array

CANDIDATES, NEAR, POLISHED = 500, 2000, 2
FIT_STEPS, POLISH_STEPS = 40, 15
REFIT_EVERY = 2  # proposals between two fits of the length scales
SCALE_BOUNDS = (0.05, 30.0)
NOISE, NOISE_BOUNDS = 1e-4, (1e-8, 1e-1)
TRADE = 0.0  # improvement asked for, in units of log objective


@dataclass(frozen=True)
class Surrogate:
    """What is known when a point is proposed: ``points`` ``[n, d]``, ``values`` ``[n]`` (logarithm of the objective),
    ``pending`` ``[k, d]``, the kernel's last ``theta`` (see :func:`fitted`; None: not fitted yet), and whether to fit
    it again.
    """

    points: Array
    values: Array
    pending: Array
    theta: Array | None
    refit: bool


def propose(surrogate: Surrogate, seed: tuple[int, ...]) -> tuple[Array, Array]:
    """The next point ``[d]`` and the kernel's ``theta``."""
    rng = np.random.default_rng(seed)
    process, theta = fitted(surrogate.points, surrogate.values, surrogate.theta, refit=surrogate.refit)
    if len(surrogate.pending):
        believed = np.concatenate([surrogate.values, process.predict(surrogate.pending)])
        known = np.concatenate([surrogate.points, surrogate.pending])
        process, _ = fitted(known, believed, theta, refit=False)
    best = float(surrogate.values.min())
    candidates = _candidates(surrogate, rng)
    gains = gaussian_ei(candidates, process, best, TRADE)
    starts = candidates[np.argsort(-gains, kind="stable")[:POLISHED]]
    ends = [_polished(process, start, best) for start in starts]
    _, chosen = max(ends, key=lambda end: end[0])
    return chosen, theta


def fitted(
    points: Array, values: Array, theta: Array | None, *, refit: bool = True
) -> tuple[GaussianProcessRegressor, Array]:
    """The process for ``values`` ``[n]`` at ``points`` ``[n, d]``, and its ``theta`` ``[d + 2]``.

    ``theta`` holds logarithms: of the variance, of the length scales, and of the noise's variance, in units of the
    variance of ``values``. It is fitted with ``refit``, from where it was before.
    """
    size = points.shape[1]
    kernel = ConstantKernel(1.0, (1e-2, 1e3)) * Matern(np.full(size, 1.0), [SCALE_BOUNDS] * size, nu=2.5)
    if refit or theta is None:
        noisy = kernel + WhiteKernel(NOISE, NOISE_BOUNDS)
        noisy = noisy if theta is None else noisy.clone_with_theta(theta)
        theta = _likeliest(noisy, points, values)
    kernel, noise = kernel.clone_with_theta(theta[:-1]), float(np.exp(theta[-1]))
    process = GaussianProcessRegressor(kernel, alpha=noise, normalize_y=True, optimizer=None)
    return process.fit(points, values), theta


def _likeliest(kernel: Any, points: Array, values: Array) -> Array:
    """The ``theta`` with the largest marginal likelihood, sought from the kernel's own."""
    process = GaussianProcessRegressor(kernel, alpha=0.0, normalize_y=True, optimizer=None).fit(points, values)

    def loss(theta: Array) -> tuple[float, Array]:
        value, slope = process.log_marginal_likelihood(theta, eval_gradient=True)
        return -float(value), -slope

    options = {"maxiter": FIT_STEPS}
    found = minimize(loss, kernel.theta, jac=True, method="L-BFGS-B", bounds=kernel.bounds, options=options)
    return np.asarray(found.x)


def _candidates(surrogate: Surrogate, rng: np.random.Generator) -> Array:
    """Everywhere in the cube, and around the best points, in some of their coordinates."""
    size = surrogate.points.shape[1]
    best = surrogate.points[np.argsort(surrogate.values, kind="stable")[:5]]
    centres = best[rng.integers(len(best), size=NEAR)]
    spread = 10.0 ** rng.uniform(-2.5, -0.5, size=(NEAR, 1))
    moved = rng.random((NEAR, size)) < rng.choice([0.15, 0.4, 1.0], size=(NEAR, 1))
    near = centres + moved * spread * rng.standard_normal((NEAR, size))
    return np.concatenate([rng.random((CANDIDATES, size)), np.clip(near, 0.0, 1.0)])


def _polished(process: GaussianProcessRegressor, start: Array, best: float) -> tuple[float, Array]:
    def loss(at: Array) -> tuple[float, Array]:
        value, slope = gaussian_ei(at[np.newaxis], process, best, TRADE, return_grad=True)
        return -float(value[0]), -np.asarray(slope).ravel()

    found = minimize(
        loss, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * start.size, options={"maxiter": POLISH_STEPS}
    )
    return -float(found.fun), np.clip(found.x, 0.0, 1.0)


@dataclass(frozen=True)
class Search:
    """What a search saw: ``points`` ``[n, d]`` in the order of asking and the total objective of each ``[n]`` (N)."""

    points: Array
    totals: Array


def bayesian(
    ask: Callable[[Array], None],
    hear: Callable[[], float],
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

    ``ask`` asks for ``[1, d]`` and goes on; ``hear`` gives the total objective of the next one (N, infinite when it
    failed); ``propose_one(k, surrogate)`` is :func:`propose` wherever it is to run. ``seeds``: evaluations that are
    known already.
    """
    points = list(rng.random((min(initial, budget), size)))
    for point in points:
        ask(point[np.newaxis])
    totals: list[float] = []
    theta: Array | None = None
    while len(totals) < budget:
        while len(points) < budget and len(points) - len(totals) < pending:
            known = np.concatenate([seeds.points, np.array(points[: len(totals)]).reshape(-1, size)])
            values = np.concatenate([seeds.totals, totals])
            if np.isfinite(values).sum() < 2:
                points.append(rng.random(size))
            else:
                waiting = np.array(points[len(totals) :]).reshape(-1, size)
                count = len(points) - min(initial, budget)
                surrogate = Surrogate(known, _logarithms(values), waiting, theta, count % REFIT_EVERY == 0)
                point, theta = propose_one(len(points), surrogate)
                points.append(point)
            ask(points[-1][np.newaxis])
        totals.append(hear())
    return Search(np.array(points).reshape(-1, size), np.array(totals))


def informative(totals: Array, count: int) -> Array:
    """Of points with ``totals`` ``[n]``, the best half of ``count``, and others spread evenly over the rest."""
    order = np.argsort(totals, kind="stable")
    best, rest = order[: count // 2], order[count // 2 :]
    return np.concatenate([best, rest[np.linspace(0, rest.size - 1, min(rest.size, count - count // 2)).astype(int)]])


def _logarithms(totals: Array) -> Array:
    """Failures count as the worst that was seen: the process learns to keep away."""
    finite = np.isfinite(totals)
    worst = totals[finite].max()
    return np.log(np.maximum(np.where(finite, totals, worst), 1e-12))
