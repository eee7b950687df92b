"""Figures of a prediction: measured curves and bands (12 in Pekedis 2025), and bands of the stresses (14 and S6)."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.runner.store.store import open_store
from sinew.tasks.drawing.blocks import with_its_unit
from sinew.tasks.drawing.figures import COLOURS, STYLE, headline, save
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.predict.result import BANDS, PredictResult, SitePrediction, bands_group, of_quantity
from sinew.tasks.predict.show import points_table
from sinew.tasks.study.workspace import Workspace

WIDTH_OF_AN_ENTRY = 1.9  # inches, of a legend in a row
FACES = {"hdi": COLOURS[5], "draws": COLOURS[4], "new": "0.8", "whole": "0.9"}
EDGES = {"hdi": COLOURS[0], "draws": COLOURS[1], "new": "0.45", "whole": "0.6"}


def draw(workspace: Workspace, result: PredictResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    for site, prediction in result.sites.items():
        dataset = workspace.store.read_result(bands_group(site))
        forces = points_table(dataset)
        save(site_bands(dataset, prediction, site), folder, f"predict_{site}", forces)
        save(each_specimen(dataset, prediction, site), folder, f"predict_{site}_specimens", forces)
        for name, other in (prediction.others or {}).items():
            own, label = of_quantity(dataset, name), with_its_unit(name.replace("_", " "), other.unit)
            shown = replace(prediction, coverage=other.coverage)
            table = points_table(dataset, f"{name}_", other.unit)
            save(site_bands(own, shown, site, label), folder, f"predict_{site}_{name}", table)
        if prediction.stresses_of is not None:
            stresses = points_table(dataset, "stress_")
            save(stress_bands(dataset, prediction, site), folder, f"predict_{site}_stresses", stresses)


def _kind(
    draw: Callable[[xr.Dataset, SitePrediction, str], Figure], *, stresses: bool = False
) -> FigureKind[PredictResult]:
    return FigureKind(
        lambda result, folder, site: draw(open_store(folder).read_result(bands_group(site)), result.sites[site], site),
        lambda result: [site for site, one in result.sites.items() if not stresses or one.stresses_of is not None],
    )


def site_bands(dataset: xr.Dataset, prediction: SitePrediction, site: str, label: str = "force (N)") -> Figure:
    """A row for each band, a column for each protocol; bands of one specimen before the measured curves of all."""
    shown = prediction.typical
    mine = _of(dataset, shown)
    protocols = _protocols(mine)
    bands = [name for name in BANDS if prediction.coverage[name].all is not None]
    with plt.rc_context(STYLE):
        size = (2.9 * len(protocols) + 0.6, 1.9 * len(bands) + 0.9)
        figure, axes = plt.subplots(len(bands), len(protocols), figsize=size, squeeze=False, sharex="col", sharey="row")
        for row, band in zip(axes, bands, strict=True):
            for axis, protocol in zip(row, protocols, strict=True):
                for specimen in prediction.specimens:
                    curve = _of(_of(dataset, specimen), protocol, "protocol")
                    style = {"color": "black", "lw": 1.0} if specimen == shown else {"color": "0.65", "lw": 0.5}
                    axis.plot(curve["time"], curve["measured"], zorder=3 if specimen == shown else 2, **style)
                _band(axis, _of(mine, protocol, "protocol"), band)
                share = prediction.coverage[band].protocols[protocol]
                axis.set_title(f"{protocol.replace('_', ' ')}: {_percent(share)}", loc="left", fontsize=8)
            row[0].set_ylabel(f"{BANDS[band]}\n{label}")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        count = len(prediction.specimens)
        all_of = f"measured curves of all {count} specimens" if count > 1 else "the only specimen"
        points = "points in the band of their own specimen, all specimens of the site" if count > 1 else "points inside"
        headline(figure, f"{site}: bands for {shown} (black), {all_of}; percent: {points}")
    return figure


def each_specimen(dataset: xr.Dataset, prediction: SitePrediction, site: str) -> Figure:
    """Every specimen's curves over what is predicted from the others of its site."""
    protocols = _protocols(dataset)
    specimens = prediction.specimens
    band = "new" if prediction.no_new is None else "hdi"
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
                if not np.isfinite(low).any():  # there is no such band
                    continue
                inside = float(np.mean((measured >= low) & (measured <= high)))
                axis.text(0.98, 0.94, _percent(inside), transform=axis.transAxes, ha="right", va="top", fontsize=8)
            row[0].set_ylabel(f"{specimen}\nforce (N)")
        for axis, protocol in zip(axes[0], protocols, strict=True):
            axis.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        source = "predicted from the other specimens, or the population" if band == "new" else BANDS[band]
        headline(figure, f"{site}: {source}; percent: measured points inside")
    return figure


def stress_bands(dataset: xr.Dataset, prediction: SitePrediction, site: str) -> Figure:
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
                for band in ("whole", "new", "hdi", "draws"):  # the widest behind
                    _band(axis, curve, band, constituent + "_")
                axis.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            row[0].set_ylabel(f"{constituent} stress (MPa)")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        across = max(1, min(4, int(size[0] / WIDTH_OF_AN_ENTRY)))
        figure.legend(handles, labels, loc="outside lower center", ncols=across)
        title = f"{site}: second Piola-Kirchhoff stresses along the displacements of {prediction.stresses_of}"
        headline(figure, title)
    return figure


def _protocols(dataset: xr.Dataset) -> list[str]:
    return list(dict.fromkeys(map(str, dataset["protocol"].to_numpy())))


def _of(dataset: xr.Dataset, value: str, label: str = "specimen") -> xr.Dataset:
    """The points of one specimen or protocol."""
    return dataset.isel(point=np.flatnonzero(dataset[label].to_numpy() == value))


def _band(axis: Axes, curve: xr.Dataset, band: str, prefix: str = "") -> None:
    """One band with its bounds; nothing where it is not given."""
    time = curve["time"].to_numpy()
    low, high = (curve[f"{prefix}{band}_{bound}"].to_numpy() for bound in ("low", "high"))
    if not np.isfinite(low).any():
        return
    axis.fill_between(time, low, high, color=FACES[band], alpha=0.55, lw=0, label=BANDS[band], rasterized=True)
    for bound in (low, high):
        axis.plot(time, bound, color=EDGES[band], lw=0.6)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


FIGURES: Mapping[str, FigureKind[PredictResult]] = {
    "bands": _kind(site_bands),
    "specimens": _kind(each_specimen),
    "stresses": _kind(stress_bands, stresses=True),
}
