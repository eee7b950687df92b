"""Moves of a population together with all its specimens.

Where the curves hardly determine a parameter, its population can only move as far as its specimens let it, and they
only as far as the population: drawn in turn, they creep. So the mean or the spread of one parameter's population is
moved, and that parameter of every specimen with it; the specimens' other parameters follow as their data have it. (As
interweaving does: Yu and Meng 2011, J. Comput. Graph. Stat. 20, 531.)
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sinew.tasks.infer.likelihood.explore import Explored
from sinew.tasks.infer.likelihood.population import Population
from sinew.tasks.infer.likelihood.scores import inside, places
from sinew.tasks.infer.likelihood.target import Squares
from sinew.tasks.simulate import Array

WEAK = 0.1  # share of a specimen's own variance in that of all, from which on a parameter is moved together
SHORTEST, LONGEST = 0.5, 4.0  # of a mean, in standard deviations of what the specimens say
SCALED = 2.0  # largest standard deviation of the logarithm of how much a spread is scaled


def chances(explored: Sequence[Explored]) -> Array:
    """How often each parameter ``[k]`` is to be moved: the more, the less specimens tell it apart from one another.

    All are 0 where the curves determine every parameter far better than specimens scatter.
    """
    within = np.median([one.begin.var(axis=0) for one in explored], axis=0)
    between = np.var([one.begin.mean(axis=0) for one in explored], axis=0)
    share = within / (within + between)
    weak = np.where(share > WEAK, share, 0.0)
    return np.asarray(weak / max(weak.sum(), np.finfo(float).tiny))


def moved_together(
    rng: np.random.Generator,
    targets: Sequence[Squares],
    explored: Sequence[Explored],
    scores: Array,
    squares: Array,
    population: Population,
    number: int,
) -> Population:
    """Move parameter ``number`` of specimens ``scores`` ``[n, c, k]`` and ``squares`` ``[n, c]``, in place.

    Returns the population after.
    """
    count, chains, _ = scores.shape
    spread = np.array([one.begin[:, number].std() for one in explored])
    shifted = rng.random(chains) < 0.5
    length = np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST), size=chains))
    step = length * rng.standard_normal(chains)
    shift = np.where(shifted, step / np.sqrt(np.sum(1.0 / spread**2)), 0.0)
    factor = np.exp(np.where(shifted, 0.0, SCALED / LONGEST * step))
    mean, scales = population.mean.copy(), population.scales.copy()
    mean[:, number] += shift
    scales[:, number] /= factor**2
    after = replace(population, mean=mean, scales=scales)
    wanted = mean[:, number] + factor * (scores[:, :, number] - population.mean[:, number])
    ends, new = np.empty_like(scores), np.empty_like(squares)
    log = count * np.log(factor)
    for i, (target, known) in enumerate(zip(targets, explored, strict=True)):
        ends[i], volumes = known.chart.slid(scores[i], number, wanted[i])
        new[i] = target.squares(places(ends[i]))
        new[i][np.isnan(volumes) | ~inside(ends[i])] = np.inf
        log += np.nan_to_num(volumes) - 0.5 * (new[i] - squares[i])
    log += after.log_density(ends) - population.log_density(scores)
    moved = np.log(rng.random(chains)) < log
    scores[:, moved], squares[:, moved] = ends[:, moved], new[:, moved]
    mean[~moved], scales[~moved] = population.mean[~moved], population.scales[~moved]
    return after
