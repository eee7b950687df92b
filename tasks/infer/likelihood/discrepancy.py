"""An error of the model itself, beside the noise: how large it is in a specimen's curves, and errors without it.

Where the model is wrong, more data make a posterior ever surer of wrong parameters. So what is left may hold, beside
noise, an error of the model with a prior of its own (Kennedy and O'Hagan 2001). Its smooth part is a sum of splines
over the phases of a test (:mod:`sinew.tasks.fitting.discrepancy`) whose coefficients are random walks, so that most of
it is slow. Its rough part is a process along each curve (:mod:`sinew.tasks.fitting.roughness`). Each part's size is
that of the largest evidence beside the parameters that fit best with it, found in turn; logarithms of sizes have a flat
prior. Then both parts are integrated out: whitened errors are made white once more. Where more than the force is
compared, each quantity has such an error of its own.

An error that other parameters imitate leaves nothing behind by which it could be seen, and no such term helps against
it (Brynjarsdottir and O'Hagan 2014, Inverse Problems 30, 114007).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from threadpoolctl import threadpool_limits

from sinew.tasks.fitting.discrepancy import LARGEST, SMALLEST, Discrepancy, discrepancy_of
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.fitting.roughness import Roughness
from sinew.tasks.fitting.splines import COEFFICIENTS
from sinew.tasks.infer.likelihood.best import best_fit
from sinew.tasks.infer.likelihood.compute import Compute, directly
from sinew.tasks.infer.likelihood.effort import FULL, Effort
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.model import FORCE
from sinew.tasks.simulate import Array

ROUNDS = 3  # of parameters and sizes
EVALUATIONS = 40  # of the rough part, in each
FIRST = (-0.7, 1.5)  # logarithm of its size, and log-odds of its memory, where the search begins
SIMPLEX = ((0.0, 0.0), (-1.5, 0.0), (0.0, 1.5))  # around it: with a smaller size, and with a longer memory
FARTHEST = 7.0  # log-odds of the memory, at most
WALK = np.linalg.cholesky(1.0 + np.minimum.outer(*[np.arange(1.0, COEFFICIENTS + 1.0)] * 2))  # of coefficients
NEGLIGIBLE = 1e-3  # part of a direction that is not worth taking out


@dataclass(frozen=True, eq=False)
class QuantityError:
    """The error of a model in ``g`` whitened errors of one quantity of a specimen.

    ``rough``: its rough part. What is left of errors without it has a smooth part along orthonormal ``directions``
    ``[g, d]``, of which a share ``taken`` ``[d]`` is taken out.
    """

    rough: Roughness
    directions: Array
    taken: Array

    def white(self, errors: Array) -> Array:
        """White errors ``[n, g]`` of errors ``[n, g]`` that hold noise and this error."""
        found = self.rough.white(errors)
        if self.taken.size:
            found -= ((found @ self.directions) * self.taken) @ self.directions.T
        return found


@dataclass(frozen=True, eq=False)
class ModelError:
    """The error of a model in one specimen: of ``each`` quantity, with its ``places`` among all errors.

    ``size``: root mean square as it is expected, and ``misfit``: of what the best fit without any such error leaves,
    both in units of the noise. ``near``: scores ``[k]`` of the best fit beside it.
    """

    each: tuple[QuantityError, ...]
    places: tuple[Array, ...]
    size: float
    misfit: float
    near: Array

    def white(self, errors: Array) -> Array:
        """White errors ``[n, g]`` of errors ``[n, g]`` that hold noise and this error."""
        if len(self.each) == 1:
            return self.each[0].white(errors)
        found = np.empty_like(errors)
        for own, one in zip(self.places, self.each, strict=True):
            found[:, own] = one.white(errors[:, own])
        return found


@dataclass(frozen=True, eq=False)
class _Sizes:
    """How large the error of one quantity is.

    ``smooth``: its smooth part, whose log sizes are ``sizes``; ``rough``: the logarithm of the size of the rough part,
    and the log-odds of its memory, along curves of ``lengths`` errors.
    """

    smooth: Discrepancy
    lengths: tuple[int, ...]
    sizes: Array
    rough: Array

    @property
    def roughness(self) -> Roughness:
        size = np.exp(np.clip(self.rough[0], SMALLEST, LARGEST))
        return Roughness(float(size), float(expit(np.clip(self.rough[1], -FARTHEST, FARTHEST))), self.lengths)

    def precision(self, slopes: Array) -> Array:
        """The precision ``[k, k]`` that the quantity gives parameters, by slopes ``[g, k]``."""
        rough = self.roughness
        white = rough.white(slopes.T).T
        return _through(self.smooth, rough).terms(self.sizes, white[:, 0], white)[1]

    def error(self) -> QuantityError:
        rough = self.roughness
        directions, taken = _through(self.smooth, rough).directions(self.sizes)
        worth = taken > NEGLIGIBLE
        return QuantityError(rough, np.ascontiguousarray(directions[:, worth]), taken[worth])

    @property
    def variance(self) -> float:
        """The mean square of the error as it is expected; each block has unit mean square."""
        return float(self.roughness.size**2 + np.exp(2.0 * self.sizes).sum())


def model_error(
    target: Target, seed: tuple[int, ...], effort: Effort = FULL, compute: Compute = directly
) -> ModelError:
    """The model's error in a specimen; ``compute`` runs the slow parts other than the model.

    Raises :class:`BadInput` when the model fails wherever a fit begins.
    """
    with threadpool_limits(1):  # sums in one order, on whatever machine
        rng = np.random.default_rng(seed)
        beside, best = target, best_fit(target, rng, effort=effort)
        misfit = float(np.sqrt(best.squares / target.points))
        where = target.parts
        known = [_at_first(target.measured, quantity) for quantity in target.measured.quantities]
        for number in range(ROUNDS):
            if number > 0:
                best = best_fit(beside, rng, [best.at], effort)
            error, slopes = target.slopes(places(best.at))
            known = compute(_sized_each, known, [(error[own], slopes[own]) for own in where])
            found = _model_error(known, where, misfit, best.at)
            beside = replace(target, whitening=found.white)
        return found


def lengths_of(measured: Measured, quantity: str = FORCE) -> tuple[int, ...]:
    """How many whitened errors of a quantity each curve has."""
    return tuple(one.quantities[quantity].target.size for one in measured.thinned.values())


def _at_first(measured: Measured, quantity: str) -> _Sizes:
    smooth = discrepancy_of(measured, WALK, quantity)
    return _Sizes(smooth, lengths_of(measured, quantity), np.zeros(len(smooth.blocks)), np.array(FIRST))


def _through(smooth: Discrepancy, rough: Roughness) -> Discrepancy:
    """The smooth part as it is in errors without the rough part."""
    return Discrepancy.of([rough.white(block.T).T for block in smooth.blocks])


def _sized_each(known: Sequence[_Sizes], found: Sequence[tuple[Array, Array]]) -> list[_Sizes]:
    """The sizes of the largest evidence, of each quantity in turn; ``found``: its errors ``[g]`` and slopes ``[g, k]``.

    Quantities depend on each other through the parameters alone, which each helps to determine.
    """
    with threadpool_limits(1):
        if len(known) == 1:
            return [_sized(known[0], *found[0])]
        sized, precisions = list(known), [one.precision(slopes) for one, (_, slopes) in zip(known, found, strict=True)]
        for number, (error, slopes) in enumerate(found):
            others = np.sum(precisions, axis=0) - precisions[number]
            sized[number] = _sized(known[number], error, slopes, others)
            precisions[number] = sized[number].precision(slopes)
        return sized


def _sized(known: _Sizes, error: Array, slopes: Array, others: Array | float = 0.0) -> _Sizes:
    """The sizes of the largest evidence of errors ``[g]`` with slopes ``[g, k]``.

    ``others`` ``[k, k]``: the precision that other quantities give the parameters.
    """
    best = (np.inf, known)

    def evidence(at: Array) -> float:
        nonlocal best
        tried = replace(best[1], rough=at)
        rough = tried.roughness
        white = rough.white(np.column_stack([error, slopes]).T).T
        smooth = _through(known.smooth, rough)
        sizes, found = smooth.sized(white[:, 0], white[:, 1:], best[1].sizes, others=others)
        found += rough.log_determinant
        if found < best[0]:
            best = (found, replace(tried, sizes=sizes))
        return found

    simplex = known.rough + np.array(SIMPLEX)
    minimize(evidence, known.rough, method="Nelder-Mead", options={"maxfev": EVALUATIONS, "initial_simplex": simplex})
    return best[1]


def _model_error(known: Sequence[_Sizes], where: tuple[Array, ...], misfit: float, near: Array) -> ModelError:
    points = sum(own.size for own in where)
    variances = [one.variance * (own.size / points) for one, own in zip(known, where, strict=True)]
    size = float(np.sqrt(sum(variances)))
    return ModelError(tuple(one.error() for one in known), where, size, misfit, near)
