"""What the chains of a site say, in the parameters' own units, and whether they have converged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from sinew.tasks.infer.library import arviz
from sinew.tasks.infer.likelihood.chains import Block
from sinew.tasks.infer.likelihood.correction import Draws
from sinew.tasks.infer.likelihood.explore import Explored
from sinew.tasks.infer.likelihood.population import from_prior, moments, specimens_of
from sinew.tasks.infer.likelihood.result import INTERVAL, PopulationMarginal, SpecimenMarginal
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.model import Specimen
from sinew.tasks.model.parameters import Parameter, bounds
from sinew.tasks.simulate import Array

MOST_DRAWS = 4096  # of all chains, that are stored
NEAR = 0.05  # of an interval's length, within which an end is put on a bound
WARM_UP = 0.2  # of the sweeps, at the beginning, that are not used
ALONG_CHAINS = ("scores", "squares", "mean", "spread", "new")  # of blocks and of draws


@dataclass(frozen=True, eq=False)
class Chains:
    """All sweeps of a site in the parameters' units, but for the warm-up: ``h`` chains of ``s`` sweeps.

    ``specimens`` ``[h, s, n, k]`` and their ``log_likelihood`` ``[h, s, n]``, up to a constant; ``mean``, ``spread``
    and ``new`` ``[h, s, k]``; ``correlation`` ``[m, k, k]`` as scores.
    """

    specimens: Array
    log_likelihood: Array
    mean: Array
    spread: Array
    new: Array
    correlation: Array


def chains_of(ensembles: Sequence[Sequence[Block]], varied: Sequence[Parameter], *, heavy: bool) -> Chains:
    """The chains of all ensembles, each a sequence of blocks."""

    def joined(name: str) -> Array:
        """``[h, s, ...]``."""
        every = [np.concatenate([getattr(block, name) for block in blocks]) for blocks in ensembles]
        later = np.concatenate([one[warm_up(len(one)) :] for one in every], axis=1)
        return later.swapaxes(0, 1)

    correlation = np.concatenate([block.correlation for blocks in ensembles for block in blocks[len(blocks) // 2 :]])
    return _in_units({name: joined(name) for name in ALONG_CHAINS}, correlation, varied, heavy=heavy)


def chains_of_draws(draws: Draws, varied: Sequence[Parameter], *, heavy: bool) -> Chains:
    """Draws of equal weight, as one chain."""
    arrays = {name: getattr(draws, name)[np.newaxis] for name in ALONG_CHAINS}
    return _in_units(arrays, draws.correlation, varied, heavy=heavy)


def warm_up(sweeps: int) -> int:
    """How many of so many sweeps are not used."""
    return int(WARM_UP * sweeps)


def _in_units(arrays: Mapping[str, Array], correlation: Array, varied: Sequence[Parameter], *, heavy: bool) -> Chains:
    """Chains of scores ``[h, s, ...]`` by name, in the parameters' units."""
    low, high = bounds(varied)
    width = high - low
    mean, spread = moments(arrays["mean"], arrays["spread"], heavy=heavy)
    return Chains(
        specimens=low + width * places(arrays["scores"]),
        log_likelihood=-0.5 * arrays["squares"],
        mean=low + width * mean,
        spread=width * spread,
        new=low + width * places(arrays["new"]),
        correlation=correlation,
    )


@dataclass(frozen=True, eq=False)
class Convergence:
    """Effective sample sizes and R-hat: of the population ``[2, k]`` (mean, spread) and of specimens ``[n, k]``."""

    ess: Array
    rhat: Array
    specimens_ess: Array
    specimens_rhat: Array

    def of_draws(self, count: int, efficiency: float) -> "Convergence":
        """The same chains, of which so many draws were taken and weighted."""
        ess, specimens = (efficiency * np.minimum(each, count) for each in (self.ess, self.specimens_ess))
        return replace(self, ess=ess, specimens_ess=specimens)

    @property
    def smallest_ess(self) -> float:
        every = np.append(self.ess, self.specimens_ess)
        return 0.0 if np.isnan(every).any() else float(every.min())

    @property
    def largest_rhat(self) -> float:
        """Infinite where one is no number, as of chains that do not move."""
        every = np.append(self.rhat, self.specimens_rhat)
        return np.inf if np.isnan(every).any() else float(every.max())


