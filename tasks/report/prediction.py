"""Figures of a prediction: measured curves and bands (12 in Pekedis 2025), and bands of the stresses (14 and S6)."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as Grid

from tasks.report import tables
from tasks.report.figures import COLOURS, STYLE, save
from tasks.workspace import Workspace

BANDS = {
    "hdi": ("mean and HDI bounds", COLOURS[5], COLOURS[0]),
    "draws": ("draws from the posterior", COLOURS[4], COLOURS[1]),
    "new": ("a new specimen", "0.8", "0.45"),
}


def draw(workspace: Workspace, result: dict[str, Any]) -> None:
    """All figures of ``predict.json`` and its store results."""
    folder = workspace.out / "figures"
    for site, told in result["sites"].items():
        dataset = workspace.store.read_result(f"predict/{site}")
        shown = tables.prediction(dataset)
        save(site_bands(dataset, told, site), folder, f"predict_{site}", shown)
        save(each_specimen(dataset, told, site), folder, f"predict_{site}_specimens", shown)
        if told["stresses_of"] is not None:
            stresses = tables.prediction(dataset, "stress_")
            save(stress_bands(dataset, told, site), folder, f"predict_{site}_stresses", stresses)


def tell(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    """Coverage by site and protocol."""
    protocols = list(result["coverage"]["hdi"]["protocols"])
    grid = Grid("site", "band", "all", *protocols, title="Measured points inside the bands (%)")
    every = {site: told["coverage"] for site, told in result["sites"].items()} | {"all": result["coverage"]}
    for site, told in every.items():
        for band, (label, *_) in BANDS.items():
            if told[band]["all"] is not None:
                cells = [told[band]["all"], *(told[band]["protocols"].get(name) for name in protocols)]
                grid.add_row(site, label, *("" if value is None else f"{100 * value:.1f}" for value in cells))
    console.print(grid)
    for site, told in result["sites"].items():
        for why in (told["no_new"], told["no_stresses"]):
            if why is not None:
                console.print(f"{site}: {why}", markup=False)
    if result["failed"]:
        console.print(
            f"[red]{result['failed']:,} of {result['rows']:,} simulations failed[/red]; bands do without them"
        )


def site_bands(dataset: xr.Dataset, told: dict[str, Any], site: str) -> Figure:
    """A row for each band, a column for each protocol; bands of one specimen before the measured curves of all."""
    shown = told["typical"]
    mine = _of(dataset, shown)
    protocols = _protocols(mine)
    bands = [name for name in BANDS if told["coverage"][name]["all"] is not None]
    with plt.rc_context(STYLE):
        size = (2.9 * len(protocols) + 0.6, 1.9 * len(bands) + 0.9)
        figure, axes = plt.subplots(len(bands), len(protocols), figsize=size, squeeze=False, sharex="col", sharey="row")
        for row, band in zip(axes, bands, strict=True):
            for axis, protocol in zip(row, protocols, strict=True):
                for specimen in told["specimens"]:
                    curve = _of(_of(dataset, specimen), protocol, "protocol")
                    style = {"color": "black", "lw": 1.0} if specimen == shown else {"color": "0.65", "lw": 0.5}
                    axis.plot(curve["time"], curve["measured"], zorder=3 if specimen == shown else 2, **style)
                _band(axis, _of(mine, protocol, "protocol"), band)
                part = told["coverage"][band]["protocols"][protocol]
                axis.set_title(f"{protocol.replace('_', ' ')}: {_percent(part)}", loc="left", fontsize=8)
            row[0].set_ylabel(f"{BANDS[band][0]}\nforce (N)")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        figure.suptitle(
            f"{site}: bands for {shown} (black), measured curves of all {len(told['specimens'])} specimens; "
            "percent: points in the band\nof their own specimen, all specimens of the site",
            x=0.01,
            ha="left",
            fontsize=9,
        )
    return figure


def each_specimen(dataset: xr.Dataset, told: dict[str, Any], site: str) -> Figure:
    """Every specimen's curves over what is predicted from the others of its site."""
    protocols = _protocols(dataset)
    specimens = told["specimens"]
    band = "new" if told["no_new"] is None else "hdi"
    with plt.rc_context(STYLE):
        size = (2.7 * len(protocols) + 0.6, 1.25 * len(specimens) + 1.2)
        figure, axes = plt.subplots(
            len(specimens), len(protocols), figsize=size, squeeze=False, sharex="col", sharey=True
        )
        for row, specimen in zip(axes, specimens, strict=True):
            mine = _of(dataset, specimen)
            for axis, protocol in zip(row, protocols, strict=True):
                curve = _of(mine, protocol, "protocol")
                if not curve.sizes["point"]:
                    axis.set_axis_off()
                    continue
                _band(axis, curve, band)
                axis.plot(curve["time"], curve["measured"], color="black", lw=0.9)
                low, high, measured = (curve[n].to_numpy() for n in (f"{band}_low", f"{band}_high", "measured"))
                inside = float(np.mean((measured >= low) & (measured <= high)))
                axis.text(0.98, 0.94, _percent(inside), transform=axis.transAxes, ha="right", va="top", fontsize=8)
            row[0].set_ylabel(f"{specimen}\nforce (N)")
        for axis, protocol in zip(axes[0], protocols, strict=True):
            axis.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        source = "predicted from the other specimens" if band == "new" else BANDS[band][0]
        figure.suptitle(f"{site}: {source}; percent: measured points inside", x=0.01, ha="left", fontsize=9)
    return figure


