"""Draws of chains that ran on emulators alone, weighted so that they stand for the model's own posterior.

Where a run of the model takes time, chains walk on the emulators of all specimens without asking it. Some of their
draws are then computed by the model, and each weighs as much as its likelihood is larger than the emulators' (Vihola,
Helske and Franks 2020, Scand. J. Stat. 47, 1339). What comes out is exact in the limit of many draws, whatever the
emulators are worth; if they are worth little, a few draws weigh as much as all others, and that is seen. The largest
weights are smoothed (Pareto smoothed importance sampling: Vehtari et al. 2024, J. Mach. Learn. Res. 25, 72).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from sinew.tasks.infer.library import arviz
from sinew.tasks.infer.likelihood.chains import CHAINS, Block
from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Draws:
    """``m`` draws of a site's population and its ``n`` specimens, all as scores.

    ``scores`` ``[m, n, k]`` and ``squares`` ``[m, n]`` (sums of squares) of specimens; ``mean``, ``spread`` and ``new``
    ``[m, k]`` of the population, as in :class:`Block`, with its ``correlation`` ``[m, k, k]``.
    """

    scores: Array
    squares: Array
    mean: Array
    spread: Array
    new: Array
    correlation: Array

    def __len__(self) -> int:
        return len(self.scores)

    def at(self, numbers: Array) -> "Draws":
        """The draws with these ``numbers``."""
        return Draws(*(getattr(self, one.name)[numbers] for one in fields(self)))


def draws_of(ensembles: Sequence[Sequence[Block]]) -> Draws:
    """A draw of each sweep of the later half, from the chain whose turn it is: neighbours are nearly independent."""
    every: dict[str, list[Array]] = {one.name: [] for one in fields(Draws)}
    for blocks in ensembles:
        sweeps = np.arange(sum(len(block.mean) for block in blocks))
        later = sweeps[len(sweeps) // 2 :]
        for name, found in every.items():
            whole = np.concatenate([getattr(block, name) for block in blocks])
            found.append(whole[later] if name == "correlation" else whole[later, later % CHAINS])
    return Draws(**{name: np.concatenate(found) for name, found in every.items()})


@dataclass(frozen=True, eq=False)
class Weighted:
    """Weights ``[m]`` of draws, with the sum 1, or all 0; ``tail``: Pareto's k of the largest, no good above 0.7."""

    weights: Array
    tail: float

    @property
    def efficiency(self) -> float:
        """How many draws of equal weight each is worth; 0 where none has a weight."""
        squares = len(self.weights) * np.square(self.weights).sum()
        return float(1.0 / max(squares, 1.0)) if squares else 0.0

    @property
    def apart(self) -> float:
        """How many standard deviations a mean may be off without weights, as far as these draws show it.

        By the inequality of Cauchy and Schwarz: the difference is the covariance with the weights.
        """
        return float(np.sqrt(1.0 / self.efficiency - 1.0)) if self.efficiency else np.inf


def weighted(exact: Array, emulated: Array) -> Weighted:
    """The weights of draws with sums of squares ``[m, n]`` of specimens, of the model and of the emulators.

    Where the model fails, ``exact`` is infinite and the weight 0.
    """
    logs = -0.5 * (exact - emulated).sum(axis=1)
    alive = np.isfinite(logs)
    weights, tail = np.zeros(len(logs)), np.inf
    if alive.any():
        spread = np.ptp(logs[alive])
        found, k = arviz().psislw(logs[alive] - logs[alive].max()) if spread > 0.0 else (np.zeros(alive.sum()), 0.0)
        weights[alive] = np.exp(found - np.max(found))
        weights /= weights.sum()
        tail = float(k)
    return Weighted(weights, tail)


def resampled(rng: np.random.Generator, weights: Array) -> Array:
    """Numbers ``[m]`` of draws that stand for those with ``weights`` ``[m]``, by systematic resampling."""
    at = (rng.random() + np.arange(len(weights))) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)
