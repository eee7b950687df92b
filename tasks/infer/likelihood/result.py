"""The result of an inference by likelihood: what ``infer.json`` holds, and how its draws in the store are read."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import xarray as xr

from sinew.tasks.infer.consistent import check_interval, check_marginal, check_marginals, check_names
from sinew.tasks.simulate import Array
from sinew.tasks.study.result import OMIT, Number, Result

INTERVAL = 0.95
MISFIT = 1.2  # times the noise: beyond, what is left is no noise, and intervals are too narrow
NORMAL_95 = 3.92  # width of that interval of a normal distribution, in standard deviations


@dataclass(frozen=True)
class PopulationMarginal:
    """A parameter in a population: posterior mean and interval of the population's mean, and of its ``spread``.

    The spread is the standard deviation between specimens. ``ess`` is the smaller of the effective sample sizes of mean
    and spread, ``rhat`` the larger of their R-hat.
    """

    mean: Number
    low: Number
    high: Number
    spread: Number
    spread_low: Number
    spread_high: Number
    ess: Number
    rhat: Number

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for intervals out of order."""
        check_interval(self.low, self.high)
        check_interval(self.spread_low, self.spread_high)


@dataclass(frozen=True)
class SpecimenMarginal:
    """A parameter of one specimen: posterior mean, standard deviation and interval.

    ``determined``: whether the specimen's own curves say where in its range the parameter is.
    """

    mean: Number
    sd: Number
    low: Number
    high: Number
    determined: bool

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for an interval out of order, and for a mean far from it."""
        check_marginal(self.mean, self.sd, self.low, self.high)


@dataclass(frozen=True)
class Misfit:
    """What the best fit leaves of a specimen, as root mean squares in units of the noise.

    ``bare``: of a fit without a discrepancy, 1 where the model describes the curves. ``discrepancy``: of the model's
    error as it is expected, 0 where none is. ``left``: beside that error, 1 where both together describe the curves.
    ``quantities``: what is left of each, where more than the force is compared.
    """

    bare: Number
    discrepancy: Number
    left: Number
    quantities: Mapping[str, Number] | None = field(default=None, metadata=OMIT)

    @property
    def worst(self) -> float:
        """What is left of all quantities together, or of that of which most is left: one may hide among others."""
        return max(self.left, *(self.quantities or {}).values(), 0.0)


@dataclass(frozen=True)
class Runs:
    """Runs of a simulator that takes time, for the posterior of one specimen.

    ``rows``: those that the store holds of it, at all measured points. ``apart``: how many standard deviations
    posterior means may be off because chains ran on emulators, as far as some draws show it. ``weighted``: how many
    draws the simulator has weighted instead; 0 where none needed to be.
    """

    rows: int
    apart: Number
    weighted: int


@dataclass(frozen=True)
class SitePosterior:
    """The posterior of a site's population.

    ``smallest_ess`` and ``largest_rhat`` are over the population and all of its specimens; ``sweeps``: kept ones of
    each chain; ``emulator_sd``: largest standard deviation of an emulator's log likelihoods; ``misfit``: by specimen;
    ``runs`` by specimen, where runs of the simulator take time.
    """

    specimens: list[str]
    population: Mapping[str, PopulationMarginal]
    smallest_ess: Number
    largest_rhat: Number
    sweeps: int
    emulator_sd: Number
    misfit: Mapping[str, Misfit]
    runs: Mapping[str, Runs]

    @property
    def parameters(self) -> dict[str, "MeanOfPopulation"]:
        """The means of the population by parameter."""
        return {
            name: MeanOfPopulation(one.mean, (one.high - one.low) / NORMAL_95, (one.low, one.high))
            for name, one in self.population.items()
        }


@dataclass(frozen=True)
class MeanOfPopulation:
    """Posterior mean, standard deviation and interval of a population's mean."""

    mean: float
    sd: float
    hdi: tuple[float, float]


@dataclass(frozen=True, eq=False)
class LikelihoodResult(Result):
    """Posteriors of populations and specimens. ``names``, ``units`` and ``meanings`` are of the free parameters.

    ``blind``: parameters on which no curve depends; their posterior is their prior. ``data``: what it is of, by
    specimen (:func:`sinew.tasks.study.same_data.data_of`). ``compared``: what was compared beside the force.
    """

    TASK = "infer"
    VERSION = 6  # 5: runs of simulators that take time; 6: the covariance belongs to the specimens of its draw
    LIBRARIES = ("arviz",)

    method: Literal["likelihood"]
    names: list[str]
    units: list[str]
    meanings: list[str]
    blind: list[str]
    interval: Number
    tails: Literal["normal", "heavy"]
    discrepancy: bool
    chains: int
    sites: Mapping[str, SitePosterior]
    specimens: Mapping[str, Mapping[str, SpecimenMarginal]]
    inputs: str
    data: Mapping[str, str] | None = field(default=None, metadata=OMIT)
    compared: tuple[str, ...] | None = field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for names, units and marginals that do not belong together."""
        check_names(self.names, self.units, self.meanings)
        check_marginals(self.names, {name: one.population for name, one in self.sites.items()} | dict(self.specimens))

    @property
    def misfit(self) -> dict[str, Misfit]:
        """What the best fit leaves of each specimen."""
        return {name: one for site in self.sites.values() for name, one in site.misfit.items()}

    @property
    def misfitting(self) -> dict[str, float]:
        """Specimens of which clearly more than noise is left, also beside a discrepancy; how many times the noise."""
        return {name: one.worst for name, one in self.misfit.items() if one.worst > MISFIT}

    @property
    def discrepant(self) -> dict[str, float]:
        """Specimens of which a fit without a discrepancy leaves clearly more than noise; how many times the noise."""
        return {name: one.bare for name, one in self.misfit.items() if one.bare > MISFIT}

    @property
    def undetermined(self) -> dict[str, list[str]]:
        """Specimens by the parameters that their own curves do not determine; without those that all are blind to."""
        found: dict[str, list[str]] = {}
        for specimen, marginals in self.specimens.items():
            for name, marginal in marginals.items():
                if not marginal.determined and name not in self.blind:
                    found.setdefault(name, []).append(specimen)
        return found


def draws_of_specimen(dataset: xr.Dataset, specimen: str, count: int, seed: tuple[int, ...]) -> Array:
    """``count`` draws ``[n, k]`` of a specimen, of those that the store holds."""
    return _some(dataset["specimens"].sel(specimen=specimen), count, seed)


def draws_of_new(dataset: xr.Dataset, count: int, seed: tuple[int, ...]) -> Array:
    """``count`` draws ``[n, k]`` of a new specimen of the population, of those that the store holds."""
    return _some(dataset["new"], count, seed)


def draws_of_mean(dataset: xr.Dataset) -> Array:
    """All stored draws ``[n, k]`` of a population's mean."""
    return _all(dataset["mean"])


def _all(draws: xr.DataArray) -> Array:
    return np.asarray(draws.stack(sample=("chain", "draw")).transpose("sample", "parameter").values)


def _some(draws: xr.DataArray, count: int, seed: tuple[int, ...]) -> Array:
    every = _all(draws)
    return np.asarray(every[np.random.default_rng(seed).choice(len(every), count, replace=count > len(every))])
