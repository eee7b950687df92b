"""Approximate Bayesian computation by sequential Monte Carlo (ABC-SMC, pyABC) for one site, as in Pekedis (2025).

One parameter set is compared with all specimens of a site. Where simulations run is the sampler's business.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
import pyabc
import xarray as xr
from pyabc.sampler import Sampler

from sinew.tasks.infer.abc.history import IN_MEMORY, close
from sinew.tasks.infer.abc.noise import CurveNoise
from sinew.tasks.infer.abc.observations import SiteEvaluation, root_mean_square
from sinew.tasks.infer.abc.population import EnoughParticles
from sinew.tasks.infer.abc.prior import Prior
from sinew.tasks.infer.abc.pyabc_priors import Alike, Normals
from sinew.tasks.infer.abc.result import INTERVAL, Distance, GenerationCounts, Marginal, Posterior, draws
from sinew.tasks.infer.abc.sampler import Generation, StoreSampler
from sinew.tasks.infer.abc.transitions import DefensiveNormal
from sinew.tasks.infer.library import arviz
from sinew.tasks.infer.settings import Settings
from sinew.tasks.simulate import Array

DRAWS = 1000  # of equal weight, for readers that take no weights

logging.getLogger("ABC").setLevel(logging.ERROR)  # sinew shows the progress itself; weights may be far from one

Judged = Callable[[float, Generation], None]
"""Called after each proposal with the threshold and the counts of its generation."""


@dataclass(frozen=True)
class Comparison:
    """How an outcome is compared with the measurements: pyABC's ``distance`` between summary statistics.

    ``describe`` makes the summary statistics of an outcome; ``observed`` are those of the measurements.
    """

    distance: Any
    describe: Callable[[Mapping[str, Array]], dict[str, Any]]
    observed: dict[str, Any]


@dataclass(frozen=True)
class Inferred:
    """A finished inference: the particles of all generations, counts, and weights of an adaptive distance."""

    particles: xr.Dataset
    generations: list[Generation]
    weights: dict[str, Array]


def comparison(kind: str, evaluation: SiteEvaluation, noise: CurveNoise | None = None) -> Comparison:
    """The comparison of ``kind`` ``relative`` or ``adaptive``, for the curves of one site.

    With ``noise``, simulations are as noisy as measurements.
    """
    curves = evaluation.curves()
    if kind == "relative":

        def errors(values: Mapping[str, Array]) -> dict[str, Any]:
            found = values["relative_error"]
            if noise is not None:
                found = noise.relative_errors(found)
            return {"relative_error": found}

        nothing = np.zeros(len(curves) + len(evaluation.others()))
        return Comparison(relative_distance, errors, {"relative_error": nothing})
    of, measured = evaluation.points()
    scale = np.array([root_mean_square(curve.force_N) for _, curve in curves])[of]
    of_others = evaluation.curves_of_others()

    def describe(values: Mapping[str, Array]) -> dict[str, Any]:
        found = {"force": values["force"] / scale}
        found |= {"others": values["others"]} if "others" in values else {}
        if noise is not None:
            for name, curve in (("force", of), ("others", of_others)):
                if name in found:
                    found[name] = found[name] + noise.size[curve] * np.random.standard_normal(curve.size)
        return found

    observed = {"force": measured / scale} | ({"others": evaluation.points_of_others()} if evaluation.others() else {})
    return Comparison(pyabc.AdaptivePNormDistance(p=2), describe, observed)


def relative_distance(x: Mapping[str, Array], observed: Mapping[str, Array]) -> float:
    """Root mean square over curves of their relative errors: every curve counts the same, however long it is."""
    return float(np.sqrt(np.mean(np.square(x["relative_error"]))))


def infer(
    settings: Settings,
    prior: Normals,
    compared: Comparison,
    model: pyabc.Model,
    sampler: Sampler,
    *,
    on_judged: Judged,
    save: Callable[[pyabc.History], None],
) -> Inferred | None:
    """Run ABC-SMC; None when not even the first generation is full.

    ``on_judged`` is called after each proposal, by :class:`StoreSampler` only; ``save`` receives the whole history.
    """
    relative = settings.distance == "relative"
    first = settings.epsilon if relative and settings.epsilon else "from_sample"
    threshold = pyabc.QuantileEpsilon(initial_epsilon=first, alpha=settings.quantile)
    assert settings.population is not None, "it is filled in"
    population = settings.population if settings.ess is None else EnoughParticles(settings.population, settings.ess)
    abc = pyabc.ABCSMC(
        model,
        prior,
        compared.distance,
        model_prior=Alike(1),
        transitions=DefensiveNormal(prior),
        population_size=population,
        eps=threshold,
        sampler=sampler,
    )
    if isinstance(sampler, StoreSampler):
        sampler.on_judged = partial(_report, threshold, on_judged)
    history = abc.new(IN_MEMORY, compared.observed)
    try:
        abc.run(
            minimum_epsilon=settings.smallest_epsilon,
            max_nr_populations=settings.generations,
            min_acceptance_rate=settings.smallest_acceptance,
        )
        if history.n_populations == 0:
            return None
        save(history)
        by_generation = getattr(compared.distance, "scale_weights", None) or {}
        weights = {str(t): np.asarray(w) for t, w in by_generation.items() if 0 <= t <= history.max_t}
        return Inferred(particles_of(history, prior.names), sampler.generations, weights)
    finally:
        close(history)


def _report(threshold: Callable[[int], float], on_judged: Judged, generation: Generation) -> None:
    t = generation.t
    on_judged(float(threshold(t)) if t >= 0 else np.nan, generation)


def particles_of(history: pyabc.History, names: tuple[str, ...]) -> xr.Dataset:
    """Every generation of a history: parameters, weights (their sum is 1) and distances of its particles.

    Generations with fewer particles than others repeat their last one, with the weight 0.
    """
    parameters, weights, distances, thresholds = [], [], [], []
    populations = history.get_all_populations().set_index("t")
    for t in range(history.max_t + 1):
        frame, weight = history.get_distribution(m=0, t=t)
        parameters.append(frame[list(names)].to_numpy())
        weights.append(weight / weight.sum())
        distances.append(history.get_weighted_distances(t=t)["distance"].to_numpy())
        thresholds.append(float(populations.loc[t, "epsilon"]))
    return xr.Dataset(
        {
            "parameters": (("generation", "particle", "parameter"), _alike(parameters, "edge")),
            "weight": (("generation", "particle"), _alike(weights, "constant")),
            "distance": (("generation", "particle"), _alike(distances, "edge")),
            "epsilon": ("generation", np.array(thresholds)),
        },
        coords={"parameter": list(names)},
    )


def _alike(generations: list[Array], mode: Literal["edge", "constant"]) -> Array:
    """Arrays whose first axes are made as long as the longest one's."""
    longest = max(len(one) for one in generations)
    return np.array(
        [np.pad(one, [(0, longest - len(one)), *[(0, 0)] * (one.ndim - 1)], mode=mode) for one in generations]
    )


