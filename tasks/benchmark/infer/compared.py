"""Posteriors beside the truth, as places in the ranges of the parameters: 0 is a lower bound, 1 an upper one."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sinew.tasks.benchmark.infer.drawn import SITES, Truth
from sinew.tasks.benchmark.infer.result import Level, Ranked
from sinew.tasks.benchmark.infer.score import nearer, rank
from sinew.tasks.infer.result import AbcResult, LikelihoodResult, draws, particles_group
from sinew.tasks.model.parameters import Parameter, bounds
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace

DRAWS = 1000  # of a posterior by ABC, whose particles have weights


@dataclass(frozen=True, eq=False)
class Compared:
    """A posterior of ``k`` parameters and the truth; ``level`` and what it is ``of``: see :class:`Ranked`.

    ``draws`` ``[m, k]``, ``truth``, reported intervals from ``low`` to ``high``, and ``determined``, all ``[k]``.
    """

    level: Level
    of: str
    names: tuple[str, ...]
    draws: Array
    truth: Array
    low: Array
    high: Array
    determined: tuple[bool, ...]

    def ranked(self, cohort: int) -> list[Ranked]:
        """Each parameter's truth among the draws."""
        held = (self.low <= self.truth) & (self.truth <= self.high)
        return [
            Ranked(cohort, self.level, self.of, name, rank(self.draws[:, j], self.truth[j]), bool(held[j]), known)
            for j, (name, known) in enumerate(zip(self.names, self.determined, strict=True))
        ]

    def nearer(self, rng: np.random.Generator) -> float:
        """TARP's share of draws, for a point anywhere in the ranges."""
        return nearer(self.draws, self.truth, rng.random(len(self.names)))


def compared(workspace: Workspace, result: LikelihoodResult | AbcResult, truth: Truth) -> Iterator[Compared]:
    """All posteriors of populations and specimens; those of ABC are of a site, and count as of its population's mean.

    Without parameters on which no curve depends.
    """
    free = {parameter.name: parameter for parameter in workspace.model.free}
    for site in SITES:
        if isinstance(result, LikelihoodResult):
            yield from _by_likelihood(workspace, result, truth, site, free)
        else:
            yield _by_abc(workspace, result, truth, site, free)


def _by_likelihood(
    workspace: Workspace, result: LikelihoodResult, truth: Truth, site: str, free: dict[str, Parameter]
) -> Iterator[Compared]:
    stored = workspace.store.read_result(particles_group(site))
    names = tuple(str(name) for name in stored["parameter"].values)
    columns = [truth.names.index(name) for name in names]
    start, end = bounds([free[name] for name in names])
    width = end - start
    population = [result.sites[site].population[name] for name in names]
    everything = (True,) * len(names)
    means, spreads = (stored[name].values.reshape(-1, len(names)) for name in ("mean", "spread"))
    ends = np.array([(one.low, one.high, one.spread_low, one.spread_high) for one in population]).T
    yield Compared(
        "mean",
        site,
        names,
        (means - start) / width,
        truth.mean[columns],
        (ends[0] - start) / width,
        (ends[1] - start) / width,
        everything,
    )
    yield Compared(
        "spread", site, names, spreads / width, truth.spread[columns], ends[2] / width, ends[3] / width, everything
    )
    for specimen in result.sites[site].specimens:
        marginals = [result.specimens[specimen][name] for name in names]
        values = stored["specimens"].sel(specimen=specimen).values.reshape(-1, len(names))
        ends = (np.array([(one.low, one.high) for one in marginals]).T - start) / width
        known = tuple(one.determined for one in marginals)
        low, high = ends
        at = truth.specimens[specimen][columns]
        yield Compared("specimen", specimen, names, (values - start) / width, at, low, high, known)


def _by_abc(workspace: Workspace, result: AbcResult, truth: Truth, site: str, free: dict[str, Parameter]) -> Compared:
    names = tuple(result.names)
    columns = [truth.names.index(name) for name in names]
    start, end = bounds([free[name] for name in names])
    particles = workspace.store.read_result(particles_group(site)).sel(parameter=list(names)).isel(generation=-1)
    values = (draws(particles, DRAWS, (0,)) - start) / (end - start)
    hdi = np.array([result.sites[site].parameters[name].hdi for name in names]).T
    low, high = (hdi - start) / (end - start)
    return Compared("mean", site, names, values, truth.mean[columns], low, high, (True,) * len(names))
