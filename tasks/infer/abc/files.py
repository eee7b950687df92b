"""The files that an inference leaves beside ``infer.json``, for readers of other programs.

=================  ====================================================================
``infer.csv``      mean, standard deviation and interval by site, as table 3 of Pekedis (2025)
``infer/SITE.db``  pyABC's own history
``infer/SITE.nc``  draws of equal weight from the posterior, for ArviZ
=================  ====================================================================
"""

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sinew.tasks.infer.abc.result import AbcResult
from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array
from sinew.tasks.study.files import write_text

TABLE = "infer.csv"


def database(site: str) -> str:
    """The file of pyABC's history of a site, relative to the result folder."""
    return f"infer/{site}.db"


def sample(site: str) -> str:
    """The file of ArviZ's sample of a site, relative to the result folder."""
    return f"infer/{site}.nc"


def names(sites: Iterable[str]) -> list[str]:
    """All files of an inference of ``sites``, relative to the result folder."""
    return [TABLE, *(file(site) for site in sites for file in (database, sample))]


def write_sample(out: Path, site: str, parameters: Iterable[Parameter], drawn: Array) -> None:
    """Write draws ``[n, d]`` of the free ``parameters`` for ArviZ."""
    from sinew.tasks.infer.library import arviz

    units = {parameter.name: parameter.unit for parameter in parameters}
    posterior = {name: drawn[np.newaxis, :, j] for j, name in enumerate(units)}
    data: Any = arviz().from_dict(posterior=posterior, posterior_attrs={"units": str(units), "site": site})
    del data.posterior.attrs["created_at"]  # equal draws give equal bytes
    data.to_netcdf(str(out / sample(site)), engine="h5netcdf")


def write_table(out: Path, result: AbcResult) -> None:
    """Write ``infer.csv``: a line for each parameter, four columns for each site."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = ("mean", "sd", "hdi_low", "hdi_high")
    writer.writerow(["parameter", "unit", *(f"{site}_{column}" for site in result.sites for column in columns)])
    for name, unit in zip(result.names, result.units, strict=True):
        marginals = [posterior.parameters[name] for posterior in result.sites.values()]
        numbers = [value for each in marginals for value in (each.mean, each.sd, *each.hdi)]
        writer.writerow([name, unit, *(f"{value:.6g}" for value in numbers)])
    write_text(out / TABLE, text.getvalue())
