"""Fits of one specimen beside a discrepancy: parameters and the size of what no effect explains, in turn.

Beside a discrepancy a fit does not bend its parameters to follow an error of the model, and an effect gains only by
what a smooth error cannot do as well (:mod:`sinew.tasks.fitting.discrepancy`).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import lsq_linear
from threadpoolctl import threadpool_limits

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import (
    FAR,
    Fitted,
    derivatives,
    further_derivatives,
    known_derivatives,
    minimum,
    pulls,
    spreads,
)
from sinew.tasks.fitting.discrepancies import discrepancies_of
from sinew.tasks.fitting.discrepancy import possible_sizes
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array

ROUNDS = 2  # of parameters and sizes
EVALUATIONS = 15  # iterations of the fit in each round, at most
ITERATIONS = 4  # of the sizes, where a fit is only predicted
PARTS = (0.2, 1.0)  # of an effect's typical size, from which its fit may begin
CLOSE = 1e-4  # relative change of the loss at which a fit ends


@dataclass(frozen=True, eq=False)
class Beside:
    """A fit beside a discrepancy: minus twice the log ``evidence``, log ``sizes`` ``[blocks]`` of the discrepancy.

    The loss of ``fitted`` is the sum of squares that is white if the discrepancy is as large as that.
    """

    evidence: float
    sizes: Array
    fitted: Fitted

    def numbers(self) -> Array:
        """All of it in a row."""
        return np.concatenate([[self.evidence], self.sizes, self.fitted.numbers()])

    @staticmethod
    def possible(numbers: Array, blocks: int) -> bool:
        """Whether ``numbers`` can be those of a fit beside a discrepancy."""
        sizes, fitted = numbers[1 : 1 + blocks], numbers[1 + blocks :]
        return bool(np.isfinite(numbers[0])) and possible_sizes(sizes) and Fitted.possible(fitted)

    @classmethod
    def of(cls, numbers: Array, blocks: int) -> "Beside":
        """What ``numbers`` were made from."""
        return cls(float(numbers[0]), numbers[1 : 1 + blocks], Fitted.of(numbers[1 + blocks :]))


def fit_beside(candidate: Candidate, measured: Measured, start: Array, sizes: Array) -> Beside:
    """The fit nearest to ``start`` ``[k]`` on the unit cube, from a discrepancy of log ``sizes`` ``[blocks]``."""
    with threadpool_limits(1):  # matrices are small: threads would wait for each other
        discrepancy = discrepancies_of(measured)
        at = start
        for _ in range(ROUNDS):
            at, fitted, error, slopes = _fit(candidate, measured, at, discrepancy.whitening(sizes))
            sizes, evidence = discrepancy.sized(error, slopes, sizes)
        return Beside(evidence, sizes, fitted)


def promise_beside(
    base: Candidate, before: Beside, effect: Effect, measured: Measured, known: Array | None = None
) -> tuple[float, Array, Array]:
    """A prediction of the evidence with one more effect than ``base``, whose fit is ``before``.

    Also returns where on the unit cube ``[k + m]``, and from which log sizes, its fit is to begin. One bounded step of
    linear least squares from a part of the effect's typical size predicts the residuals; or the fit begins at a
    ``known`` fit without a discrepancy ``[k + m]``, if that promises more. Steps alone are not enough where the bare
    model has bent far to follow a missing effect. Of a user's own model, derivatives by what ``base`` has are those
    without the effect.
    """
    with threadpool_limits(1):
        discrepancy = discrepancies_of(measured)
        white = discrepancy.whitening(before.sizes)
        candidate, alone = base.having(*base.effects, effect), base.having(effect)
        null, typical = alone.null(), alone.typical()
        attempts, at = [], before.fitted.at
        own = known_derivatives(base, measured, at, measured.curves)
        for part in PARTS:
            point = np.clip(np.concatenate([at, null + part * (typical - null)]), 1e-6, 1.0 - 1e-6)
            error, slopes = further_derivatives(candidate, measured, point, measured.curves, own)
            step = _step(white(error), white(slopes), point)
            sizes, evidence = discrepancy.sized(error + slopes @ step, slopes, before.sizes, ITERATIONS)
            attempts.append((evidence, np.clip(point + step, 0.0, 1.0), sizes))
        if known is not None:
            sizes, evidence = discrepancy.sized(
                *derivatives(candidate, measured, known, measured.curves), before.sizes, ITERATIONS
            )
            attempts.append((evidence, known, sizes))
        return min(attempts, key=lambda one: one[0])


def first_sizes(candidate: Candidate, measured: Measured, at: Array) -> Array:
    """The log sizes ``[blocks]`` of the discrepancy that a fit without one left at ``at`` ``[k]``."""
    with threadpool_limits(1):
        discrepancy = discrepancies_of(measured)
        error, slopes = derivatives(candidate, measured, at, measured.curves)
        return discrepancy.sized(error, slopes, np.zeros(discrepancy.count))[0]


def blocks_of(measured: Measured) -> int:
    """How many sizes a discrepancy of the specimen has."""
    return discrepancies_of(measured).count


def far_or_white(white: Callable[[Array], Array], vectors: Array) -> Array:
    """White residuals; those of a model that fails stay far away, where a smooth discrepancy would bring them near."""
    return np.where(vectors == FAR, FAR, white(vectors))


def _step(error: Array, slopes: Array, point: Array) -> Array:
    """The step ``[k]`` within the unit cube that linear least squares would take from ``point``."""
    basis, upper = np.linalg.qr(slopes)
    step: Array = lsq_linear(upper, -(basis.T @ error), bounds=(-point - 1e-9, 1.0 - point + 1e-9), method="bvls").x
    return step


def _fit(
    candidate: Candidate, measured: Measured, start: Array, white: Callable[[Array], Array]
) -> tuple[Array, Fitted, Array, Array]:
    """Where a fit to whitened residuals ended, the fit, and the residuals and slopes there as they are."""
    candidate, begin = candidate.remembering(), np.clip(start, 1e-6, 1.0 - 1e-6)
    solution = minimum(
        candidate, measured, begin, measured.curves, white=partial(far_or_white, white), ftol=CLOSE, xtol=1e-5,
        evaluations=EVALUATIONS,
    )  # fmt: skip
    at, pull = solution.x, pulls(solution.x, solution.grad, solution.jac)
    fitted = Fitted(at, float(2.0 * solution.cost), int(solution.fun.size), spreads(solution.jac), pull)
    return at, fitted, *derivatives(candidate, measured, at, measured.curves)
