"""Figures of an inference by likelihood: populations of all sites, and the specimens of each."""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.tasks.drawing.blocks import with_its_unit
from sinew.tasks.drawing.figures import COLOURS, STYLE, headline, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.infer.likelihood.result import LikelihoodResult
from sinew.tasks.infer.likelihood.show import table
from sinew.tasks.study.workspace import Workspace

COLUMNS = 4


def draw(workspace: Workspace, result: LikelihoodResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    save(populations(result), folder, "infer_populations", table(result).reset_index())
    for site in result.sites:
        save(specimens(result, site), folder, f"infer_{site}_specimens", _specimens_table(result, site))


def _specimens_table(result: LikelihoodResult, site: str) -> pd.DataFrame:
    rows = [
        {"specimen": specimen, "parameter": name, "mean": each.mean, "sd": each.sd, "low": each.low, "high": each.high,
         "determined": each.determined}
        for specimen in result.sites[site].specimens
        for name, each in result.specimens[specimen].items()
    ]  # fmt: skip
    return pd.DataFrame(rows)


def populations(result: LikelihoodResult) -> Figure:
    """Mean of each site's population with its interval (thick), and one spread to either side (thin)."""
    sites = list(result.sites)

    def panel(axis: Any, name: str) -> None:
        for k, site in enumerate(sites):
            each = result.sites[site].population[name]
            colour = COLOURS[k % len(COLOURS)]
            axis.plot([each.mean - each.spread, each.mean + each.spread], [k, k], color=colour, lw=0.8)
            axis.plot([each.low, each.high], [k, k], color=colour, lw=4, solid_capstyle="butt", alpha=0.6)
            axis.plot(each.mean, k, "o", color=colour, ms=4)
        _rows(axis, sites)

    title = "Mean of the population with its 95 % interval (thick), and the spread between specimens (thin)"
    return _panels(result, panel, title, 0.28 * len(sites) + 0.75)


def specimens(result: LikelihoodResult, site: str) -> Figure:
    """Each specimen of a site with its interval, over the interval of the population's mean."""
    members = result.sites[site].specimens

    def panel(axis: Any, name: str) -> None:
        population = result.sites[site].population[name]
        axis.axvspan(population.low, population.high, color=COLOURS[1], alpha=0.2, lw=0)
        axis.axvline(population.mean, color=COLOURS[1], lw=0.8)
        for k, specimen in enumerate(members):
            each = result.specimens[specimen][name]
            colour = COLOURS[0] if each.determined else "0.65"
            axis.plot([each.low, each.high], [k, k], color=colour, lw=1.2)
            axis.plot(each.mean, k, "o", color=colour, ms=3, mfc=colour if each.determined else "white")
        _rows(axis, [one.rpartition("/")[2] for one in members])

    title = f"{site}: specimens with 95 % intervals (grey: not determined by their own curves); shaded: population mean"
    return _panels(result, panel, title, 0.16 * len(members) + 0.75)


def _rows(axis: Any, labels: Sequence[str]) -> None:
    axis.set_yticks(range(len(labels)), labels)
    axis.set_ylim(len(labels) - 0.4, -0.6)


def _panels(result: LikelihoodResult, panel: Any, title: str, height: float) -> Figure:
    names = result.names
    rows = -(-len(names) // COLUMNS)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(rows, COLUMNS, figsize=(9, height * rows + 0.4), squeeze=False, sharey=True)
        for axis in axes.ravel()[len(names) :]:
            axis.set_axis_off()
        for axis, name, unit in zip(axes.ravel(), names, result.units, strict=False):
            panel(axis, name)
            axis.set_title(with_its_unit(symbol(name), unit), fontsize=9)
            axis.tick_params(labelsize=7)
        headline(figure, title, 10)
    return figure


FIGURES: Mapping[str, FigureKind[LikelihoodResult]] = {
    "populations": FigureKind(lambda result, folder, of: populations(result)),
    "specimens": FigureKind(lambda result, folder, of: specimens(result, of), lambda result: list(result.sites)),
}
"""Figures of a result by name, one at a time: for notebooks, and whoever wants a single one."""
