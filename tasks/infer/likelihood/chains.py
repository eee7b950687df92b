"""Chains of a site's specimens and their population, by Gibbs' and Metropolis' methods in turn.

A sweep draws the population given its specimens (:mod:`sinew.tasks.infer.likelihood.population`), moves one weakly
determined parameter of it together with all specimens (:mod:`sinew.tasks.infer.likelihood.together`), and then each
specimen given the population: the chain walks on the specimen's emulator, which leads far away at the price of nothing,
and the model's own likelihood decides whether where it ended is accepted (the surrogate transition method: Liu 2001,
Monte Carlo strategies in scientific computing, section 9.4.3). Some proposals are plain random steps, which need no
emulator: they free chains from where the emulator is far off. Draws are those of the exact posterior in the limit,
whatever the emulator is worth. Likelihoods that are emulators themselves give draws of the emulators' posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from sinew.tasks.infer.likelihood.explore import Explored
from sinew.tasks.infer.likelihood.population import Population, drawn, from_prior, specimens_of, with_new_covariance
from sinew.tasks.infer.likelihood.scores import inside, places
from sinew.tasks.infer.likelihood.target import Squares
from sinew.tasks.infer.likelihood.together import chances, moved_together
from sinew.tasks.infer.likelihood.walk import Prior, scales, walk
from sinew.tasks.simulate import Array

CHAINS = 16  # of an ensemble: with more, R-hat of so many short chains takes longest; with fewer, calls do
PATHS = 2  # on the emulator
TOGETHER = 3  # joint moves of a sweep
PLAIN_EVERY = 4  # sweeps
PLAIN = (0.1, 1.0)  # least and largest plain step, in units of the best for a normal distribution


@dataclass(frozen=True, eq=False)
class State:
    """Where an ensemble of ``c`` chains is.

    ``scores`` ``[n, c, k]`` and ``squares`` ``[n, c]`` (sums of squares) of ``n`` specimens, the ``population``, and
    the number of the next ``sweep``.
    """

    scores: Array
    squares: Array
    population: Population
    sweep: int = 0


@dataclass(frozen=True, eq=False)
class Block:
    """``s`` sweeps of ``c`` chains of an ensemble, and the ``state`` after them. All are as scores.

    ``scores`` ``[s, c, n, k]`` and ``squares`` ``[s, c, n]`` (sums of squares) of specimens; ``mean``, ``spread`` and
    ``new`` ``[s, c, k]``: the population's mean and spread, and a new specimen of it; ``correlation`` ``[s, k, k]``:
    the population's in the chain whose turn it is; ``accepted`` ``[n]``: part of the emulator's proposals.
    """

    state: State
    scores: Array
    squares: Array
    mean: Array
    spread: Array
    new: Array
    correlation: Array
    accepted: Array


def begun(targets: Sequence[Squares], explored: Sequence[Explored], seed: tuple[int, ...], *, heavy: bool) -> State:
    """An ensemble that begins at draws of each specimen alone, and a population from its prior."""
    rng = np.random.default_rng(seed)
    scores = np.array(
        [one.begin[rng.choice(len(one.begin), CHAINS, replace=len(one.begin) < CHAINS)] for one in explored]
    )
    squares = np.array([target.squares(places(at)) for target, at in zip(targets, scores, strict=True)])
    population = from_prior(rng, CHAINS, scores.shape[2], len(targets), heavy=heavy)
    return State(scores, squares, replace(population, mean=scores.mean(axis=0)))


def swept(
    targets: Sequence[Squares],
    explored: Sequence[Explored],
    state: State,
    sweeps: int,
    seed: tuple[int, ...],
    *,
    heavy: bool,
) -> Block:
    """More sweeps of an ensemble."""
    with threadpool_limits(1):  # sums in one order, on whatever machine
        rng = np.random.default_rng((*seed, state.sweep))
        scores, squares, population = state.scores.copy(), state.squares.copy(), state.population
        kept: list[tuple[Array, ...]] = []
        accepted: list[list[float]] = []
        weak = chances(explored)
        for sweep in range(state.sweep, state.sweep + sweeps):
            population = drawn(rng, scores, population, heavy=heavy)
            for _ in range(TOGETHER if weak.any() else 0):
                number = int(rng.choice(weak.size, p=weak))
                population = moved_together(rng, targets, explored, scores, squares, population, number)
            plain = sweep % PLAIN_EVERY == PLAIN_EVERY - 1
            step = _plain_step if plain else _led_step
            moved = [
                step(rng, target, known, population.of_one(number, scores), scores[number], squares[number])
                for number, (target, known) in enumerate(zip(targets, explored, strict=True))
            ]
            accepted += [] if plain else [moved]
            population = with_new_covariance(rng, scores, population)
            covariance = population.covariance()
            spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
            turn = sweep % CHAINS
            correlation = covariance[turn] / np.outer(spread[turn], spread[turn])
            new = specimens_of(rng, population, heavy=heavy)
            kept.append((scores.swapaxes(0, 1).copy(), squares.T.copy(), population.mean, spread, new, correlation))
        arrays = [np.array(each) for each in zip(*kept, strict=True)]
        after = State(scores, squares, population, state.sweep + sweeps)
        return Block(after, *arrays, np.array(accepted).mean(axis=0))  # type: ignore[call-arg]


def _led_step(
    rng: np.random.Generator,
    target: Squares,
    known: Explored,
    prior: Prior,
    scores: Array,
    squares: Array,
) -> float:
    """Move chains ``[c, k]`` of a specimen, in place, to where they come to on the emulator; the part that moved."""
    emulator = known.chart.known
    ends = walk(rng, known.chart, prior, scores, PATHS, known.length)
    there, here = places(ends), places(scores)
    new = target.squares(there)
    # the walk is reversible for the emulator's posterior: what is left to judge is where the emulator is off
    ratio = (new - emulator.squares(there)) - (squares - emulator.squares(here))
    return _accept(rng, ratio, ends, new, scores, squares)


def _plain_step(
    rng: np.random.Generator,
    target: Squares,
    known: Explored,
    prior: Prior,
    scores: Array,
    squares: Array,
) -> float:
    """Move chains ``[c, k]`` of a specimen, in place, by a random step of coordinates; the part that moved."""
    chains, size = scores.shape
    length = 2.38 / np.sqrt(size) * np.exp(rng.uniform(np.log(PLAIN[0]), np.log(PLAIN[1]), size=(chains, 1)))
    steps = length * np.einsum("cij,cj->ci", scales(known.chart, prior), rng.standard_normal((chains, size)))
    ends, volumes = known.chart.displaced(scores, steps)
    new = target.squares(places(ends))
    new[np.isnan(volumes) | ~inside(ends)] = np.inf
    ratio = new - squares + prior.losses(ends) - prior.losses(scores) + 2.0 * np.nan_to_num(volumes)
    return _accept(rng, ratio, ends, new, scores, squares)


def _accept(rng: np.random.Generator, ratio: Array, ends: Array, new: Array, scores: Array, squares: Array) -> float:
    """Metropolis' rule, where ``ratio`` ``[c]`` is minus twice the logarithm of that of the densities."""
    moved = ratio < -2.0 * np.log(rng.random(ratio.size))
    scores[moved], squares[moved] = ends[moved], new[moved]
    return float(moved.mean())
