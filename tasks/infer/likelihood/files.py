"""The files that an inference leaves beside ``infer.json``, for readers of other programs.

=================  ================================================================================================
``infer.csv``      a line for each site and parameter: the population's mean and spread with their intervals
``infer/SITE.nc``  ArviZ's InferenceData: posterior and prior of the population and its specimens, log likelihoods, and
                   the posterior predictive of a new specimen
=================  ================================================================================================
"""

import csv
import io
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from sinew.tasks.infer.likelihood.population import from_prior, moments, specimens_of
from sinew.tasks.infer.likelihood.result import LikelihoodResult, PopulationMarginal
from sinew.tasks.infer.likelihood.scores import places
from sinew.tasks.study.files import write_text

TABLE = "infer.csv"
PRIOR_DRAWS = 4000


def sample(site: str) -> str:
    """The file of a site's draws, relative to the result folder."""
    return f"infer/{site}.nc"


def names(sites: Iterable[str]) -> list[str]:
    """All files of an inference of ``sites``, relative to the result folder."""
    return [TABLE, *(sample(site) for site in sites)]


def write(out: Path, result: LikelihoodResult, draws: Mapping[str, xr.Dataset], seed: tuple[int, ...]) -> None:
    """Write all files; ``draws`` by site, as they are stored."""
    write_text(out / TABLE, _as_csv(result))
    for number, (site, drawn) in enumerate(draws.items()):
        (out / sample(site)).parent.mkdir(exist_ok=True)
        _write_sample(out / sample(site), result, drawn, np.random.default_rng((*seed, number)))


def _as_csv(result: LikelihoodResult) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["site", "parameter", "unit", *(field.name for field in fields(PopulationMarginal))])
    for site, posterior in result.sites.items():
        for name, unit in zip(result.names, result.units, strict=True):
            numbers = astuple(posterior.population[name])
            writer.writerow([site, name, unit, *(f"{value:.6g}" for value in numbers)])
    return text.getvalue()


def _write_sample(path: Path, result: LikelihoodResult, drawn: xr.Dataset, rng: np.random.Generator) -> None:
    from sinew.tasks.infer.library import arviz

    units = dict(zip(result.names, result.units, strict=True))
    varied = [str(name) for name in drawn["parameter"].values]
    prior = _prior(drawn, rng, heavy=result.tails == "heavy")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "More chains", UserWarning)  # there may be: chains are many and short
        data: Any = arviz().from_dict(
            posterior={name: drawn[name].values for name in ("mean", "spread", "specimens")},
            posterior_predictive={"new": drawn["new"].values},
            log_likelihood={"curves": drawn["log_likelihood"].values},
            prior=prior,
            coords={"parameter": varied, "specimen": [str(one) for one in drawn["specimen"].values]},
            dims={"mean": ["parameter"], "spread": ["parameter"], "new": ["parameter"], "curves": ["specimen"],
                  "specimens": ["specimen", "parameter"]},
        )  # fmt: skip
    for group in data.groups():
        data[group].attrs = {"units": str({name: units[name] for name in varied})}  # without a date: equal bytes
    data.to_netcdf(str(path), engine="h5netcdf")


def _prior(drawn: xr.Dataset, rng: np.random.Generator, *, heavy: bool) -> dict[str, Any]:
    """Draws of the prior in the parameters' units."""
    low, width = drawn["low"].values, drawn["width"].values
    population = from_prior(rng, PRIOR_DRAWS, low.size, 1, heavy=heavy)
    spread = np.sqrt(np.diagonal(population.covariance(), axis1=1, axis2=2))
    mean, apart = moments(population.mean, spread, heavy=heavy)
    new = low + width * places(specimens_of(rng, population, heavy=heavy))
    return {"mean": (low + width * mean)[np.newaxis], "spread": (width * apart)[np.newaxis], "new": new[np.newaxis]}
