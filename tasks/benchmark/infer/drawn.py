"""Cohorts that are drawn from the prior of an inference: two sites of specimens from one population, and its truth.

========================  =============================================================================================
by likelihood             a population from its prior, and specimens of it, all within the ranges
by ABC                    one parameter set for all specimens, uniform over the ranges: what ABC supposes of a site
========================  =============================================================================================

Nothing differs between the two sites, so every difference that is found between them is an error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.virtual import virtual_specimen
from sinew.tasks.infer.likelihood.population import Population, from_prior, moments, specimens_of
from sinew.tasks.infer.likelihood.scores import inside, places
from sinew.tasks.model import Model, Specimen
from sinew.tasks.model.effects import named
from sinew.tasks.model.parameters import bounds
from sinew.tasks.model.protocols import STANDARD
from sinew.tasks.simulate import Array

SITES = ("first", "second")
TESTS = {make.__name__: make for make in STANDARD}
TRIES = 10_000  # populations, until all specimens of one are within the ranges


@dataclass(frozen=True)
class Conditions:
    """How cohorts are measured: specimens ``per_site``, names of ``tests``, samples per second, and noise.

    ``noise``: standard deviation as a fraction of a specimen's peak force, whose neighbours correlate by ``ar1``.
    What the model does not have: an ``effect`` of the library in all specimens, at its typical size, or ``""``; and an
    uneven ``screw``, as for :func:`sinew.tasks.data.virtual.virtual_cohort`.
    """

    per_site: int = 4
    tests: tuple[str, ...] = tuple(TESTS)
    rate_hz: float = 20.0
    noise: float = 0.003
    ar1: float = 0.3
    effect: str = ""
    screw: float = 0.0

    def __post_init__(self) -> None:
        for name in self.tests:
            if name not in TESTS:
                raise BadInput("--protocol", f"no protocol {name}", f"one of {', '.join(TESTS)}")
        if self.effect and self.effect not in named():
            raise BadInput("--effect", f"{shown(self.effect)} is no effect", f"one of {', '.join(named())}")


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of a cohort, as places in the ranges.

    ``mean`` and ``spread`` ``[k]`` of the population, and of each specimen by name its parameters ``[k]``. ``further``
    ``[2, k]``: one more of the population for each site, which no inference knows.
    """

    names: tuple[str, ...]
    mean: Array
    spread: Array
    specimens: dict[str, Array]
    further: Array


def drawn(
    rng: np.random.Generator, model: Model, conditions: Conditions, *, by_likelihood: bool, heavy: bool
) -> tuple[list[Specimen], Truth]:
    """Specimens ``SITE/NUMBER`` with simulated measurements, and their truth."""
    names = [f"{site}/{number + 1}" for site in SITES for number in range(conditions.per_site)]
    varied = tuple(parameter.name for parameter in model.free)
    if by_likelihood:
        mean, spread, at, further = _population(rng, len(varied), conditions.per_site, heavy=heavy)
    else:
        mean, spread = rng.random(len(varied)), np.zeros(len(varied))
        at, further = np.tile(mean, (len(names), 1)), np.tile(mean, (len(SITES), 1))
    specimens = [measured(rng, name, model, one, conditions) for name, one in zip(names, at, strict=True)]
    return specimens, Truth(varied, mean, spread, dict(zip(names, at, strict=True)), further)


def measured(rng: np.random.Generator, name: str, model: Model, at: Array, conditions: Conditions) -> Specimen:
    """A specimen at places ``at`` ``[k]`` of the free parameters, with simulated measurements."""
    low, high = bounds(model.free)
    varied = tuple(parameter.name for parameter in model.free)
    values = model.full(varied, (low + (high - low) * at)[np.newaxis])[0]
    tests = [TESTS[test] for test in conditions.tests]
    effects = (named()[conditions.effect],) if conditions.effect else ()
    return virtual_specimen(
        rng, name, model, values, tests, rate_hz=conditions.rate_hz, noise=conditions.noise, ar1=conditions.ar1,
        effects=effects, screw=conditions.screw,
    )[0]  # fmt: skip


def _population(
    rng: np.random.Generator, size: int, per_site: int, *, heavy: bool
) -> tuple[Array, Array, Array, Array]:
    """Mean and spread ``[k]`` of a population, specimens ``[n, k]`` of both sites, and one more for each site.

    All as places. A population whose specimens of the first site are not all within the ranges is not used, as the
    inference of a site supposes; those of the second site are drawn until they are. So each site alone is a draw from
    what its inference takes for the prior. Those that are one more may be anywhere, as a new specimen may.
    """
    for _ in range(TRIES):
        population = from_prior(rng, 1, size, 1, heavy=heavy)
        first = _specimens(rng, population, per_site, heavy=heavy)
        if not inside(first).all():
            continue
        for _ in range(TRIES):
            second = _specimens(rng, population, per_site, heavy=heavy)
            if inside(second).all():
                spread = np.sqrt(np.diagonal(population.covariance()[0]))
                further = _specimens(rng, population, len(SITES), heavy=heavy)
                mean, spread = moments(population.mean[0], spread, heavy=heavy)
                return mean, spread, places(np.concatenate([first, second])), places(further)
    raise BadInput("--specimens", f"no population keeps {per_site} specimens within the ranges", "fewer specimens")


def _specimens(rng: np.random.Generator, population: Population, count: int, *, heavy: bool) -> Array:
    """Scores ``[count, k]`` of specimens of one population, wherever they are."""
    return np.concatenate([specimens_of(rng, population, heavy=heavy) for _ in range(count)])


def tests_of(names: Sequence[str]) -> tuple[str, ...]:
    """The names of tests; all without any."""
    return tuple(names) or tuple(TESTS)
