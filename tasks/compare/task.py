"""Whether the posteriors of the sites differ: read the particles of an inference, compare them in pairs, commit.

The store keeps ``compare``: the component of every particle, and its weight. Contrasts of populations stand in
``compare.csv``, too.
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.tasks.compare.contrasts import Donors, contrasts_of
from sinew.tasks.compare.method import FEWEST, Array, Component, Particles, densities, first_component, pairs_of
from sinew.tasks.compare.result import CompareResult, Contrast, Loadings, SiteParticles
from sinew.tasks.compare.settings import Settings
from sinew.tasks.compare.show import contrast_table
from sinew.tasks.drawing.formats import without_formulas
from sinew.tasks.infer.reading import draws_of_sites, posteriors_of
from sinew.tasks.infer.result import InferResult, LikelihoodResult, Posteriors, draws_of_mean
from sinew.tasks.study import streams
from sinew.tasks.study.cached import cached, commit, key
from sinew.tasks.study.files import write_text
from sinew.tasks.study.result import believed
from sinew.tasks.study.workspace import Workspace

TABLE = "compare.csv"
NOTE = (
    "intervals are about the number of particles: they say how well the overlap of two posteriors is known, "
    "not whether more specimens would set the sites apart"
)


def run(workspace: Workspace, settings: Settings) -> CompareResult:
    """How well the posteriors of each pair of sites can be told apart.

    Raises :class:`BadInput` when there is no inference, when it has one site only, or a site of fewer than four
    particles. Where a few particles have most of the weight, intervals are wide.
    """
    path = InferResult.path(workspace.out)
    inferred = posteriors_of(workspace)
    if len(inferred.sites) < 2:
        raise BadInput(path, f"one site only ({', '.join(inferred.sites)})", "two sites or more to compare")
    with believed(path):
        names = _varied(workspace, inferred)
        draws = draws_of_sites(workspace, inferred)
        sites = {site: _particles(each, names, _worth(inferred, site, names)) for site, each in draws.items()}
        donors = _donors(workspace, inferred)
    arrays = [part for particles in sites.values() for part in (particles.values, particles.weights)]
    inputs = key(CompareResult, workspace.seed, settings.model_dump(), names, list(sites), donors, *arrays)
    files = [TABLE] if isinstance(inferred, LikelihoodResult) else []
    if (known := cached(workspace, CompareResult, inputs, ["compare"], files)) is not None:
        return known
    for site, particles in sites.items():
        if len(particles.weights) < FEWEST:
            expected = f"{FEWEST} or more: a larger infer.population"
            raise BadInput(path, f"{site}: {len(particles.weights)} particles", expected)
    with believed(path):
        component = first_component(list(sites.values()))
        along = {site: component.of(particles.values) for site, particles in sites.items()}
        pairs, curves = pairs_of(component, along, sites, workspace.seed, settings), densities(along, sites)
        contrasts = _contrasts(workspace, draws, donors, names, settings)
    result = CompareResult(
        names=names,
        confidence=settings.confidence,
        contrasts=contrasts,
        component=_loadings(names, component),
        sites={site: SiteParticles(len(each.weights), each.effective) for site, each in sites.items()},
        pairs=pairs,
        densities=curves,
        note=NOTE,
        inputs=inputs,
    )
    if contrasts:
        write_text(
            workspace.out / TABLE, without_formulas(contrast_table(result)).to_csv(index=False, float_format="%.6g")
        )
    else:
        (workspace.out / TABLE).unlink(missing_ok=True)  # of an inference by likelihood before
    commit(workspace, result, {"compare": _arrays(along, sites)})
    return result


def _contrasts(
    workspace: Workspace,
    draws: Mapping[str, xr.Dataset],
    donors: Mapping[str, Donors],
    names: list[str],
    settings: Settings,
) -> list[Contrast]:
    """Differences between populations, where the inference has populations, and so their donors."""
    if not donors:
        return []
    rng = streams.generator(workspace.seed, "contrasts of sites")
    return contrasts_of(draws, donors, names, settings.confidence, rng)


def _donors(workspace: Workspace, inferred: Posteriors) -> dict[str, Donors]:
    """Of whom the specimens of each site are, in their order; for contrasts only."""
    if not isinstance(inferred, LikelihoodResult):
        return {}
    known = {specimen.name: specimen.donor for specimen in workspace.cohort.specimens}
    return {site: [known[name] for name in posterior.specimens] for site, posterior in inferred.sites.items()}


def _varied(workspace: Workspace, inferred: Posteriors) -> list[str]:
    """The parameters that are compared: those that the measured curves depend on."""
    blind = inferred.blind if isinstance(inferred, LikelihoodResult) else []
    return [name for name in inferred.names if name not in blind]


def _worth(inferred: Posteriors, site: str, names: list[str]) -> float:
    """How many independent draws those of a population are worth; of ABC, weights tell it."""
    if not isinstance(inferred, LikelihoodResult):
        return np.inf
    return min(inferred.sites[site].population[name].ess for name in names)


def _particles(draws: xr.Dataset, names: list[str], worth: float) -> Particles:
    """The last particles of ABC, or draws of the mean of a population, no more than they are ``worth``.

    Draws of chains that follow each other are alike, and weighted ones come as copies, which become one particle.
    """
    kept = draws.sel(parameter=names)
    if "mean" in kept:
        drawn = draws_of_mean(kept)
        apart = drawn[np.linspace(0, len(drawn) - 1, int(min(len(drawn), max(worth, FEWEST)))).round().astype(int)]
        _, first, counts = np.unique(apart, axis=0, return_index=True, return_counts=True)
        order = np.argsort(first)
        return Particles(apart[first[order]], counts[order] / len(apart))
    weight = kept["weight"].to_numpy()
    return Particles(kept["parameters"].to_numpy(), weight / weight.sum())


def _loadings(names: list[str], component: Component) -> Loadings:
    by_name = (dict(zip(names, values, strict=True)) for values in (component.loadings, component.mean, component.sd))
    return Loadings(component.explained, *by_name)


def _arrays(along: Mapping[str, Array], sites: Mapping[str, Particles]) -> xr.Dataset:
    """The component of every particle, and its weight among those of its site."""
    return xr.Dataset(
        {
            "component": ("particle", np.concatenate(list(along.values()))),
            "weight": ("particle", np.concatenate([sites[site].weights for site in along])),
        },
        {"site": ("particle", np.repeat(list(along), [values.size for values in along.values()]))},
    )
