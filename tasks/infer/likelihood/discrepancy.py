"""An error of the model itself, beside the noise: how large it is in a specimen's curves, and errors without it.

Where the model is wrong, more data make a posterior ever surer of wrong parameters. So what is left may hold, beside
noise, an error of the model with a prior of its own (Kennedy and O'Hagan 2001). Its smooth part is a sum of splines
over the phases of a test (:mod:`sinew.tasks.fitting.discrepancy`) whose coefficients are random walks, so that most of
it is slow. Its rough part is a process along each curve (:mod:`sinew.tasks.fitting.roughness`). Each part's size is
that of the largest evidence beside the parameters that fit best with it, found in turn; logarithms of sizes have a flat
prior. Then both parts are integrated out: whitened errors are made white once more.

An error that other parameters imitate leaves nothing behind by which it could be seen, and no such term helps against
it (Brynjarsdottir and O'Hagan 2014, Inverse Problems 30, 114007).
"""

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
from sinew.tasks.simulate import Array

ROUNDS = 3  # of parameters and sizes
EVALUATIONS = 40  # of the rough part, in each
FIRST = (-0.7, 1.5)  # logarithm of its size, and log-odds of its memory, where the search begins
SIMPLEX = ((0.0, 0.0), (-1.5, 0.0), (0.0, 1.5))  # around it: with a smaller size, and with a longer memory
FARTHEST = 7.0  # log-odds of the memory, at most
WALK = np.linalg.cholesky(1.0 + np.minimum.outer(*[np.arange(1.0, COEFFICIENTS + 1.0)] * 2))  # of coefficients
NEGLIGIBLE = 1e-3  # part of a direction that is not worth taking out


@dataclass(frozen=True, eq=False)
class ModelError:
    """The error of a model in ``g`` whitened errors of one specimen.

    ``rough``: its rough part. What is left of errors without it has a smooth part along orthonormal ``directions``
    ``[g, d]``, of which a share ``taken`` ``[d]`` is taken out. ``size``: root mean square of both as they are
    expected, and ``misfit``: of what the best fit without any such error leaves, both in units of the noise. ``near``:
    scores ``[k]`` of the best fit beside it.
    """

    rough: Roughness
    directions: Array
    taken: Array
    size: float
    misfit: float
    near: Array

    def white(self, errors: Array) -> Array:
        """White errors ``[n, g]`` of errors ``[n, g]`` that hold noise and this error."""
        found = self.rough.white(errors)
        if self.taken.size:
            found -= ((found @ self.directions) * self.taken) @ self.directions.T
        return found


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
        smooth, lengths = discrepancy_of(target.measured, WALK), lengths_of(target.measured)
        sizes, rough = np.zeros(len(smooth.blocks)), np.array(FIRST)
        for number in range(ROUNDS):
            if number > 0:
                best = best_fit(beside, rng, [best.at], effort)
            found = target.slopes(places(best.at))
            sizes, rough = compute(_sized, smooth, lengths, *found, sizes, rough)
            error = _model_error(smooth, sizes, _roughness(rough, lengths), misfit, best.at)
            beside = replace(target, whitening=error.white)
        return error


def lengths_of(measured: Measured) -> tuple[int, ...]:
    """How many whitened errors each curve has."""
    return tuple(one.target.size for one in measured.thinned.values())


def _roughness(at: Array, lengths: tuple[int, ...]) -> Roughness:
    """The rough part by the logarithm of its size and the log-odds of its memory."""
    size = np.exp(np.clip(at[0], SMALLEST, LARGEST))
    return Roughness(float(size), float(expit(np.clip(at[1], -FARTHEST, FARTHEST))), lengths)


def _through(smooth: Discrepancy, rough: Roughness) -> Discrepancy:
    """The smooth part as it is in errors without the rough part."""
    return Discrepancy.of([rough.white(block.T).T for block in smooth.blocks])


def _sized(
    smooth: Discrepancy, lengths: tuple[int, ...], error: Array, slopes: Array, sizes: Array, begin: Array
) -> tuple[Array, Array]:
    """The sizes of the largest evidence of errors ``[g]`` with slopes ``[g, k]``: of the smooth and the rough part."""
    best = (np.inf, sizes, begin)

    def evidence(at: Array) -> float:
        nonlocal best
        rough = _roughness(at, lengths)
        white = rough.white(np.column_stack([error, slopes]).T).T
        sizes, found = _through(smooth, rough).sized(white[:, 0], white[:, 1:], best[1])
        found += rough.log_determinant
        if found < best[0]:
            best = (found, sizes, at)
        return found

    simplex = begin + np.array(SIMPLEX)
    minimize(evidence, begin, method="Nelder-Mead", options={"maxfev": EVALUATIONS, "initial_simplex": simplex})
    return best[1], best[2]


def _model_error(smooth: Discrepancy, sizes: Array, rough: Roughness, misfit: float, near: Array) -> ModelError:
    directions, taken = _through(smooth, rough).directions(sizes)
    worth = taken > NEGLIGIBLE
    size = float(np.sqrt(rough.size**2 + np.exp(2.0 * sizes).sum()))  # each block has unit mean square
    return ModelError(rough, np.ascontiguousarray(directions[:, worth]), taken[worth], size, misfit, near)
