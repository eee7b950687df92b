"""Figure of emulators."""

from collections.abc import Mapping

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from sinew.tasks.drawing.figures import COLOURS, STYLE, save
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.study.workspace import Workspace
from sinew.tasks.surrogate.result import SurrogateResult
from sinew.tasks.surrogate.show import table

TICKS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)  # within a decade
NAMED = 6  # specimens with an entry of the legend


def draw(workspace: Workspace, result: SurrogateResult) -> None:
    """Write the figure with its table."""
    save(errors(result), workspace.out / "figures", "surrogate", table(result).reset_index())


def errors(result: SurrogateResult) -> Figure:
    """Left: the largest error of each specimen as runs are added; right: left-out and fresh errors of each course."""
    with plt.rc_context(STYLE):
        figure, (growth, courses) = plt.subplots(1, 2, figsize=(7.5, 3.0))
        for number, (name, one) in enumerate(result.specimens.items()):
            colour = COLOURS[number % len(COLOURS)]
            label = name if len(result.specimens) <= NAMED else None
            growth.plot(one.sizes, 100 * np.maximum(one.errors, 1e-9), "o-", ms=4, lw=1, color=colour, label=label)
            both = np.array([(course.error, course.fresh_error) for course in one.courses.values()])
            courses.plot(*(100 * both).T, "o", ms=4, color=colour)
        growth.axhline(100 * result.asked, color="0.5", lw=1, ls="--", label="asked")
        growth.set_yscale("log")
        growth.yaxis.set_major_locator(LogLocator(subs=TICKS))
        growth.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        growth.yaxis.set_minor_formatter(NullFormatter())
        growth.set_xlabel("runs of a specimen")
        growth.set_ylabel("largest error (% of the spread)")
        growth.legend(fontsize=8)
        ends = np.array([courses.get_xlim(), courses.get_ylim()])
        end = max(float(ends.max()), 100 * result.asked)
        courses.plot([0, end], [0, end], color="0.6", lw=0.8, ls=":")
        courses.set_xlim(0, end)
        courses.set_ylim(0, end)
        courses.set_xlabel("error of left-out runs (% of the spread)")
        courses.set_ylabel("error of fresh runs (% of the spread)")
    return figure


FIGURES: Mapping[str, FigureKind[SurrogateResult]] = {"errors": FigureKind(lambda result, *_: errors(result))}
