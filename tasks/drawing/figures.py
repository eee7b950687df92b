"""The style of all figures, in the colours of Okabe and Ito (2008) that colour-blind readers tell apart."""

import os
import textwrap
from pathlib import Path
from typing import Any

import matplotlib
import pandas as pd
from cycler import cycler

if "inline" not in os.environ.get("MPLBACKEND", ""):  # a notebook shows figures by its own, which draws as Agg does
    matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.runner.files import new_file
from sinew.tasks.drawing.formats import FORMATS, without_formulas

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442", "#000000")
MEASURED = "0.6"  # of curves that were measured, beside those of a model
WIDTH_OF_A_LETTER = 0.6  # in sizes of the font, on the average and a little more
_LABELS = {"E": "E", "alpha": r"\alpha", "g": "g", "tau": r"\tau", "nu": r"\nu"}
PANELS = 40  # of a figure; its table has all
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(color=COLOURS),
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def symbol(name: str) -> str:
    """``tau_1f`` as a formula; of names that are none of sinew's, as they are."""
    stem, line, index = name.partition("_")
    if stem not in _LABELS or (line and not index.isalnum()):
        return name.replace("$", r"\$")
    return rf"${_LABELS[stem]}_{{{index}}}$" if line else f"${_LABELS[stem]}$"


def headline(figure: Figure, text: str, size: float = 9) -> None:
    """Write ``text`` above a figure, from its left edge, in as many lines as it needs; ``size`` is in points."""
    letters = int(72 * figure.get_figwidth() / (WIDTH_OF_A_LETTER * size))
    lines = [
        part for line in text.splitlines() for part in textwrap.wrap(line, letters, break_on_hyphens=False) or [""]
    ]
    figure.suptitle("\n".join(lines), x=0.01, ha="left", fontsize=size)


def save(figure: Figure, folder: Path, name: str, shown: pd.DataFrame) -> list[Path]:
    """Write ``FOLDER/NAME.png``, ``.pdf`` and, with the numbers that are ``shown``, ``.csv``.

    Both drawings have the same layout: to find it takes as long as to draw. Equal figures give equal bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    png, pdf, csv = (folder / f"{name}.{kind}" for kind in FORMATS)
    with new_file(png) as file:
        figure.savefig(file, format="png", dpi=150, metadata={"Software": None})
    figure.set_layout_engine("none")
    with new_file(pdf) as file:
        figure.savefig(file, format="pdf", metadata={"CreationDate": None, "Producer": None})
    plt.close(figure)
    with new_file(csv) as file:
        without_formulas(shown).to_csv(file, index=False, lineterminator="\n", float_format="%.8g")
    return [png, pdf, csv]