def convergence(chains: Chains) -> Convergence:
    """Bulk effective sample sizes and rank-normalised split R-hat (Vehtari et al. 2021), by ArviZ."""
    population = np.stack([chains.mean, chains.spread], axis=2)
    every = {"population": population, "specimens": chains.specimens}
    with np.errstate(divide="ignore", invalid="ignore"):  # of chains that do not move
        ess, rhat = arviz().ess(every), arviz().rhat(every)
    return Convergence(*(found[name].values for name in every for found in (ess, rhat)))


def interval(draws: Array, low: float, high: float) -> tuple[float, float]:
    """The shortest interval that holds 95 % of draws ``[m]`` from between two bounds.

    An end closer to a bound than ``NEAR`` of the interval's length is put on the bound, where fits of real specimens
    often lie.
    """
    ordered = np.sort(draws)
    inside = int(np.ceil(INTERVAL * ordered.size))
    widths = ordered[inside - 1 :] - ordered[: ordered.size - inside + 1]
    first = int(np.argmin(widths))
    ends = float(ordered[first]), float(ordered[first + inside - 1])
    near = NEAR * (ends[1] - ends[0])
    return (low if ends[0] - low <= near else ends[0]), (high if high - ends[1] <= near else ends[1])


def marginal(means: Array, spreads: Array, ess: float, rhat: float) -> PopulationMarginal:
    """Posterior means and equal-tailed intervals of draws, of any shape, of a population's mean and spread."""
    tail = 50 * (1 - INTERVAL)
    low, high = np.percentile(means, [tail, 100 - tail])
    spread_low, spread_high = np.percentile(spreads, [tail, 100 - tail])
    return PopulationMarginal(
        mean=float(means.ravel().mean()),
        low=float(low),
        high=float(high),
        spread=float(spreads.ravel().mean()),
        spread_low=float(spread_low),
        spread_high=float(spread_high),
        ess=ess,
        rhat=rhat,
    )


def specimen_marginals(
    chains: Chains, number: int, explored: Explored, varied: Sequence[Parameter]
) -> dict[str, SpecimenMarginal]:
    """The posterior of specimen ``number`` of a site."""
    found = {}
    for j, parameter in enumerate(varied):
        draws = chains.specimens[:, :, number, j].ravel()
        ends = interval(draws, parameter.minimum, parameter.maximum)
        determined = bool(explored.determined[j])
        found[parameter.name] = SpecimenMarginal(float(draws.mean()), float(draws.std()), *ends, determined)
    return found


def prior_population(
    parameters: Sequence[Parameter], rng: np.random.Generator, *, heavy: bool
) -> tuple[dict[str, PopulationMarginal], dict[str, SpecimenMarginal]]:
    """What the prior says of a population and of its specimens."""
    populations, specimens = {}, {}
    for parameter in parameters:
        width = parameter.maximum - parameter.minimum
        drawn = from_prior(rng, MOST_DRAWS, 1, 1, heavy=heavy)
        centre, apart = moments(drawn.mean[:, 0], 1.0 / np.sqrt(drawn.precision[:, 0, 0]), heavy=heavy)
        mean, spread = parameter.minimum + width * centre, width * apart
        new = parameter.minimum + width * places(specimens_of(rng, drawn, heavy=heavy)[:, 0])
        populations[parameter.name] = marginal(mean, spread, float(MOST_DRAWS), 1.0)
        ends = interval(new, parameter.minimum, parameter.maximum)
        specimens[parameter.name] = SpecimenMarginal(float(new.mean()), float(new.std()), *ends, determined=False)
    return populations, specimens


def dataset(chains: Chains, specimens: Sequence[Specimen], varied: Sequence[Parameter]) -> xr.Dataset:
    """The draws that are stored, evenly thinned."""
    step = max(1, -(-chains.mean.shape[0] * chains.mean.shape[1] // MOST_DRAWS))
    names = [parameter.name for parameter in varied]
    along = ("chain", "draw", "parameter")
    return xr.Dataset(
        {
            "specimens": (("chain", "draw", "specimen", "parameter"), chains.specimens[:, ::step]),
            "log_likelihood": (("chain", "draw", "specimen"), chains.log_likelihood[:, ::step]),
            "mean": (along, chains.mean[:, ::step]),
            "spread": (along, chains.spread[:, ::step]),
            "new": (along, chains.new[:, ::step]),
            "correlation": (("sample", "parameter", "other_parameter"), chains.correlation),
            "low": ("parameter", bounds(varied)[0]),
            "width": ("parameter", np.subtract(*bounds(varied)[::-1])),
        },
        coords={"parameter": names, "other_parameter": names, "specimen": [one.name for one in specimens]},
    )
