"""Draw ``docs/discover.png``, the picture of the README, from what ``make demo`` leaves in ``results/hidden``."""

from pathlib import Path

import matplotlib as mpl
import pandas as pd
from matplotlib import pyplot as plt
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
CURVES = ROOT / "results" / "hidden" / "figures" / "discover_distal_1.csv"
COLUMNS = ["time_s", "measured_N", "as_it_is_N", "with_effects_N"]
BEFORE, AFTER = "#D55E00", "#0072B2"
WIDTH_MM, HEIGHT_MM = 85, 82  # one column of a journal
STYLE = {
    "font.size": 7,
    "axes.titlesize": 7,
    "legend.fontsize": 6.5,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
}


def draw(curves: pd.DataFrame) -> plt.Figure:
    """Measured and fitted forces above the residuals of both models, for two of the three protocols."""
    figure, axes = plt.subplots(
        2, 2, figsize=(WIDTH_MM / 25.4, HEIGHT_MM / 25.4), sharex="col", sharey="row", layout="constrained"
    )
    for (above, below), (protocol, title) in zip(
        axes.T, (("cyclic", "cyclic test"), ("two_step", "two relaxation steps")), strict=True
    ):
        curve = curves[curves["protocol"] == protocol]
        time_s, measured, before, after = (curve[name].to_numpy() for name in COLUMNS)
        above.plot(time_s, measured, color="0.65", lw=2.2, label="measured")
        above.plot(time_s, before, "--", color=BEFORE, lw=0.8, label="baseline model")
        above.plot(time_s, after, color=AFTER, lw=0.8, label="with slack fibres")
        below.plot(time_s, measured - before, color=BEFORE, lw=0.6)
        below.plot(time_s, measured - after, color=AFTER, lw=0.6)
        above.set_title(title, loc="left")
        below.set_xlabel("time (s)")
    axes[0, 0].set_ylabel("force (N)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    axes[1, 0].set_ylabel("measured less model (N)")
    return figure


if __name__ == "__main__":
    path = ROOT / "docs" / "discover.png"
    with mpl.rc_context(STYLE):
        draw(pd.read_csv(CURVES)).savefig(path, dpi=300)
    with Image.open(path) as image:
        image.convert("RGB").quantize(64).save(path, optimize=True)  # a third of the size
