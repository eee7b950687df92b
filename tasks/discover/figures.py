"""Figures and words of a discovery: the verdict, the candidates, curves and cells before and after."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from sinew.runner.store.store import open_store
from sinew.tasks.discover.misfit_map import CellMisfit
from sinew.tasks.discover.quantities import leftovers, quantities_table, rows_of
from sinew.tasks.discover.result import DiscoverResult
from sinew.tasks.discover.show import cells_table, curves_table, gap_of, stack_of
from sinew.tasks.drawing.figures import COLOURS, MEASURED, STYLE, headline, save
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.model import file_name
from sinew.tasks.study.workspace import Workspace

FAR = 12.0  # units of chance, where colours end
FAR_LEFT = 8.0  # times the noise, where the axes of what is left end
MOST_ROWS = 24  # quantities of a figure


def draw(workspace: Workspace, result: DiscoverResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    save(cell_map(result), folder, "discover_cells", cells_table(result))
    if result.remainder is not None:
        save(parts(result), folder, "discover_parts", stack_of(result))
    for specimen in result.cells:
        kept = workspace.store.read_result(f"discover/{file_name(specimen)}")
        figure = before_and_after(kept, result, specimen)
        save(figure, folder, f"discover_{file_name(specimen)}", curves_table(kept))
        if result.compared:
            name = f"discover_{file_name(specimen)}_quantities"
            save(left_of_quantities(kept, result, specimen), folder, name, quantities_table(kept, result, specimen))


def parts(result: DiscoverResult) -> Figure:
    """The misfit as a stack of what the named effects explain and what is left."""
    stack = stack_of(result)
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(7.5, 1.9), layout="constrained")
        begin = 0.0
        for number, (part, share) in enumerate(zip(stack["part"], 100.0 * stack["share"], strict=True)):
            colour = {"left": "0.8", "any of these": "0.55"}.get(part, COLOURS[number % len(COLOURS)])
            axis.barh(0, share, left=begin, color=colour, edgecolor="white", label=f"{part}: {share:.1f} %")
            begin += share
        axis.set_yticks([])
        axis.set_xlim(0.0, max(begin, 100.0))
        axis.set_xlabel("part of the misfit beyond noise (%)")
        figure.legend(loc="outside upper left", ncols=4, fontsize=8)
    return figure


def before_and_after(kept: xr.Dataset, result: DiscoverResult, specimen: str) -> Figure:
    """A column for each protocol: forces, what the model as it is leaves, what the model with the effects leaves."""
    protocols = list(dict.fromkeys(cell.protocol for cell in result.cells[specimen]))
    effects = result.shown_name
    models = {"bare": ("the model as it is", COLOURS[1])}
    if effects:
        models["having"] = (f"with {effects}", COLOURS[0])
    noise = result.noise[specimen].sd_N
    with plt.rc_context(STYLE):
        size = (3.6 * len(protocols), 2.4 + 1.6 * len(models))
        ratios = [1.5] + [1.0] * len(models)
        figure, axes = plt.subplots(
            1 + len(models),
            len(protocols),
            figsize=size,
            sharex="col",
            sharey="row",
            squeeze=False,
            height_ratios=ratios,
        )
        for column, protocol in enumerate(protocols):
            time = kept[f"time_{protocol}"].to_numpy()
            measured = kept[f"measured_{protocol}"].to_numpy()
            axes[0, column].plot(time, measured, color=MEASURED, lw=2.4, label="measured")
            for row, (name, (label, colour)) in enumerate(models.items(), start=1):
                force = kept[f"{name}_{protocol}"].to_numpy()
                axes[0, column].plot(time, force, color=colour, lw=0.9, label=label, ls="--" if row == 1 else "-")
                _leftover(axes[row, column], time, measured - force, colour, noise)
            axes[0, column].set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            axes[-1, column].set_xlabel("time (s)")
        axes[0, 0].set_ylabel("force (N)")
        for row, (label, _) in enumerate(models.values(), start=1):
            axes[row, 0].set_ylabel("measured less\nmodel (N)", fontsize=8)
            axes[row, 0].set_title(label, loc="left", fontsize=8)
        largest = max(float(np.abs(line.get_ydata()).max()) for a in axes[1:].flat for line in a.lines[:1])
        for axis in axes[1:].flat:  # the same scale, so that the eye compares
            axis.set_ylim(-1.08 * largest, 1.08 * largest)
        axes[0, 0].legend(fontsize=8)
        headline(figure, f"{specimen}: {_headline(result)}", 10)
    return figure


def _leftover(axis: Axes, time: Any, error: Any, colour: str, noise: float) -> None:
    axis.plot(time, error, color=colour, lw=0.6)
    axis.axhspan(-2 * noise, 2 * noise, color="0.85", lw=0, zorder=0)
    axis.axhline(0.0, color="black", lw=0.5)


def _headline(result: DiscoverResult) -> str:
    closed = ""
    if (found := gap_of(result)) is not None:
        gap = found[1]
        closed = f"; held-out error {gap.before:.2f} to {gap.after:.2f} times the noise (floor {gap.floor:.2f})"
    return f"{result.headline}{closed}. Grey: twice the noise"


def cell_map(result: DiscoverResult) -> Figure:
    """Rows: specimens, before and (with the best effects) after; columns: cells; dots: beyond chance.

    Where more than the force is compared, each quantity has rows of its own.
    """
    rows = rows_of(result, "model as it is")
    labels = list(dict.fromkeys(_label(cell) for _, cells in rows for cell in cells))
    norm = TwoSlopeNorm(0.0, -FAR, FAR)
    with plt.rc_context(STYLE):
        size = (min(24.0, max(7.5, 2.5 + 0.16 * len(labels))), 2.1 + 0.34 * len(rows))  # the title needs the width
        figure, axis = plt.subplots(figsize=size, layout="constrained")
        shown = np.full((len(rows), len(labels)), np.nan)
        for i, (_, cells) in enumerate(rows):
            for cell in cells:
                j = labels.index(_label(cell))
                shown[i, j] = np.clip(cell.z, -FAR, FAR)
                if cell.beyond_chance:
                    axis.plot(j, i, ".", color="black", ms=3)
        image = axis.imshow(shown, cmap="RdBu_r", norm=norm, aspect="auto", interpolation="nearest")
        axis.set_yticks(range(len(rows)), [name for name, _ in rows])
        axis.set_xticks(range(len(labels)), labels, rotation=90, fontsize=6)
        figure.colorbar(image, ax=axis, fraction=0.03, pad=0.01)
        caption = "Misfit by cell, in units of chance; red: measured above the model, blue: below; dots: beyond chance"
        headline(figure, f"{result.headline}\n{caption}")
    return figure


def left_of_quantities(kept: xr.Dataset, result: DiscoverResult, specimen: str) -> Figure:
    """A row for each quantity beside the force, a column for each protocol: what both models leave, in noise."""
    every = leftovers(kept, result, specimen)
    shown = dict(list(every.items())[:MOST_ROWS])
    protocols = list(next(iter(shown.values())))
    labels = {"bare": "the model as it is", "having": f"with {result.shown_name}"}
    with plt.rc_context(STYLE):
        size = (3.6 * len(protocols), 1.3 + 0.55 * len(shown))
        figure, axes = plt.subplots(
            len(shown), len(protocols), figsize=size, sharex="col", sharey=True, squeeze=False, layout="constrained"
        )
        for row, (quantity, parts) in enumerate(shown.items()):
            for column, (protocol, columns) in enumerate(parts.items()):
                axis = axes[row, column]
                axis.axhspan(-2.0, 2.0, color="0.88", lw=0, zorder=0)
                for order, model in enumerate(("bare", "having")):
                    if model in columns:
                        left, colour = np.clip(columns[model], -FAR_LEFT, FAR_LEFT), COLOURS[1 - order]
                        axis.plot(columns["time"], left, color=colour, lw=0.7, label=labels[model])
                axis.set_ylim(-1.05 * FAR_LEFT, 1.05 * FAR_LEFT)
                axis.set_yticks([-5, 0, 5])
                axis.tick_params(labelsize=6)
                if row == 0:
                    axis.set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            axes[row, 0].set_ylabel(quantity, fontsize=6, rotation=0, ha="right", va="center")
        for axis in axes[-1]:
            axis.set_xlabel("time (s)")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2, fontsize=8)
        more = "" if len(shown) == len(every) else f" (the first {len(shown)} of {len(every)})"
        headline(figure, f"{specimen}: measured less model, in units of the noise, beside the force{more}", 10)
    return figure


def _label(cell: CellMisfit) -> str:
    return f"{cell.protocol.replace('_', ' ')}: {cell.phase} {cell.number}"


FIGURES: Mapping[str, FigureKind[DiscoverResult]] = {
    "cells": FigureKind(lambda result, *_: cell_map(result)),
    "curves": FigureKind(
        lambda result, folder, specimen: before_and_after(
            open_store(folder).read_result(f"discover/{file_name(specimen)}"), result, specimen
        ),
        lambda result: list(result.cells),
    ),
    "quantities": FigureKind(
        lambda result, folder, specimen: left_of_quantities(
            open_store(folder).read_result(f"discover/{file_name(specimen)}"), result, specimen
        ),
        lambda result: list(result.compared or {}),
    ),
    "parts": FigureKind(
        lambda result, *_: parts(result), lambda result: ["all specimens"] if result.remainder is not None else []
    ),
}
