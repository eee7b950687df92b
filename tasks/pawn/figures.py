"""Figure of PAWN indices."""

from collections.abc import Mapping
from itertools import islice

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.tasks.drawing.figures import COLOURS, PANELS, STYLE, save, symbol
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.pawn.result import PawnResult
from sinew.tasks.pawn.show import table
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: PawnResult) -> None:
    """Write the figure with its table."""
    shown = table(result).rename_axis(["objective", "parameter"]).reset_index()
    save(medians(result), workspace.out / "figures", "pawn", shown)


def medians(result: PawnResult) -> Figure:
    """The median index of each parameter with its interval, for the total objective and each protocol."""
    shown = dict(islice(result.panels().items(), PANELS))
    at = np.arange(len(result.names))
    with plt.rc_context(STYLE):
        size = (2.0 * len(shown) + 1.2, 0.2 * at.size + 1.4)
        figure, axes = plt.subplots(1, len(shown), figsize=size, sharey=True, squeeze=False)
        for axis, (title, found) in zip(axes[0], shown.items(), strict=True):
            errors = np.stack([found.median - found.median_low, found.median_high - found.median])
            axis.errorbar(found.median, at, xerr=errors, fmt="o", ms=4, lw=1, color=COLOURS[0])
            axis.axvline(found.no_influence, color=COLOURS[1], lw=1, ls="--", label="no influence")
            axis.set_xlim(left=0)
            axis.set_xlabel("median PAWN index")
            axis.set_title(title.replace("_", " "), loc="left", fontsize=9)
        axes[0, 0].set_yticks(at, [symbol(name) for name in result.names])
        axes[0, 0].invert_yaxis()
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower right", fontsize=8)
    return figure


FIGURES: Mapping[str, FigureKind[PawnResult]] = {"medians": FigureKind(lambda result, *_: medians(result))}
