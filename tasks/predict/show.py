"""How predictions are shown: as tables and on the console."""

from pathlib import Path

import pandas as pd
import xarray as xr
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.predict.result import BANDS, PredictResult
from sinew.tasks.simulate.series import with_unit


def table(result: PredictResult) -> pd.DataFrame:
    """Share of the measured points inside each band, by site: of all points, of whole curves, and by protocol."""
    rows = {
        (site, band): {"all": one.all, "curves": one.curves, **one.protocols}
        for site, bands in result.by_site.items()
        for band, one in bands.items()
        if one.all is not None
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis(["site", "band"])


def headline(result: PredictResult) -> str:
    """What came out, in one line."""
    return f"{result.rows:,} simulations, {result.failed:,} failed"


def points_table(dataset: xr.Dataset, prefix: str = "", unit: str | None = None) -> pd.DataFrame:
    """Every point of the bands of a site: forces (N), or with ``stress_`` the stresses (MPa) of one specimen.

    With the ``prefix`` of another quantity, ``NAME_``, and its ``unit``: its bands.
    """
    dim = f"{prefix}point"
    names = sorted(str(name) for name, values in dataset.variables.items() if values.dims == (dim,))
    first = [name for name in (f"{prefix}specimen", f"{prefix}protocol", f"{prefix}time") if name in names]
    ordered = [*first, *(name for name in names if name not in first)]
    table = pd.DataFrame(
        {name: dataset[name].to_numpy().astype(object if name in first[:2] else float) for name in ordered}
    )
    units = {f"{prefix}time": "time_s", f"{prefix}displacement": "displacement_mm"}
    unit = unit or ("MPa" if prefix else "N")
    return table.rename(columns=lambda name: units.get(name, name if name in first else with_unit(name, unit)))


def summary(result: PredictResult, folder: Path, console: Console) -> None:
    """Print the coverage by site, band and protocol."""
    heads = ("site", "band", "all", "whole curves", *result.protocols)
    grid = Grid(*heads, title="Measured points inside the bands (%), and whole curves")
    for row in result.shares():
        shares = (row["share"], row["curves"], *row["by_protocol"])
        cells = ("" if share is None else f"{100 * share:.1f}" for share in shares)
        grid.add_row(row["site"], BANDS[row["band"]], *cells)
    console.print(grid)
    if others := list(result.shares_of_others()):
        grid = Grid("site", "quantity", "band", "all", *result.protocols, title="The same for the other quantities (%)")
        for row in others:
            shares = (row["share"], *row["by_protocol"])
            cells = ("" if share is None else f"{100 * share:.1f}" for share in shares)
            grid.add_row(row["site"], row["quantity"], BANDS[row["band"]], *cells)
        console.print(grid)
    for site, prediction in result.sites.items():
        for why in prediction.gaps:
            console.print(f"{site}: {why}")
    for remark in result.remarks:
        console.print(remark)
    if result.failed:
        failed = (f"{result.failed:,} of {result.rows:,} simulations failed", "red")
        console.print(Text.assemble(failed, "; bands do without them, and `hdi` needs all three of its own"))
