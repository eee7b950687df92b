"""Figure of random forest importance."""

from collections.abc import Mapping

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.tasks.drawing.figures import COLOURS, STYLE, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.importance.result import ImportanceResult
from sinew.tasks.importance.show import table
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: ImportanceResult) -> None:
    """Write the figure with its table."""
    shown = table(result).rename_axis(["objective", "parameter"]).reset_index()
    save(bars(result), workspace.out / "figures", "importance", shown)


def bars(result: ImportanceResult) -> Figure:
    """Impurity (percent) and permutation importance for the total objective and each protocol."""
    shown = result.panels()
    at = np.arange(len(result.names))
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
                    getattr(values, key),
                    width,
                    xerr=getattr(values, spread),
                    color=COLOURS[k % len(COLOURS)],
                    label=f"{title.replace('_', ' ')} ($R^2$ {values.r2_on_unseen:.2f})",
                    error_kw={"lw": 0.6},
                )
            axis.set_xlabel(label)
        axes[0].set_yticks(at, [symbol(name) for name in result.names])
        axes[0].invert_yaxis()
        axes[1].legend(loc="lower right", fontsize=8)
    return figure


FIGURES: Mapping[str, FigureKind[ImportanceResult]] = {"importance": FigureKind(lambda result, *_: bars(result))}
