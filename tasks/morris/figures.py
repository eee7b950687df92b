"""Figure of elementary effects."""

from collections.abc import Mapping

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.tasks.drawing.figures import COLOURS, STYLE, headline, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.morris.result import MorrisResult
from sinew.tasks.morris.show import table
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: MorrisResult) -> None:
    """Write the figure with its table."""
    save(effects(result), workspace.out / "figures", "morris", table(result).reset_index())


def effects(result: MorrisResult) -> Figure:
    """Left: the mean absolute effect of each parameter; right: it against sigma, which shows interactions."""
    order = np.argsort(result.mu_star)
    at = np.arange(len(result.names))
    with plt.rc_context(STYLE):
        figure, (bars, plane) = plt.subplots(1, 2, figsize=(7.5, 0.22 * len(at) + 1.8), width_ratios=(1, 1.1))
        stars, errors = result.mu_star[order], result.mu_star_conf[order]
        bars.barh(at, stars, xerr=errors, color=COLOURS[0], error_kw={"lw": 0.8})
        bars.set_yticks(at, [symbol(result.names[j]) for j in order])
        bars.set_xlabel(rf"mean absolute effect $\mu^*$ ({result.unit})")
        plane.scatter(result.mu_star, result.sigma, color=COLOURS[1], s=16)
        end = 1.08 * float(max(result.mu_star.max(), result.sigma.max()))
        plane.plot([0, end], [0, end], color="0.6", lw=0.8, ls=":")
        for j in order[-6:]:
            at_point = (result.mu_star[j], result.sigma[j])
            plane.annotate(symbol(result.names[j]), at_point, xytext=(4, 3), textcoords="offset points", fontsize=8)
        plane.set_xlim(0, end)
        plane.set_ylim(0, end)
        plane.set_xlabel(rf"mean absolute effect $\mu^*$ ({result.unit})")
        plane.set_ylabel(rf"standard deviation $\sigma$ ({result.unit})")
        percent = round(100 * result.confidence)
        count = f"{result.trajectories_used:,} trajectories; bars: {percent} % interval"
        headline(figure, f"Effects on the {result.objective}\n{count}")
    return figure


FIGURES: Mapping[str, FigureKind[MorrisResult]] = {"effects": FigureKind(lambda result, *_: effects(result))}
