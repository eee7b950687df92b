"""Figures of the sensitivity tasks, in the colours of Okabe and Ito (2008) that colour-blind readers tell apart."""

import os
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import xarray as xr
from cycler import cycler

if "inline" not in os.environ.get("MPLBACKEND", ""):  # a notebook shows figures by its own, which draws as Agg does
    matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from tasks.evaluate import kept_points
from tasks.model import Specimen

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
DRAWN = 2000  # points of a measured curve, at the most: more than a figure has pixels
FORMATS = ("png", "pdf", "csv")  # of every figure
_LABELS = {"E": "E", "alpha": r"\alpha", "g": "g", "tau": r"\tau", "nu": r"\nu"}
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=COLOURS),
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def symbol(name: str) -> str:
    """``tau_1f`` as a formula."""
    stem, line, index = name.partition("_")
    if stem not in _LABELS or (line and not index.isalnum()):
        return name
    return rf"${_LABELS[stem]}_{{{index}}}$" if line else f"${_LABELS[stem]}$"


def save(figure: Figure, folder: Path, name: str, shown: pd.DataFrame) -> list[Path]:
    """Write ``FOLDER/NAME.png``, ``.pdf`` and, with the numbers that are ``shown``, ``.csv``.

    Equal figures give equal bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    png, pdf, csv = (folder / f"{name}.{kind}" for kind in FORMATS)
    figure.savefig(png, dpi=150, metadata={"Software": None})
    figure.savefig(pdf, metadata={"CreationDate": None, "Producer": None})
    plt.close(figure)
    shown.to_csv(csv, index=False, lineterminator="\n", float_format="%.8g")
    return [png, pdf, csv]


def sobol_indices(result: dict[str, Any]) -> Figure:
    """First and total order indices with intervals: the total objective above, each protocol below."""
    shown = panels(result)
    with plt.rc_context(STYLE):
        height = 2.1 * len(shown) + 0.4
        figure, axes = plt.subplots(len(shown), 1, figsize=(7.5, height), sharex=True, squeeze=False)
        at = np.arange(len(result["names"]))
        for axis, (title, values) in zip(axes[:, 0], shown.items(), strict=True):
            for key, label, shift, colour in (("S1", "first order", -0.2, 0), ("ST", "total order", 0.2, 1)):
                heights = _numbers(values[key])
                errors = _numbers(values[f"{key}_conf"])
                axis.bar(
                    at + shift, heights, 0.38, yerr=errors, color=COLOURS[colour], label=label, error_kw={"lw": 0.8}
                )
            axis.axhline(0, color="black", lw=0.6)
            axis.set_title(title.replace("_", " "), loc="left", fontsize=9)
            axis.set_ylabel("Sobol index")
        axes[0, 0].legend(ncols=2)
        axes[-1, 0].set_xticks(at, [symbol(name) for name in result["names"]])
        percent = round(100 * result["confidence"])
        figure.suptitle(
            f"{result['rows']:,} rows, {result['failed']:,} failed; bars: {percent} % bootstrap interval", fontsize=9
        )
    return figure


def sobol_along_time(dataset: xr.Dataset, names: list[str], output: str | None = None, *, shown: int = 6) -> Figure:
    """Total order indices of the force, or of an ``output``, along each protocol, for those that matter most anywhere.

    Below is what was measured, or the displacement where nothing was.
    """
    prefix = "" if output is None else f"{output}_"
    protocols = sorted(str(name).removeprefix("time_") for name in dataset.dims if str(name).startswith("time_"))
    strongest = np.zeros(len(names))
    for protocol in protocols:
        strongest = np.fmax(strongest, np.nan_to_num(dataset[f"ST_{prefix}{protocol}"].to_numpy()).max(axis=1))
    chosen = np.argsort(-strongest)[:shown]
    styles = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            2,
            len(protocols),
            figsize=(3.4 * len(protocols) + 0.6, 4.6),
            squeeze=False,
            sharex="col",
            height_ratios=(3, 1),
        )
        for column, protocol in enumerate(protocols):
            time = dataset[f"time_{protocol}"].to_numpy()
            above, below = axes[:, column]
            for rank, j in enumerate(chosen):
                index = dataset[f"ST_{prefix}{protocol}"].to_numpy()[j]
                conf = dataset[f"ST_conf_{prefix}{protocol}"].to_numpy()[j]
                above.plot(
                    time,
                    index,
                    linestyle=styles[rank % len(styles)],
                    color=COLOURS[rank % len(COLOURS)],
                    label=symbol(names[j]),
                    lw=1.3,
                )
                above.fill_between(
                    time, index - conf, index + conf, color=COLOURS[rank % len(COLOURS)], alpha=0.15, lw=0
                )
            above.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            above.set_ylim(-0.02, None)
            kind, unit = beside(dataset, protocol, output)
            below.plot(time, dataset[f"{kind}_{protocol}"], color="black", lw=0.9)
            below.set_xlabel("time (s)")
        axes[0, 0].set_ylabel(f"total order index of {'the force' if output is None else output.replace('_', ' ')}")
        axes[1, 0].set_ylabel(f"{'measured' if kind == 'measured' else 'moved'} ({unit})")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(chosen))
        figure.supxlabel(f"specimen {dataset.attrs['specimen']}", fontsize=8, x=0.99, ha="right")
    return figure


def sobol_convergence(result: dict[str, Any], *, shown: int = 6) -> Figure:
    """How the total order indices settle as the design grows."""
    curve = result["convergence"]
    sizes = np.array(curve["base_samples"])
    total, conf = _numbers(curve["ST"]), _numbers(curve["ST_conf"])
    chosen = np.argsort(-np.nan_to_num(total[-1]))[:shown]
    markers = "osv^D*"
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(6, 3.6))
        for rank, j in enumerate(chosen):
            shift = 1 + 0.02 * (rank - shown / 2)
            axis.errorbar(
                sizes * shift,
                total[:, j],
                conf[:, j],
                marker=markers[rank % 6],
                ms=4,
                lw=1,
                capsize=2,
                label=symbol(result["names"][j]),
            )
        axis.set_xscale("log", base=2)
        axis.set_xticks(sizes, [f"{size:,}" for size in sizes], rotation=30)
        axis.minorticks_off()
        axis.set_xlabel("base samples")
        axis.set_ylabel(f"total order index, {_total(result)}")
        axis.legend(ncols=3)
    return figure


def forest_importance(result: dict[str, Any]) -> Figure:
    """Impurity (percent) and permutation importance for the total objective and each protocol."""
    shown = panels(result)
    at = np.arange(len(result["names"]))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(8, 5.2), sharey=True)
        width = 0.8 / len(shown)
        for axis, key, spread, label in (
            (axes[0], "impurity_percent", "impurity_sd", "impurity importance (%)"),
            (axes[1], "permutation", "permutation_sd", "permutation importance (loss of $R^2$)"),
        ):
            for k, (title, values) in enumerate(shown.items()):
                place = at - 0.4 + width * (k + 0.5)
                axis.barh(
                    place,
                    _numbers(values[key]),
                    width,
                    xerr=_numbers(values[spread]),
                    color=COLOURS[k % len(COLOURS)],
                    label=f"{title.replace('_', ' ')} ($R^2$ {values['r2_on_unseen']:.2f})",
                    error_kw={"lw": 0.6},
                )
            axis.set_xlabel(label)
        axes[0].set_yticks(at, [symbol(name) for name in result["names"]])
        axes[0].invert_yaxis()
        axes[1].legend(loc="lower right", fontsize=8)
    return figure


def panels(result: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What a person is shown of a sensitivity study: all together, each protocol, each of a template's outputs."""
    shown = {_total(result): result, **result["protocols"], **result.get("outputs", {})}
    if _scored(result):
        return shown
    same = {result["field"].removeprefix("summary_")}  # what all together are of; with one protocol that is the same
    same |= set(result["protocols"]) if len(result["protocols"]) == 1 else set()
    return {name: values for name, values in shown.items() if name not in same}


