"""Figure of a comparison of sites: ROC curves and kernel densities of the first component (13 in Pekedis 2025)."""

from typing import Any

from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table as Grid

from tasks.report import tables
from tasks.report.figures import COLOURS, STYLE, save, symbol
from tasks.sites import FEW
from tasks.workspace import Workspace

_LINES = ("-", "--", "-.", ":")


def draw(workspace: Workspace, result: dict[str, Any]) -> None:
    """The figure of ``compare.json``."""
    save(separation(result), workspace.out / "figures", "compare", tables.separation(result))


def tell(workspace: Workspace, result: dict[str, Any], console: Console) -> None:
    """Areas under the ROC curves by pair of sites."""
    percent = round(100 * result["confidence"])
    columns = (f"AUC of the component ({percent} %)", f"of all parameters, unseen ({percent} %)", "p")
    grid = Grid("sites", *columns, title="How well posteriors can be told apart (0.5: not at all)")
    for pair in result["pairs"]:
        every = pair["all_parameters"]
        p = every["p_value"]
        grid.add_row(" / ".join(pair["sites"]), _area(pair), _area(every), "" if p is None else f"{p:.3f}")
    console.print(grid)
    for site, told in result["sites"].items():
        if told["effective_sample_size"] < FEW:
            console.print(
                f"[red]{site}: {told['particles']} particles are worth {told['effective_sample_size']:.1f} of equal "
                f"weight[/red], which says little of a posterior: infer with a larger population"
            )
    part = 100 * result["component"]["explained_variance"]
    console.print(f"the component has {part:.0f} % of the variance; {result['note']}")


def separation(result: dict[str, Any]) -> Figure:
    """ROC curves by pair, densities by site, and what the component is made of."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), width_ratios=(1, 1.2, 0.9))
        roc, density, loadings = axes
        roc.plot([0, 1], [0, 1], color="0.6", lw=0.8, ls=":")
        for number, pair in enumerate(result["pairs"]):
            label = f"{' / '.join(pair['sites'])}: {_area(pair)}"
            curve = pair["roc"]
            style = {"ls": _LINES[number % len(_LINES)], "color": COLOURS[(number + 3) % len(COLOURS)]}
            roc.plot(curve["false_positive"], curve["true_positive"], lw=1.3, label=label, **style)
        roc.set_aspect("equal", adjustable="box", anchor="N")
        roc.set_xlabel("part of the first site above the threshold")
        roc.set_ylabel("part of the second site above it")
        roc.set_title(f"ROC, AUC with {round(100 * result['confidence'])} % interval", loc="left", fontsize=9)
        roc.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), fontsize=8)
        grid = result["densities"]["component"]
        for number, (site, values) in enumerate(result["densities"]["sites"].items()):
            if values is not None:
                style = {"ls": _LINES[number % len(_LINES)], "color": COLOURS[number % len(COLOURS)]}
                density.fill_between(grid, values, color=style["color"], alpha=0.12, lw=0)
                density.plot(grid, values, label=site, lw=1.3, **style)
        density.set_ylim(bottom=0)
        density.set_xlabel("first principal component (1)")
        density.set_ylabel("density (1)")
        density.set_title("posteriors along the component", loc="left", fontsize=9)
        if density.lines:
            density.legend()
        named = result["component"]["loadings"]
        loadings.barh(range(len(named)), list(named.values()), color="0.5")
        loadings.set_yticks(range(len(named)), [symbol(name) for name in named])
        loadings.invert_yaxis()
        loadings.axvline(0, color="black", lw=0.6)
        loadings.set_xlabel("loading (1)")
        part = 100 * result["component"]["explained_variance"]
        loadings.set_title(f"its loadings; {part:.0f} % of the variance", loc="left", fontsize=9)
    return figure


def _area(told: dict[str, Any]) -> str:
    low, high = told["interval"]
    return f"{told['auc']:.2f} ({low:.2f}, {high:.2f})"
