"""Figure and words of a discovery: the verdict, the candidates, and the map of cells before and after."""

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as Grid

from tasks.report.figures import STYLE, save
from tasks.workspace import Workspace

SHOWN = 6  # candidates
FAR = 12.0  # units of chance, where colours end


def draw(workspace: Workspace, result: dict[str, Any]) -> None:
    """All figures of ``discover.json``."""
    save(cell_map(result), workspace.out / "figures", "discover_cells")


def tell(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    """The verdict, and how the best candidates did."""
    grid = Grid("candidate", "gain", "explained", "held-out gain", "on a bound", title="Candidates, the best first")
    for one in result["candidates"][:SHOWN]:
        held = "" if one["held_out"] is None else f"{one['held_out']:,.0f} ± {one['held_out_error']:,.0f}"
        explained = f"{100 * one['explained']:.0f} %"
        grid.add_row(" + ".join(one["effects"]), f"{one['gain']:,.0f}", explained, held, " ".join(one["on_bound"]))
    console.print(grid)
    what = " + ".join(result["effects"]) or " or ".join(result["set"])
    console.print(f"[bold]{result['verdict']}[/bold] {what}: {result['why']}")
    gap = result["gap"]
    if gap["closed"] is not None:
        console.print(
            f"held-out error in units of noise: {gap['before']:.2f} without, {gap['after']:.2f} with "
            f"{' + '.join(result['candidates'][0]['effects'])} (noise alone: 1); gap closed: {gap['closed']:.2f}"
        )
    if result["model"]:
        console.print(f"the study with it: {workspace.out / result['model']['path']}\n{result['model']['difference']}",
                      markup=False)  # fmt: skip


def cell_map(result: dict[str, Any]) -> Figure:
    """Rows: specimens, before and (when an effect is named) after; columns: cells; dots: beyond chance."""
    rows = [(f"{name}, model as it is", cells) for name, cells in result["cells"].items()]
    effects = " + ".join(result["effects"])
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
        what = f"{result['verdict']} {effects or ' or '.join(result['set'])}".strip()
        told = "Misfit of each cell in units of chance: measured above (red) or below (blue) the model; dots: beyond it"
        figure.suptitle(f"{what}\n{told}", x=0.01, ha="left", fontsize="medium")
    return figure


def _label(cell: dict[str, Any]) -> str:
    return f"{cell['protocol'].replace('_', ' ')}: {cell['phase']} {cell['number']}"
