"""Figure of the correlations between the calibrated parameters of a cohort (8 in Pekedis 2025)."""

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sinew.tasks.calibrate.panels import ROOMY
from sinew.tasks.calibrate.result import Correlations
from sinew.tasks.drawing.figures import STYLE, symbol


def correlation_matrix(found: Correlations) -> Figure:
    """Repeated-measures correlations of :func:`sinew.tasks.calibrate.correlations.correlations` (figure 8)."""
    names = found.names
    size = max(4.5, 0.52 * len(names) + 1.6)
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(size + 0.6, size))
        level = np.full((len(names), len(names)), np.nan)
        for pair in found.pairs:
            row, column = sorted((names.index(name) for name in pair.parameters), reverse=True)
            corner = (column - 0.5, row - 0.5)
            if pair.r is None or pair.p is None or pair.p_holm is None:
                axis.add_patch(Rectangle(corner, 1, 1, color="0.9", lw=0))
                continue
            level[row, column] = pair.r
            stars = "**" if pair.p_holm < 0.05 else "*" if pair.p < 0.05 else ""
            shade = "white" if abs(pair.r) > 0.6 else "black"
            axis.text(column, row, f"{pair.r:.2f}\n{stars}".rstrip(), ha="center", va="center", size=7, color=shade)
            if not pair.determined:
                axis.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="////", ec="0.45", lw=0, alpha=0.6))
        image = axis.imshow(level, cmap="RdBu_r", vmin=-1, vmax=1)
        axis.set_xticks(range(len(names) - 1), [symbol(name) for name in names[:-1]])
        axis.set_yticks(range(1, len(names)), [symbol(name) for name in names[1:]])
        axis.set_ylim(len(names) - 0.5, 0.5)
        axis.set_xlim(-0.5, len(names) - 1.5)
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.colorbar(image, ax=axis, shrink=0.7, label="correlation $r$")
        notes = [
            f"{len(found.donors)} donors, {found.specimens} specimens of {len(found.sites)} sites",
            "*  p < 0.05",
            f"**  p < 0.05 adjusted for {found.tests} pairs (Holm)",
            "hatched: not determined in most specimens",
            "grey: does not vary within donors",
        ]
        if len(names) > ROOMY:
            axis.text(1, 1, "\n".join(notes), transform=axis.transAxes, ha="right", va="top", linespacing=1.5)
        else:
            axis.set_title("\n".join(notes), loc="left", fontsize=8)
    return figure
