"""Figure of a comparison of sites: ROC curves, densities and loadings of the first component (13 in Pekedis 2025)."""

from collections.abc import Mapping

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sinew.tasks.compare.result import CompareResult
from sinew.tasks.compare.show import area_text, separation_table
from sinew.tasks.drawing.figures import COLOURS, STYLE, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.study.workspace import Workspace

LINES = ("-", "--", "-.", ":")


def draw(workspace: Workspace, result: CompareResult) -> None:
    """Write the figure with its table."""
    save(separation(result), workspace.out / "figures", "compare", separation_table(result))


def separation(result: CompareResult) -> Figure:
    """ROC curves by pair, densities by site, and the loadings of the component."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), width_ratios=(1, 1.2, 0.9))
        _roc(axes[0], result)
        _densities(axes[1], result)
        _loadings(axes[2], result)
    return figure


def _roc(axis: Axes, result: CompareResult) -> None:
    axis.plot([0, 1], [0, 1], color="0.6", lw=0.8, ls=":")
    for number, pair in enumerate(result.pairs):
        label = f"{pair.name}: {area_text(pair)}"
        line, colour = LINES[number % len(LINES)], COLOURS[(number + 3) % len(COLOURS)]
        axis.plot(pair.roc.false_positive, pair.roc.true_positive, lw=1.3, label=label, ls=line, color=colour)
    axis.set_aspect("equal", adjustable="box", anchor="N")
    axis.set_xlabel("part of the first site above the threshold")
    axis.set_ylabel("part of the second site above it")
    axis.set_title(f"ROC, AUC with {round(100 * result.confidence)} % interval", loc="left", fontsize=9)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=8)


def _densities(axis: Axes, result: CompareResult) -> None:
    along = result.densities.component
    for site, (number, values) in result.densities.shown().items():
        line, colour = LINES[number % len(LINES)], COLOURS[number % len(COLOURS)]
        axis.fill_between(along, values, color=colour, alpha=0.12, lw=0)
        axis.plot(along, values, label=site, lw=1.3, ls=line, color=colour)
    axis.set_ylim(bottom=0)
    axis.set_xlabel("first principal component (1)")
    axis.set_ylabel("density (1)")
    axis.set_title("posteriors along the component", loc="left", fontsize=9)
    if axis.lines:
        axis.legend()


def _loadings(axis: Axes, result: CompareResult) -> None:
    loadings = result.component.loadings
    axis.barh(range(len(loadings)), list(loadings.values()), color="0.5")
    axis.set_yticks(range(len(loadings)), [symbol(name) for name in loadings])
    axis.invert_yaxis()
    axis.axvline(0, color="black", lw=0.6)
    axis.set_xlabel("loading (1)")
    share = 100 * result.component.explained_variance
    axis.set_title(f"its loadings; {share:.0f} % of the variance", loc="left", fontsize=9)


FIGURES: Mapping[str, FigureKind[CompareResult]] = {"sites": FigureKind(lambda result, *_: separation(result))}
