"""Least squares where each evaluation is a run of a solver: steps are those of an approximation, which runs correct.

A trust-region method (Conn, Gould and Toint 2000, Trust-Region Methods). The approximation is linear, with derivatives
that follow the residuals which steps have shown (Broyden 1965, Math Comp 19), or one that the caller has. Derivatives
are found anew where it is poor, and at the end.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import OptimizeResult, least_squares, lsq_linear

from sinew.tasks.simulate import Array

VERSION = 2  # of the fits that are made here
ENOUGH, AT_MOST = 0.1, 0.5  # of a sum of squares, twice the log likelihood: smaller gains decide nothing
PART = 1e-4  # of it: smaller gains are not looked for, up to AT_MOST
SMALL = 1e-3  # of a unit cube: over smaller steps, residuals show the solver's tolerance and no derivative
STEPS = 12  # from one renewal to the next, at most
RENEWALS = 8
POOR, GOOD = 0.25, 0.75  # of a promised gain: less is a poor approximation, more a good one
POORLY = 2  # poor steps after which derivatives are found anew
INNER, APART = 20, 1e-3  # iterations of an approximation of the caller's, and steps of its derivatives

Residuals = Callable[[Array], Array]
"""Residuals ``[t]`` at a point ``[k]``."""


class Approximation(Protocol):
    """What is like the model where it was run last."""

    def __call__(self, at: Array) -> Array | None:
        """Residuals ``[n, t]`` at points ``[n, k]`` without a run; None where too little is known for it."""
        ...

    def keep(self) -> None:
        """Remember what it is like now, before the model is run elsewhere."""
        ...

    def go_back(self) -> None:
        """Be like that again: where the model was run since, it was no better."""
        ...


def most_runs(size: int, renewals: int = RENEWALS) -> int:
    """The most runs of a fit of ``size`` parameters whose derivatives are differences to one side."""
    return (renewals + 1) * (1 + size) + renewals * STEPS


def least_squares_of_few(
    residuals: Residuals,
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    bounds: tuple[float, float] = (0.0, 1.0),
    renewals: int = RENEWALS,
    nearly: Approximation | None = None,
) -> OptimizeResult:
    """The nearest minimum to ``start`` ``[k]`` within ``bounds``, of the sum of squares of ``residuals`` ``[t]``.

    ``derivatives`` gives residuals and their derivatives ``[t, k]``; they are found anew ``renewals`` times at most.
    ``nearly``: what takes the place of a linear approximation. As :func:`scipy.optimize.least_squares`; the derivatives
    of the result are the last that were found anew, near its end.
    Raises :class:`ValueError` for a start that is not within the bounds.
    """
    if not np.all((start >= bounds[0]) & (start <= bounds[1])):
        raise ValueError(f"the start {start} is not within {bounds}")
    best = renewed = _Point(start, *derivatives(start))
    if not np.isfinite(best.loss):
        raise ValueError("the residuals at the start are not finite")
    radius, steps, poor = bounds[1] - bounds[0], 0, 0
    while True:
        step, promised = best.step(bounds, radius, nearly)
        worth = max(ENOUGH, min(PART * best.loss, AT_MOST))
        ends = promised < worth and np.abs(step).max() < 0.99 * radius  # nor would a longer step be worth it
        moved = not np.array_equal(best.at, renewed.at)
        if moved and (ends or steps == STEPS or poor >= POORLY):
            best = renewed = _Point(best.at, *derivatives(best.at))
            renewals, steps, poor = renewals - 1, 0, 0
            if renewals == 0:
                break
            continue
        if steps == STEPS or not (promised > 0.0 and np.any(step)):
            break
        if nearly is not None:
            nearly.keep()
        tried = best.after(step, residuals(best.at + step))
        gain = best.loss - tried.loss if np.isfinite(tried.loss) else -np.inf
        if gain > 0.0:
            best = tried
        elif nearly is not None:
            nearly.go_back()
        if ends:  # what little is left has been taken, if it was there
            break
        steps += 1
        if gain < POOR * promised:
            radius, poor = 0.5 * float(np.abs(step).max()), poor + moved
        elif gain > GOOD * promised and np.abs(step).max() > 0.99 * radius:
            radius = 2.0 * radius
    slopes = renewed.slopes
    return OptimizeResult(x=best.at, fun=best.seen, cost=0.5 * best.loss, jac=slopes, grad=slopes.T @ best.seen)


@dataclass(frozen=True, eq=False)
class _Point:
    """A point ``at`` ``[k]`` with the residuals ``seen`` there and, as they follow from runs, ``slopes`` ``[t, k]``."""

    at: Array
    seen: Array
    slopes: Array

    @property
    def loss(self) -> float:
        """The sum of squares."""
        return float(self.seen @ self.seen)

    def after(self, step: Array, seen: Array) -> "_Point":
        """The point a ``step`` ``[k]`` away, where residuals were ``seen`` which the slopes follow."""
        slopes = self.slopes
        if np.linalg.norm(step) > SMALL:
            slopes = slopes + np.outer(seen - self.seen - slopes @ step, step / (step @ step))
        return _Point(self.at + step, seen, slopes)

    def step(self, bounds: tuple[float, float], radius: float, nearly: Approximation | None) -> tuple[Array, float]:
        """The best step ``[k]`` within ``bounds`` and a ``radius``, by the approximation, and its promised gain."""
        low, high = (np.clip(bound, self.at - radius, self.at + radius) for bound in bounds)
        if nearly is not None and (there := nearly(self.at[np.newaxis])) is not None:
            return self._by(nearly, self.seen - there[0], bounds[1], low, high)
        basis, upper = np.linalg.qr(self.slopes)
        along = basis.T @ self.seen
        found = lsq_linear(upper, -along, bounds=(low - self.at, high - self.at), method="bvls")
        return np.clip(self.at + found.x, low, high) - self.at, float(along @ along - 2.0 * found.cost)

    def _by(self, nearly: Approximation, wrong: Array, most: float, low: Array, high: Array) -> tuple[Array, float]:
        """As :meth:`step`, by an approximation of the caller's from ``low`` to ``high``, each ``[k]``.

        It is ``wrong`` ``[t]`` at this point, and corrected by that. No coordinate may be above ``most``.
        """

        def ask(at: Array) -> Array:
            found = nearly(at)
            assert found is not None, "it was known a moment ago"
            return found

        def slopes(at: Array) -> Array:
            steps = np.where(at + APART <= most, APART, -APART)
            there, *moved = ask(np.concatenate([at[np.newaxis], at + np.diag(steps)]))
            return ((np.array(moved) - there) / steps[:, np.newaxis]).T

        found = least_squares(
            lambda at: ask(at[np.newaxis])[0] + wrong,
            self.at,
            jac=slopes,
            bounds=(low, high),
            ftol=1e-4,
            xtol=1e-4,
            gtol=1e-6,
            max_nfev=INNER,
        )
        return found.x - self.at, self.loss - 2.0 * float(found.cost)