def stress_bands(dataset: xr.Dataset, told: dict[str, Any], site: str) -> Figure:
    """Second Piola-Kirchhoff stresses of matrix and fibre, along the protocols of one specimen."""
    names = {str(name): name.removeprefix("stress_") for name in map(str, dataset) if name.startswith("stress_")}
    stresses = dataset[[*names, "stress_protocol"]].drop_dims("point", errors="ignore")
    stresses = stresses.rename({**names, "stress_protocol": "protocol", "stress_point": "point"})
    protocols = _protocols(stresses)
    with plt.rc_context(STYLE):
        size = (2.9 * len(protocols) + 0.6, 5.0)
        figure, axes = plt.subplots(2, len(protocols), figsize=size, squeeze=False, sharex="col", sharey="row")
        for row, constituent in zip(axes, ("matrix", "fibre"), strict=True):
            for axis, protocol in zip(row, protocols, strict=True):
                curve = _of(stresses, protocol, "protocol")
                for band in ("new", "hdi", "draws"):  # the widest behind
                    _band(axis, curve, band, constituent + "_")
                axis.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            row[0].set_ylabel(f"{constituent} stress (MPa)")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        title = f"{site}: second Piola-Kirchhoff stresses along the displacements of {told['stresses_of']}"
        figure.suptitle(title, x=0.01, ha="left", fontsize=9)
    return figure


def _protocols(dataset: xr.Dataset) -> list[str]:
    return list(dict.fromkeys(map(str, dataset["protocol"].to_numpy())))


def _of(dataset: xr.Dataset, value: str, label: str = "specimen") -> xr.Dataset:
    """The points of one specimen or protocol."""
    return dataset.isel(point=np.flatnonzero(dataset[label].to_numpy() == value))


def _band(axis: Axes, curve: xr.Dataset, band: str, prefix: str = "") -> None:
    """One band with its bounds; nothing where it is not given."""
    label, face, edge = BANDS[band]
    time = curve["time"].to_numpy()
    low, high = (curve[f"{prefix}{band}_{bound}"].to_numpy() for bound in ("low", "high"))
    if not np.isfinite(low).any():
        return
    axis.fill_between(time, low, high, color=face, alpha=0.55, lw=0, label=label, rasterized=True)
    for bound in (low, high):
        axis.plot(time, bound, color=edge, lw=0.6)


def _percent(part: float | None) -> str:
    return "" if part is None else f"{100 * part:.0f} %"