def posterior(inferred: Inferred, prior: Prior, specimens: list[str], seed: tuple[int, ...]) -> Posterior:
    """The posterior of one site; ``seed`` is that of the draws from which the intervals come."""
    particles = inferred.particles
    values, weight = particles["parameters"].values[-1], particles["weight"].values[-1]
    mean = weight @ values
    sd = np.sqrt(weight @ (values - mean) ** 2)
    drawn = draws(particles.isel(generation=-1), DRAWS, seed)
    hdi = np.array([arviz().hdi(drawn[:, j], hdi_prob=INTERVAL) for j in range(len(prior.names))])
    whole = range(particles.sizes["generation"])  # neither the sample to learn from nor an unfinished generation
    return Posterior(
        specimens=specimens,
        parameters={
            name: Marginal(
                mean[j], sd[j], hdi[j], prior.mean[j], prior.spread[j], "uniform" if prior.uniform[j] else "normal"
            )
            for j, name in enumerate(prior.names)
        },
        effective_sample_size=float(1.0 / np.sum(weight**2)),
        epsilon=particles["epsilon"].values,
        distance=Distance(float(particles["distance"].values[-1].min())),
        distance_weights=inferred.weights,
        generations=[
            GenerationCounts(each.judged, each.accepted, each.failed, each.asked)
            for each in inferred.generations
            if each.t in whole
        ],
    )
