"""The result of an inference: what ``infer.json`` holds, and how the particles in the store are read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import xarray as xr

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store
from sinew.tasks.infer.consistent import check_marginal, check_marginals, check_names
from sinew.tasks.study.result import OMIT, Count, NotNegative, Number, Numbers, Result, Share

Array = np.ndarray[Any, Any]
INTERVAL = 0.95  # probability of the highest density intervals
ROUNDING = 1e-6  # of a sum of weights
NEARLY = 0.9  # of the effective sample size that is asked for: it is met about, from the weights of the last generation
FEW = 10
"""Effective sample size below which the heaviest particles decide, and their scatter is not seen in the sample."""
ENOUGH = 100
"""Effective sample size from which on another seed moves means by about a tenth of their standard deviation only."""


@dataclass(frozen=True, eq=False)
class Marginal:
    """Posterior mean, standard deviation and highest density interval ``[2]`` of a parameter, and its prior."""

    mean: Number
    sd: NotNegative
    hdi: Numbers
    prior_mean: Number
    prior_sd: NotNegative
    prior: Literal["normal", "uniform"]

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for ends that are not two, or not in order, and for a mean far from them."""
        if self.hdi.shape != (2,) or self.hdi[0] > self.hdi[1]:
            raise ValueError("hdi: expected two numbers, the lower one first")
        check_marginal(self.mean, self.sd, *self.hdi)

    @property
    def within(self) -> tuple[float, float]:
        """The ends of the prior; infinite where it is normal."""
        half = float(np.sqrt(3.0)) * self.prior_sd if self.prior == "uniform" else np.inf
        return self.prior_mean - half, self.prior_mean + half

    def prior_density(self, values: Array) -> Array:
        """The density of the prior, of any shape, at ``values``; where it is normal, before truncation."""
        apart = (values - self.prior_mean) / self.prior_sd
        if self.prior == "uniform":
            return np.where(np.abs(apart) <= np.sqrt(3.0), 1.0 / (np.sqrt(12.0) * self.prior_sd), 0.0)
        return np.asarray(np.exp(-0.5 * apart**2) / (self.prior_sd * np.sqrt(2 * np.pi)))


@dataclass(frozen=True)
class Distance:
    """Distances of the last generation's particles."""

    smallest: NotNegative


@dataclass(frozen=True)
class GenerationCounts:
    """Proposals of one generation: judged, of which accepted and failed, and those asked for in the meantime."""

    judged: Count
    accepted: Count
    failed: Count
    asked: Count


@dataclass(frozen=True, eq=False)
class Posterior:
    """The posterior of one site: marginals by parameter, and the threshold ``epsilon`` ``[g]`` of each generation.

    ``distance_weights``: weights of an adaptive distance by generation; empty for other distances.
    """

    specimens: list[str]
    parameters: Mapping[str, Marginal]
    effective_sample_size: NotNegative
    epsilon: Numbers
    distance: Distance
    distance_weights: Mapping[str, Numbers]
    generations: list[GenerationCounts]

    @property
    def has_few(self) -> bool:
        """Whether the particles are worth so few of equal weight that means and intervals depend on the seed."""
        return bool(self.effective_sample_size < ENOUGH)

    @property
    def particles(self) -> int:
        """Particles of the last generation, which is the posterior."""
        return self.generations[-1].accepted if self.generations else 0

    @property
    def judged(self) -> int:
        """Proposals of all generations."""
        return sum(generation.judged for generation in self.generations)


@dataclass(frozen=True, eq=False)
class AbcResult(Result):
    """The posterior of each site. ``names``, ``units`` and ``meanings`` are of the free parameters.

    ``interval`` is the probability of the highest density intervals. ``paper``: whether it is as in Pekedis (2025),
    without noise in simulations; ``priors``: from the same ``calibrated`` specimens, from ``others``, or of the
    ``ranges``. ``population``: particles of the largest generation. ``ess``: how many of equal weight were asked for.
    ``data``: what it is of, by specimen (:func:`sinew.tasks.study.same_data.data_of`).
    """

    TASK = "infer"
    VERSION = 5  # 3: noise is simulated, unless it is the paper's; 4: ess; 5: noise of all quantities
    LIBRARIES = ("pyabc", "arviz")

    sampler: str
    names: list[str]
    units: list[str]
    meanings: list[str]
    paper: bool
    priors: Literal["calibrated", "others", "ranges"]
    population: Count
    interval: Share
    sites: Mapping[str, Posterior]
    inputs: str
    ess: int | None = field(default=None, metadata=OMIT)
    data: Mapping[str, str] | None = field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for names, units and marginals that do not belong together."""
        check_names(self.names, self.units, self.meanings)
        check_marginals(self.names, {site: one.parameters for site, one in self.sites.items()})

    @property
    def few(self) -> list[str]:
        """The sites whose particles are worth too few of equal weight."""
        return [site for site, posterior in self.sites.items() if posterior.has_few]

    @property
    def short(self) -> list[str]:
        """The sites whose particles are worth fewer of equal weight than were asked for, though enough."""
        return [
            site
            for site, one in self.sites.items()
            if self.ess is not None and not one.has_few and one.effective_sample_size < NEARLY * self.ess
        ]

    def beyond(self, free: Sequence[str], bounds: Sequence[tuple[float, float]]) -> list[str]:
        """A sentence for each posterior whose interval leaves the study's range ``bounds`` of a ``free`` parameter."""
        ranges = dict(zip(free, bounds, strict=True))
        return [
            f"{site}: {name} {marginal.hdi[0]:.4g} to {marginal.hdi[1]:.4g} leaves the study's range "
            f"{ranges[name][0]:g} to {ranges[name][1]:g} (the prior is normal, and has no ends)"
            for site, posterior in self.sites.items()
            for name, marginal in posterior.parameters.items()
            if name in ranges and not ranges[name][0] <= marginal.hdi[0] <= marginal.hdi[1] <= ranges[name][1]
        ]


def stored_particles(store: Store, site: str, names: Sequence[str]) -> xr.Dataset:
    """The particles of a site, with parameters in the order of ``names``. Raises ``StoreError``."""
    found = store.read_result(particles_group(site), parameter=names)
    check_weights(store, site, found)
    return found


def check_weights(store: Store, site: str, particles: xr.Dataset) -> None:
    """Raises ``StoreError`` for weights below zero, or whose sum in a generation is not 1."""
    if not are_weights(particles["weight"].transpose(..., "particle").to_numpy()):
        raise StoreError(
            f"{store.path / particles_group(site)}: weights below zero, or that do not sum to 1; infer again"
        )


def are_weights(weight: Array) -> bool:
    """Whether numbers ``[..., particle]`` are not negative and sum to 1."""
    return bool((weight >= 0.0).all() and (np.abs(weight.sum(axis=-1) - 1.0) < ROUNDING).all())


def particles_group(site: str) -> str:
    """Where the store keeps the particles of all generations of a site."""
    return f"infer/{site}"


def draws(particles: xr.Dataset, count: int, seed: tuple[int, ...]) -> Array:
    """Draws ``[count, d]`` of equal weight from a generation, by systematic resampling, in random order."""
    rng = np.random.default_rng(seed)
    weight = particles["weight"].values
    places = (np.arange(count) + rng.random()) / count
    chosen = np.minimum(np.searchsorted(np.cumsum(weight), places), weight.size - 1)
    values: Array = particles["parameters"].values[rng.permutation(chosen)]
    return values
