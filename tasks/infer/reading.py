"""Posteriors as other tasks read them: whatever contradicts the study, or itself, is refused."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sinew.runner.errors import BadInput
from sinew.tasks.data.sites import site_of
from sinew.tasks.data.text import HUGE
from sinew.tasks.infer.result import (
    InferResult,
    LikelihoodResult,
    Posteriors,
    are_weights,
    draws_of_mean,
    particles_group,
    read_posteriors,
)
from sinew.tasks.model import Parameter
from sinew.tasks.model.parameters import bounds
from sinew.tasks.study.same_data import refuse_other_data
from sinew.tasks.study.workspace import Workspace

MOST_BYTES = 2**29  # of the draws of all sites together
ROUNDING = 1e-6  # standard deviations of a mean
SOME = 0.4  # standard deviations, by which the mean of the draws that are kept may differ from that of all
Array = np.ndarray[Any, np.dtype[Any]]


def posteriors_of(workspace: Workspace) -> Posteriors:
    """The posteriors of a study: of parameters of its model, and of specimens of its cohort, each at its own site.

    Raises :class:`BadInput` where there are none, where they are of something else, and where data, model or ranges
    have changed since.
    """
    path = InferResult.path(workspace.out)
    inferred = read_posteriors(workspace.out)
    if inferred is None:
        raise BadInput(path, "is not there", "`sinew infer` on this study first")
    strange = next(_strange(workspace, inferred, path), None)
    if strange is not None:
        raise BadInput(path, strange, "what `sinew infer` writes; run it again")
    members = [name for posterior in inferred.sites.values() for name in posterior.specimens]
    chosen = workspace.cohort.choose(members, str(path))
    refuse_other_data(workspace, path, inferred.data, chosen, "`sinew infer` again")
    compared = workspace.study.compared
    if isinstance(inferred, LikelihoodResult) and tuple(inferred.compared or ()) != compared:
        was = f"was inferred from {', '.join(('the force', *(inferred.compared or ())))}"
        raise BadInput(
            path, was, f"all that the study compares (the force, {', '.join(compared)}); `sinew infer` again"
        )
    return inferred


def _strange(workspace: Workspace, inferred: Posteriors, path: Path) -> Iterator[str]:
    """What a result says that this study has not."""
    free = {parameter.name: parameter.unit for parameter in workspace.model.free}
    if not inferred.names or not set(inferred.names) <= set(free):
        yield f"is of the parameters {', '.join(inferred.names) or '(none)'}"
    for name, unit in zip(inferred.names, inferred.units, strict=True):
        if free.get(name) != unit:
            yield f"has {name} in {unit}"
    if not inferred.sites:
        yield "names no site"
    seen: set[str] = set()
    for site, posterior in inferred.sites.items():
        if not posterior.specimens:
            yield f"names no specimen of the site {site}"
        for parameter in workspace.model.free:
            said = posterior.parameters.get(parameter.name)
            if said is not None and not _possible(parameter, said.mean, *said.hdi):
                yield f"gives {parameter.name} a value that the model cannot have, at the site {site}"
        for one in workspace.cohort.choose(posterior.specimens, str(path)):
            if site_of(one) != site:
                yield f"has {one.name} at the site {site}"
            if one.name in seen:
                yield f"names {one.name} twice"
            seen.add(one.name)


def _possible(parameter: Parameter, mean: float, low: float, high: float) -> bool:
    """Whether a model can have this mean, of an interval of finite numbers."""
    return parameter.possible(mean) and low <= high and max(map(abs, (mean, low, high))) < HUGE


def draws_of(workspace: Workspace, inferred: Posteriors, site: str) -> xr.Dataset:
    """The draws of a site: of ABC the particles of the last generation, by likelihood all of the populations.

    Raises ``ValueError`` for what no inference leaves (call it within :func:`sinew.tasks.study.result.believed`), and
    ``StoreError`` where the store has none.
    """
    kept = workspace.store.read_result(particles_group(site))
    for name, index in kept.indexes.items():
        if not index.is_unique:
            raise ValueError(f"{site}: the coordinate {name} has a value twice")
    if isinstance(inferred, LikelihoodResult):
        _check(site, kept, ("mean", "spread", "specimens", "new"))
        spread = kept["spread"]
        if not ((spread >= 0.0).all() and (spread.max(("chain", "draw")) > 0.0).all()):
            raise ValueError(f"{site}: a population has no spread")
        _refuse_others(site, inferred.sites[site].parameters, draws_of_mean(kept).mean(axis=0), kept, SOME)
        _check_specimens(workspace, inferred, site, kept)
        return kept
    last = kept[["parameters", "weight"]].isel(generation=-1).copy(deep=True)
    _check(site, last, ("parameters", "weight"))
    weight = last["weight"].to_numpy()
    if not are_weights(weight):
        raise ValueError(f"{site}: the weights of the particles do not sum to 1")
    values = last["parameters"].transpose("particle", "parameter").to_numpy()
    _refuse_others(site, inferred.sites[site].parameters, weight @ values, last, ROUNDING)
    return last


def draws_of_sites(workspace: Workspace, inferred: Posteriors) -> dict[str, xr.Dataset]:
    """:func:`draws_of` all sites together."""
    found, size = {}, 0
    for site in inferred.sites:
        found[site] = draws_of(workspace, inferred, site)
        size += found[site].nbytes
        if size > MOST_BYTES:
            raise ValueError(f"the draws of {site} and the sites before it take more than {MOST_BYTES:,} bytes")
    return found


def _check_specimens(workspace: Workspace, inferred: LikelihoodResult, site: str, kept: xr.Dataset) -> None:
    """Raises ``ValueError`` for draws of other specimens than those of the result, or outside of the study's ranges."""
    drawn = kept["specimen"].to_numpy().tolist()
    if sorted(drawn) != sorted(inferred.sites[site].specimens):
        raise ValueError(f"{site}: the store has draws of {', '.join(map(str, drawn))[:80]}")
    for specimen in drawn:
        means = kept["specimens"].sel(specimen=specimen).mean(("chain", "draw"))
        _refuse_others(str(specimen), inferred.specimens.get(specimen, {}), means.to_numpy(), kept, SOME)
    low, high = bounds([one for one in workspace.model.free if one.name in kept["parameter"].to_numpy()])
    ends = xr.DataArray(np.stack([low, high]) + np.outer([-ROUNDING, ROUNDING], high - low), dims=("end", "parameter"))
    for name in ("specimens", "new"):
        if not ((kept[name] >= ends[0]) & (kept[name] <= ends[1])).all():
            raise ValueError(f"{site}: {name} are outside of the ranges of the study")


def _refuse_others(what: str, told: Mapping[str, Any], means: Array, kept: xr.Dataset, tolerance: float) -> None:
    """Raises ``ValueError`` for draws whose ``means`` ``[k]`` are not those ``told``: they are of something else.

    ``told``: mean and standard deviation by parameter. ``tolerance``: in standard deviations.
    """
    for name, mean in zip(kept["parameter"].to_numpy().tolist(), np.asarray(means).tolist(), strict=True):
        one = told.get(name)
        if one is not None and abs(mean - one.mean) > tolerance * max(one.sd, ROUNDING * abs(one.mean)):
            raise ValueError(f"{what}: the mean {name} is {one.mean:g}, but {mean:g} of the draws in the store")


def _check(site: str, kept: xr.Dataset, names: tuple[str, ...]) -> None:
    """Raises ``ValueError`` for numbers that are none, or beyond all bounds."""
    for name in names:
        if kept[name].dtype.kind != "f" or not (np.abs(kept[name].to_numpy()) < HUGE).all():
            raise ValueError(f"{site}: {name} holds values that are not finite numbers")
