"""Figures and words of a discovery: the verdict, the candidates, curves and cells before and after."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as Grid

from tasks.discover.confidence import in_words
from tasks.model import file_name
from tasks.report import tables
from tasks.report.figures import COLOURS, STYLE, save
from tasks.workspace import Workspace

SHOWN = 6  # candidates
UNLIKELY = 0.001  # a conflict that is told
FAR = 12.0  # units of chance, where colours end


def draw(workspace: Workspace, result: dict[str, Any]) -> None:
    """All figures of ``discover.json`` and its store results."""
    folder = workspace.out / "figures"
    save(cell_map(result), folder, "discover_cells", tables.cells(result))
    for specimen in result["cells"]:
        kept = workspace.store.read_result(f"discover/{file_name(specimen)}")
        figure = before_and_after(kept, result, specimen)
        save(figure, folder, f"discover_{file_name(specimen)}", tables.curves(kept))


def tell(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    """The verdict, and how the best candidates did."""
    grid = Grid("candidate", "gain", "explained", "held-out gain", "on a bound", title="Candidates, the best first")
    for one in result["candidates"][:SHOWN]:
        held = "" if one["held_out"] is None else f"{one['held_out']:,.0f} ± {one['held_out_error']:,.0f}"
        explained = "" if one["explained"] is None else f"{100 * one['explained']:.0f} %"
        grid.add_row(" + ".join(one["effects"]), f"{one['gain']:,.0f}", explained, held, " ".join(one["on_bound"]))
    console.print(grid)
    what = " + ".join(result["effects"]) or " or ".join(result["set"])
    console.print(f"[bold]{result['verdict']}[/bold] {what}: {result['why']}")
    if told := result.get("confidence"):
        console.print(in_words(told))
    gap = result["gap"]
    if gap["closed"] is not None:
        console.print(
            f"held-out error in units of noise: {gap['before']:.2f} without, {gap['after']:.2f} with "
            f"{' + '.join(result['shown'])} (a true model: {gap['floor']:.2f}); gap closed: {gap['closed']:.2f}"
        )
    conflict = result["conflict"]
    if conflict["p"] < UNLIKELY:
        worst = max(result["conflict"]["specimens"].values(), key=lambda one: one["statistic"])["apart"][0]
        console.print(
            f"the protocols want different parameters ({unlikely(conflict['p'])}): most of all {worst['parameter']}, "
            f"{worst['values'][0]:.4g} in {worst['curves'][0]}, {worst['values'][1]:.4g} in {worst['curves'][1]}",
            markup=False,
        )
    if result["outside"]:
        outside = result["outside"]
        nearest = outside["similar"][0]
        console.print(f"what is left looks most like {nearest['effect']} (cosine {nearest['cosine']:.2f} of at most "
                      f"{outside['largest_cosine']:.2f}); a description, no mechanism:", markup=False)  # fmt: skip
        for specimen, told in zip(result["cells"], outside["corrections"], strict=False):
            console.print(f"  {specimen}: {told['sentence']}", markup=False)
    experiment = result["next_experiment"]
    if experiment:
        console.print(
            f"what would tell: {experiment['name']} ({experiment['words']}); then the wrong one is off by up to "
            f"{experiment['newtons']:.1f} N, {experiment['at_s']:.0f} s into the test", markup=False
        )  # fmt: skip
    if result["model"]:
        console.print(f"the study with it: {workspace.out / result['model']['path']}\n{result['model']['difference']}",
                      markup=False)  # fmt: skip


def unlikely(p: float) -> str:
    """A probability that may be too small for a number of the machine."""
    return f"p {p:.1g}" if p > 0.0 else "p below 1e-300"


def before_and_after(kept: xr.Dataset, result: dict[str, Any], specimen: str) -> Figure:
    """A column for each protocol: forces, what the model as it is leaves, what the model with the effects leaves."""
    protocols = list(dict.fromkeys(cell["protocol"] for cell in result["cells"][specimen]))
    effects = " + ".join(result["shown"])
    models = {"bare": ("the model as it is", COLOURS[1])}
    if effects:
        models["having"] = (f"with {effects}", COLOURS[0])
    noise = result["noise"][specimen]["sd_N"]
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
            axes[0, column].plot(time, measured, color="0.6", lw=2.4, label="measured")
            for row, (name, (label, colour)) in enumerate(models.items(), start=1):
                force = kept[f"{name}_{protocol}"].to_numpy()
                axes[0, column].plot(time, force, color=colour, lw=0.9, label=label, ls="--" if row == 1 else "-")
                _leftover(axes[row, column], time, measured - force, colour, noise)
            axes[0, column].set_title(protocol.replace("_", " "), loc="left", fontsize=9)
            axes[-1, column].set_xlabel("time (s)")
        axes[0, 0].set_ylabel("force (N)")
        for row, (label, _) in enumerate(models.values(), start=1):
            axes[row, 0].set_ylabel(f"measured less\n{label} (N)")
        largest = max(float(np.abs(line.get_ydata()).max()) for a in axes[1:].flat for line in a.lines[:1])
        for axis in axes[1:].flat:  # the same scale, so that the eye compares
            axis.set_ylim(-1.08 * largest, 1.08 * largest)
        axes[0, 0].legend(fontsize=8)
        figure.suptitle(f"{specimen}: {_headline(result)}", x=0.01, ha="left")
    return figure


def _leftover(axis: Axes, time: Any, error: Any, colour: str, noise: float) -> None:
    axis.plot(time, error, color=colour, lw=0.6)
    axis.axhspan(-2 * noise, 2 * noise, color="0.85", lw=0, zorder=0)
    axis.axhline(0.0, color="black", lw=0.5)


def _headline(result: dict[str, Any]) -> str:
    what = " + ".join(result["effects"]) or " or ".join(result["set"])
    gap = result["gap"]
    closed = ""
    if gap["closed"] is not None:
        closed = (
            f"; held-out error {gap['before']:.2f} to {gap['after']:.2f} times the noise (floor {gap['floor']:.2f})"
        )
    return f"{result['verdict']} {what}".strip() + closed + ". Grey: twice the noise"


def cell_map(result: dict[str, Any]) -> Figure:
    """Rows: specimens, before and (with the best effects) after; columns: cells; dots: beyond chance."""
    rows = [(f"{name}, model as it is", cells) for name, cells in result["cells"].items()]
    effects = " + ".join(result["shown"])
    rows += [(f"{name}, with {effects}", cells) for name, cells in result.get("after", {}).items()]
    labels = list(dict.fromkeys(_label(cell) for _, cells in rows for cell in cells))
    norm = TwoSlopeNorm(0.0, -FAR, FAR)
    with plt.rc_context(STYLE):
        size = (min(24.0, max(7.5, 2.5 + 0.16 * len(labels))), 2.1 + 0.34 * len(rows))  # the title needs the width
        figure, axis = plt.subplots(figsize=size, layout="constrained")
        shown = np.full((len(rows), len(labels)), np.nan)
        for i, (_, cells) in enumerate(rows):
            for cell in cells:
                j = labels.index(_label(cell))
                shown[i, j] = np.clip(cell["z"], -FAR, FAR)
                if abs(cell["z"]) > cell["limit"]:
                    axis.plot(j, i, ".", color="black", ms=3)
        image = axis.imshow(shown, cmap="RdBu_r", norm=norm, aspect="auto", interpolation="nearest")
        axis.set_yticks(range(len(rows)), [name for name, _ in rows])
        axis.set_xticks(range(len(labels)), labels, rotation=90, fontsize=6)
        figure.colorbar(image, ax=axis, fraction=0.03, pad=0.01)
        what = " + ".join(result["effects"]) or " or ".join(result["set"])
        what = f"{result['verdict']} {what}".strip()
        told = "Misfit of each cell in units of chance: measured above (red) or below (blue) the model; dots: beyond it"
        figure.suptitle(f"{what}\n{told}", x=0.01, ha="left", fontsize="medium")
    return figure


def _label(cell: dict[str, Any]) -> str:
    return f"{cell['protocol'].replace('_', ' ')}: {cell['phase']} {cell['number']}"