def _scored(result: dict[str, Any]) -> bool:
    """Whether it is about how far the model is from measured forces, not about an output."""
    return bool(result.get("field", "objective") == "objective")


def _total(result: dict[str, Any]) -> str:
    """What the indices of all protocols together are of."""
    return "total objective" if _scored(result) else str(result["objective"])


def beside(dataset: xr.Dataset, protocol: str, output: str | None) -> tuple[str, str]:
    """What is shown beside indices along time, and its unit: the measured force, else how far the specimen is moved."""
    measured = output is None and f"measured_{protocol}" in dataset
    return ("measured", "N") if measured else ("displacement", "mm")


def _numbers(values: Any) -> np.ndarray:
    """JSON's null back to NaN."""
    return np.array(values, dtype=float)


def calibration_convergence(result: dict[str, Any]) -> Figure:
    """How far above the noise of its curves each specimen's objective is, against evaluations: a panel by method."""
    methods = result["methods"]
    with plt.rc_context(STYLE):
        size = (3.4 * len(methods) + 0.6, 3.2)
        figure, axes = plt.subplots(1, len(methods), figsize=size, sharex=True, sharey=True, squeeze=False)
        for axis, method in zip(axes[0], methods, strict=True):
            ends = []
            for told in result["specimens"].values():
                found = told["methods"].get(method)
                if found is None or not (told["noise_N"] or 0.0) > 0.0:  # None or NaN: nothing is known of it
                    continue
                used, totals = np.array(found["trace"], dtype=float).T
                above = np.maximum(100 * (totals / told["noise_N"] - 1.0), 0.1)
                axis.step(used, above, where="post", color=COLOURS[0], lw=0.7, alpha=0.6)
                ends.append(above[-1])
            if ends:  # the noise is known
                axis.set_xscale("log")
                axis.set_yscale("log")
            axis.set_xlabel("evaluations")
            middle = f", median {np.median(ends):.3g} %" if ends else ""
            axis.set_title(f"{method.replace('_', ' ')}{middle}", loc="left", fontsize=9)
        axes[0, 0].set_ylabel("objective above the noise (%)")
    return figure


def fitted_curves(specimen: Specimen, forces: dict[str, Any], rmse_N: dict[str, float]) -> Figure:
    """Measured curves and the calibrated model: over time above, over displacement below."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(2, len(specimen.curves), figsize=(3.2 * len(specimen.curves), 5.0), squeeze=False)
        for column, curve in enumerate(specimen.curves):
            history, keep = curve.protocol, kept_points(curve.protocol, DRAWN)
            for axis, across in zip(axes[:, column], (history.time_s, history.displacement_mm), strict=True):
                axis.plot(across[keep], curve.force_N[keep], color="0.6", lw=1.6, label="measured", rasterized=True)
                axis.plot(
                    across[keep], forces[curve.name][keep], color=COLOURS[1], lw=0.7, label="model", rasterized=True
                )
            axes[0, column].set_title(f"{curve.name.replace('_', ' ')}: RMSE {rmse_N[curve.name]:.3g} N", fontsize=9)
            axes[0, column].set_xlabel("time (s)")
            axes[1, column].set_xlabel("displacement (mm)")
        for axis in axes[:, 0]:
            axis.set_ylabel("force (N)")
        axes[1, -1].legend()
        figure.suptitle(specimen.name, x=0.01, ha="left", fontsize=10)
    return figure
