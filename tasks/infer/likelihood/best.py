"""The parameters of one specimen that agree best with its curves and the prior."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sinew.runner.errors import BadInput
from sinew.tasks.fitting.few_runs import least_squares_of_few
from sinew.tasks.fitting.starts import starts
from sinew.tasks.infer.likelihood.compiled import FARTHEST
from sinew.tasks.infer.likelihood.effort import FULL, Effort
from sinew.tasks.infer.likelihood.scores import density, places, scores_of
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.simulate import Array

TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Best:
    """``at`` ``[k]`` as scores, ``loss`` (with the prior's part), ``squares``, and ``covariance``."""

    at: Array
    loss: float
    squares: float
    covariance: Array


def loss(squares: Array, scores: Array) -> Array:
    """Minus twice the log posterior ``[n]`` of a specimen alone, up to a constant."""
    return np.asarray(squares + np.square(scores).sum(axis=1))


def best_fit(target: Target, rng: np.random.Generator, begin: Sequence[Array] = (), effort: Effort = FULL) -> Best:
    """The best of fits from several starts, and from scores ``begin``, each ``[k]``."""
    count = effort.again if begin else effort.starts
    scores = [*begin, *_starts(target, rng, count, effort.candidates)]
    whole = [one for one in (_fit(target, each, effort) for each in scores) if one is not None]
    if not whole:
        raise BadInput(f"infer: {target.measured.specimen.name}", "the model fails at every start", "other ranges")
    return min(whole, key=lambda one: one.loss)


def _starts(target: Target, rng: np.random.Generator, count: int, candidates: int) -> list[Array]:
    """The best ``count`` of so many ``candidates``, as scores ``[k]``."""
    names = [parameter.name for parameter in target.varied]
    scores = [scores_of(np.clip(start, 0.01, 0.99)) for start in starts(names, rng, candidates)]
    if count in (0, candidates):
        return scores[:count]
    every = np.array(scores)
    order = np.argsort(loss(target.squares(places(every)), every), kind="stable")
    return [scores[number] for number in order[:count]]


def _fit(target: Target, start: Array, effort: Effort) -> Best | None:
    """The nearest maximum of likelihood and prior to ``start`` ``[k]`` (scores); None where the model fails there."""
    prior = np.eye(start.size)
    last: dict[bytes, tuple[Array, Array]] = {}

    def both(scores: Array) -> tuple[Array, Array]:
        if scores.tobytes() not in last:
            at = places(scores)
            errors, slopes = target.slopes(at)
            last.clear()
            last[scores.tobytes()] = (
                np.concatenate([errors, scores]),
                np.concatenate([slopes * density(scores), prior]),
            )
        return last[scores.tobytes()]

    def alone(scores: Array) -> Array:
        return np.concatenate([target.errors(places(scores)[np.newaxis])[0], scores])

    if not np.isfinite(target.squares(places(start)[np.newaxis])).all():
        return None
    bounds = (-FARTHEST, FARTHEST)
    try:
        if effort.few:
            found = least_squares_of_few(alone, both, start, bounds, effort.steps)
        else:
            found = least_squares(
                lambda scores: both(scores)[0], start, jac=lambda scores: both(scores)[1], ftol=TOLERANCE,
                xtol=TOLERANCE, gtol=TOLERANCE, max_nfev=effort.steps, bounds=bounds,
            )  # fmt: skip
    except ValueError:  # the model fails on the way
        return None
    slopes = found.jac
    squares = float(2.0 * found.cost - np.square(found.x).sum())
    return Best(found.x, float(2.0 * found.cost), squares, np.linalg.inv(slopes.T @ slopes))
