"""Where one specimen's posterior is: the best fit, an emulator around it, and what its own data say of each parameter.

All from the specimen alone, with the prior of a population's mean as its prior. Rounds of sampling and computing make
the emulator good where the posterior is: chains walk on the emulator, the model computes where they ended, and the
emulator is fitted again.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2
from threadpoolctl import threadpool_limits

from sinew.runner.errors import BadInput
from sinew.tasks.infer.likelihood.best import best_fit, loss
from sinew.tasks.infer.likelihood.chart import Chart, chart_of
from sinew.tasks.infer.likelihood.compiled import FARTHEST
from sinew.tasks.infer.likelihood.compute import Compute, directly
from sinew.tasks.infer.likelihood.effort import FULL, Effort, points_of_a_round
from sinew.tasks.infer.likelihood.emulator import emulator
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.infer.likelihood.target import Target
from sinew.tasks.infer.likelihood.walk import Prior, walk
from sinew.tasks.simulate import Array

FEWEST_COMPUTED = 20  # of them, below which there is nothing to begin with
PATHS, LENGTH = 6, 0.3  # on the emulator, and longest steps, in standard deviations
LENGTHS = (0.15, 0.25, 0.4, 0.6)  # that are tried for chains
WALKERS = 256  # chains that walk on it
KEPT_RATIO = 2  # rounds' worth of points that an emulator is fitted to, the likeliest ones
WIDE, WIDE_DF = 1.3, 5.0  # of the first round: spread, and degrees of freedom of a t distribution
BETWEEN = 0.3  # spread of the points of the next round around the ends of chains, in coordinates
LIKELY = 1.0 - 1e-5  # of a chi-squared distribution: beyond, a point is no draw of the posterior
DETERMINED = 0.5  # of a uniform's standard deviation


@dataclass(frozen=True, eq=False)
class Explored:
    """What is known of a specimen before its population.

    ``chart``: coordinates of the posterior, with the emulator; ``length`` of steps that leads farthest on it; draws
    ``begin`` ``[n, k]`` of it, as scores; ``determined`` ``[k]``: whether the specimen's own data say where a parameter
    is in its range; ``error``: standard deviation of the emulator's log likelihoods; ``least``: smallest sum of squares
    that was found; ``left`` ``[quantities]``: root mean square of the errors of each quantity at the likeliest of the
    points ``seen`` ``[m, k]``, the scores with which the emulator was trained.
    """

    chart: Chart
    length: float
    begin: Array
    determined: Array
    error: float
    least: float
    left: Array
    seen: Array


@dataclass(frozen=True, eq=False)
class Led:
    """Where chains on a new emulator, with its ``chart``, came to: ``ends`` ``[w, k]``; and the next ``points``."""

    chart: Chart
    ends: Array
    points: Array


def explored(
    target: Target,
    seed: tuple[int, ...],
    effort: Effort = FULL,
    compute: Compute = directly,
    known: Array | None = None,
) -> Explored:
    """Explore a specimen; ``compute`` runs the slow parts other than the model.

    With scores ``known`` ``[m, k]`` at which the model was computed before, one emulator is trained with them, without
    a fit. Raises :class:`BadInput` when the model fails wherever a fit begins, or around the best.
    """
    with threadpool_limits(1):  # sums in one order, on whatever machine
        rng = np.random.default_rng(seed)
        size, count = target.size, points_of_a_round(target.size, effort)
        rounds, points, least, most = 1, known, np.inf, None
        if points is None:
            begin = [target.near] if target.near is not None and effort.few else []
            best = best_fit(target, rng, begin, effort)
            points = best.at + WIDE * _heavy_tailed(rng, count, size) @ np.linalg.cholesky(best.covariance).T
            rounds, least, most = effort.rounds, best.squares, KEPT_RATIO * count
        seen, errors = np.empty((0, size)), np.empty((0, target.points))
        for _ in range(rounds):
            points = np.clip(points, -FARTHEST, FARTHEST)
            new = target.errors(places(points))
            whole = np.isfinite(new).all(axis=1)
            if len(seen) + whole.sum() < FEWEST_COMPUTED:
                name = target.measured.specimen.name
                raise BadInput(
                    f"infer: {name}", "nearly all runs of the model around its best fit fail", "other ranges"
                )
            seen, errors = np.concatenate([seen, points[whole]]), np.concatenate([errors, new[whole]])
            losses = loss(np.square(errors).sum(axis=1), seen)
            kept = np.argsort(losses, kind="stable")[:most]
            seen, errors = seen[kept], errors[kept]
            rng, led = compute(_led, rng, seen, errors, losses[kept], count)
            points = led.points
        left = [float(np.sqrt(np.mean(errors[0, own] ** 2))) for own in target.parts]
        return replace(_judged(target, rng, led, seen, least, effort, compute), left=np.array(left))


def _led(
    rng: np.random.Generator, seen: Array, errors: Array, losses: Array, count: int
) -> tuple[np.random.Generator, Led]:
    """Train an emulator with ``errors`` ``[m, g]`` at scores ``seen`` ``[m, k]``, the likeliest first, and walk on it.

    Returns the generator of random numbers as it is then, and ``count`` points for the next round.
    """
    with threadpool_limits(1):
        size = seen.shape[1]
        known = emulator(places(seen), errors, (1.0 + (losses - losses.min()) / (2 * size)) ** -2.0)
        begin = seen[rng.choice(_likely(losses, size), WALKERS)]
        chart = chart_of(known, seen[0])
        ends = walk(rng, chart, _own_prior(WALKERS, size), begin, PATHS, LENGTH)
        ends = ends[_likely(loss(known.squares(places(ends)), ends), size)]
        begin = ends[rng.choice(len(ends), count)]
        return rng, Led(chart, ends, chart.displaced(begin, BETWEEN * rng.standard_normal((count, size)))[0])


def _judged(
    target: Target,
    rng: np.random.Generator,
    led: Led,
    seen: Array,
    least: float,
    effort: Effort,
    compute: Compute,
) -> Explored:
    """What is known of a specimen once the model was computed where chains ended; ``least`` sum of squares so far."""
    size = target.size
    checked = led.ends[: effort.checked]
    squares = target.squares(places(checked))
    likely = _likely(loss(squares, checked), size)
    apart = squares[likely] - led.chart.known.squares(places(checked[likely]))
    ends = np.concatenate([checked[likely], led.ends[effort.checked :]])
    chart, length = compute(_fitted, rng, led.chart, ends)
    return Explored(
        chart=chart,
        length=length,
        begin=ends,
        determined=places(ends).std(axis=0) < DETERMINED / np.sqrt(12.0),
        error=float(np.std(apart)) / 2,
        least=float(min(squares.min(), least)),
        left=np.empty(0),
        seen=np.concatenate([seen, checked[np.isfinite(squares)]]),
    )


def _fitted(rng: np.random.Generator, chart: Chart, ends: Array) -> tuple[Chart, float]:
    """The chart with the precision of draws ``[n, k]``, and the length of steps that leads farthest on it."""
    with threadpool_limits(1):
        chart = chart.fitted(ends)
        return chart, _best_length(rng, chart, ends)


def _best_length(rng: np.random.Generator, chart: Chart, begin: Array) -> float:
    """The length of steps by which walks from draws ``[n, k]`` lead farthest."""
    prior = _own_prior(len(begin), begin.shape[1])
    before = chart.coordinates(begin)
    far = [
        np.square(chart.coordinates(walk(rng, chart, prior, begin, 1, length)) - before).mean() for length in LENGTHS
    ]
    return LENGTHS[int(np.argmax(far))]


def _own_prior(chains: int, size: int) -> Prior:
    """The prior of a specimen without a population."""
    return Prior(np.zeros((chains, size)), np.broadcast_to(np.eye(size), (chains, size, size)))


def _heavy_tailed(rng: np.random.Generator, count: int, size: int) -> Array:
    """Draws ``[n, k]`` of Student's t distribution."""
    heavy = np.sqrt(WIDE_DF / rng.chisquare(WIDE_DF, size=(count, 1)))
    return np.asarray(heavy * rng.standard_normal((count, size)))


def _likely(loss: Array, size: int) -> Array:
    """The places in ``loss`` ``[n]`` of points that may well be draws of a posterior of ``size`` parameters."""
    return np.flatnonzero(loss < loss.min() + chi2.ppf(LIKELY, size))
