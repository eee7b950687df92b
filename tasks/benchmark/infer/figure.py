"""Histograms of ranks: flat, within the band, where posteriors are right."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt

from sinew.tasks.drawing.figures import COLOURS, STYLE, save, symbol

WORDS = {"mean": "mean of the population", "spread": "spread of the population", "specimen": "first specimen"}


def draw(result: dict[str, Any], out: Path) -> None:
    """Write ``OUT/ranks.png``, ``.pdf`` and ``.csv``; nothing without ranks."""
    rows = result["ranks"]
    levels = list(dict.fromkeys(row["level"] for row in rows))
    names = list(dict.fromkeys(row["parameter"] for row in rows))
    if not rows:
        return
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            len(levels), len(names), figsize=(7.2, 0.5 + 1.25 * len(levels)), sharex=True, squeeze=False, sharey=True
        )
        for row in rows:
            axis = axes[levels.index(row["level"]), names.index(row["parameter"])]
            bins = len(row["counts"])
            axis.axhspan(*row["band"], color="0.88", lw=0)
            axis.axhline(sum(row["counts"]) / bins, color="0.5", lw=0.8)
            axis.bar((np.arange(bins) + 0.5) / bins, row["counts"], width=0.9 / bins, color=COLOURS[0])
            axis.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
        for axis, name in zip(axes[0], names, strict=True):
            axis.set_title(symbol(name))
        for axis, level in zip(axes[:, 0], levels, strict=True):
            axis.set_ylabel(WORDS[level].replace(" of", "\nof"), fontsize=8)
        figure.supxlabel("rank of the truth among the draws (grey: 99 % of counts if posteriors are right)", fontsize=9)
    save(figure, out, "ranks", _table(rows))


def _table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    return pd.DataFrame(
        {"level": row["level"], "parameter": row["parameter"], "bin": j / len(row["counts"]), "count": count}
        for row in rows
        for j, count in enumerate(row["counts"])
    )
