"""What the tests of a new study look like: force over displacement, coloured by phase, to be checked at a glance."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.phases import phases

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_TESTS, IN_A_ROW = 24, 3
LONGEST_NAME = 32  # characters that fit above a plot
NARROWEST = 3.2  # inches, in which the legend fits
MOST_POINTS = 20_000  # drawn of a test; a figure has fewer pixels
KINDS = ("load", "unload", "hold")


def draw_overview(path: Path, specimens: Sequence[Specimen]) -> int:
    """Draw the first ``MOST_TESTS`` tests into a PNG file; returns how many were drawn."""
    from matplotlib import pyplot as plt  # takes long to import
    from matplotlib.lines import Line2D

    from sinew.tasks.drawing.figures import COLOURS, STYLE

    tests = [(one, curve) for one in specimens for curve in one.curves][:MOST_TESTS]
    across = min(len(tests), IN_A_ROW)
    down = math.ceil(len(tests) / across)
    colours = dict(zip(KINDS, COLOURS, strict=False))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(
            down, across, figsize=(max(2.4 * across, NARROWEST), 2.0 * down + 0.4), squeeze=False
        )
        for (one, curve), place in zip(tests, axes.flat, strict=False):
            _draw(place, curve, colours)
            place.set_title(f"{_short(one.name)}\n{_short(curve.name)}".replace("$", r"\$"), fontsize=7)
        for place in axes.flat[len(tests) :]:
            place.set_visible(False)
        figure.supxlabel("displacement (mm)", fontsize=9)
        figure.supylabel("force (N)", fontsize=9)
        lines = [Line2D([], [], color=colours[kind], label=kind) for kind in KINDS]
        figure.legend(handles=lines, loc="outside upper center", ncols=len(KINDS), fontsize=8, handlelength=1.5)
        drawn = path.with_name(f".{path.name}.{os.getpid()}")
        figure.savefig(drawn, dpi=150, format="png", metadata={"Software": None})
        os.replace(drawn, path)
        plt.close(figure)
    return len(tests)


def _short(name: str) -> str:
    """The end of a long name, which tells specimens of one folder apart."""
    return name if len(name) <= LONGEST_NAME else f"…{name[1 - LONGEST_NAME :]}"


def _draw(place: "Axes", curve: Curve, colours: dict[str, str]) -> None:
    step = max(1, curve.force_N.size // MOST_POINTS)
    for phase in phases(curve.protocol):
        points = slice(phase.start, phase.stop, step)
        moved, force = curve.protocol.displacement_mm[points], curve.force_N[points]
        place.plot(moved, force, color=colours[phase.kind], linewidth=0.9)
