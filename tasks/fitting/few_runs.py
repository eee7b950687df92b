"""Least squares where each evaluation is a run of a solver: derivatives are renewed seldom, and updated in between.

Between renewals, the derivatives follow the residuals that steps have shown (Broyden 1965, Math Comp 19). They are
found anew where steps no longer help; the search ends where new derivatives do not lead any further.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from sinew.tasks.simulate import Array

VERSION = 1  # of the fits that are made here
ENOUGH, AT_MOST = 0.1, 0.5  # of a sum of squares, twice the log likelihood: smaller gains decide nothing
PART = 1e-4  # of it: smaller gains are not looked for, up to AT_MOST
SMALL = 1e-3  # of a unit cube: over smaller steps, residuals show the solver's tolerance and no derivative
STEPS = 12  # from one renewal to the next, at most
RENEWALS = 8


def most_runs(size: int, renewals: int = RENEWALS) -> int:
    """The most runs of a fit of ``size`` parameters whose derivatives are differences to one side."""
    return (renewals + 1) * (1 + size) + renewals * STEPS


def least_squares_of_few(
    residuals: Callable[[Array], Array],
    derivatives: Callable[[Array], tuple[Array, Array]],
    start: Array,
    bounds: tuple[float, float] = (0.0, 1.0),
    renewals: int = RENEWALS,
) -> OptimizeResult:
    """The nearest minimum to ``start`` ``[k]`` within ``bounds``, of the sum of squares of ``residuals`` ``[t]``.

    ``derivatives`` gives residuals and their derivatives ``[t, k]``; they are found anew ``renewals`` times at most. As
    :func:`scipy.optimize.least_squares`; the derivatives of the result are the last that were found anew, near its end.
    Raises :class:`ValueError` as that does.
    """

    def renewed(at: Array) -> tuple[OptimizeResult, Array]:
        seen, slopes = derivatives(at)
        return OptimizeResult(x=at, fun=seen, cost=0.5 * float(seen @ seen)), slopes

    found, slopes = renewed(start)
    for _ in range(renewals):
        followed = _Followed(residuals, found.x, found.fun, slopes)
        tried = least_squares(
            followed.residuals, found.x, jac=followed.slopes, bounds=bounds, ftol=1e-5, xtol=1e-5, gtol=1e-7,
            max_nfev=STEPS,
        )  # fmt: skip
        gain = 2.0 * (found.cost - tried.cost)
        if tried.cost < found.cost:
            found = tried
        if gain < max(ENOUGH, min(2.0 * PART * found.cost, AT_MOST)):
            break
        found, slopes = renewed(found.x)
    found.jac, found.grad = slopes, slopes.T @ found.fun
    return found


class _Followed:
    """Residuals, and derivatives that follow them."""

    def __init__(self, ask: Callable[[Array], Array], at: Array, seen: Array, slopes: Array) -> None:
        self._ask = ask
        self._last = self._at = at
        self._last_seen = self._seen = seen
        self._slopes = slopes

    def residuals(self, at: Array) -> Array:
        """``[t]`` at a point ``[k]``."""
        if not np.array_equal(at, self._last):
            self._last, self._last_seen = at.copy(), self._ask(at)
        return self._last_seen

    def slopes(self, at: Array) -> Array:
        """``[t, k]`` at the point ``[k]`` that residuals were asked of last."""
        step = at - self._at
        if np.linalg.norm(step) > SMALL:
            wrong = self.residuals(at) - self._seen - self._slopes @ step
            self._slopes = self._slopes + np.outer(wrong, step / (step @ step))
            self._at, self._seen = at.copy(), self._last_seen
        return self._slopes
