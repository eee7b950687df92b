"""Distributions: PAWN indices, from the rows of the sensitivity study."""

from typing import Any

import numpy as np

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plot, Section, listed, percent
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.pawn.result import Pawn, PawnResult
from sinew.tasks.report.folder import ResultFolder

NAME = "distributions"


def section(folder: ResultFolder) -> Section:
    """Everything of ``pawn.json``."""
    title, question = "Distributions", "Which parameters move the whole distribution of the outcome, not its variance?"
    result = folder.result(PawnResult)
    if result is None:
        return Section(NAME, title, question, missing=folder.missing("pawn"))
    first = [f"{result.names[j]} {result.median[j]:.2f}" for j in np.argsort(-result.median)[:3]]
    unseen = [name for name, value in zip(result.names, result.median, strict=True) if value <= result.no_influence]
    sure = f"{percent(result.confidence)} intervals from {result.rows:,} rows"
    return Section(
        NAME, title, question, [_medians(result)],
        found=f"median PAWN indices: {', '.join(first)}",
        sure=sure + (f"; no influence seen: {listed(unseen, 3)}" if unseen else ""),
        failed=f"{result.failed:,} rows left out" if result.failed else "",
    )  # fmt: skip


def _medians(result: PawnResult) -> Block:
    names = result.names
    shown = result.panels()

    def columns(found: Pawn) -> dict[str, Any]:
        level = np.full(len(names), found.no_influence)
        return {
            "pawn": {
                "parameter": names, "median": found.median, "low": found.median_low, "high": found.median_high,
                "maximum": found.maximum, "level": level,
            }
        }  # fmt: skip

    def draw(sources: plots.Sources) -> list[Plot]:
        source = sources["pawn"]
        labels = [*map(plots.plain, names)][::-1]
        plot = plots.figure("median PAWN index", "", height=90 + 20 * len(names), y_range=labels)
        plot.segment("low", "parameter", "high", "parameter", source=source, color=COLOURS[0])
        dots = plot.scatter("median", "parameter", source=source, color=COLOURS[0], marker="circle", size=8)
        turned = {"color": COLOURS[1], "marker": "dash", "size": 9, "angle": np.pi / 2}
        none = plot.scatter("level", "parameter", source=source, **turned)
        rows = [("parameter", "@parameter"), ("median", "@median{0.000} (@low{0.000} to @high{0.000})")]
        plots.hover(plot, dots, [*rows, ("maximum", "@maximum{0.000}")])
        plots.legend(plot, [("median", [dots]), ("level of no influence", [none])])
        return [plots.plot("distributions-medians", plot, "Median PAWN index of each parameter", wide=True)]

    words = "A median below {:.3f} cannot be told from no influence."
    notes = {name: words.format(found.no_influence) for name, found in shown.items()}
    caption = f"Median PAWN indices; lines: {percent(result.confidence)} intervals."
    data = {name: columns(found) for name, found in shown.items()}
    return plots.picked("distributions-objectives", caption, "Objective", data, draw, notes)
