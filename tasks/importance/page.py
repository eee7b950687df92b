"""Importance: what a random forest that learned the rows of the sensitivity study looks at."""

from typing import Any

import numpy as np

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plot, Section
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.importance.result import ImportanceResult
from sinew.tasks.report.folder import ResultFolder

NAME = "importance"


def section(folder: ResultFolder) -> Section:
    """Everything of ``importance.json``."""
    title, question = "Importance", "Does a model that knows no Sobol indices look at the same parameters?"
    result = folder.result(ImportanceResult)
    if result is None:
        return Section("importance", title, question, missing=folder.missing("importance"))
    loss = result.permutation
    first = [f"{result.names[j]} {loss[j]:.2f}" for j in np.argsort(-np.nan_to_num(loss))[:3]]
    return Section(
        "importance", title, question, [_importances(result)],
        found=f"loss of R² when permuted: {', '.join(first)}",
        sure=f"R² {result.r2_on_unseen:.3f} on {result.rows_tested:,} unseen rows",
        failed=f"{result.failed:,} rows left out" if result.failed else "",
    )  # fmt: skip


def _importances(result: ImportanceResult) -> Block:
    names = result.names
    shown = result.panels()

    def columns(values: Any) -> dict[str, Any]:
        columns: dict[str, Any] = {"parameter": names}
        for key, spread in (("impurity_percent", "impurity_sd"), ("permutation", "permutation_sd")):
            value, sd = (getattr(values, each) for each in (key, spread))
            columns |= {key: value, spread: sd, f"{key}_low": value - sd, f"{key}_high": value + sd}
        return {"importances": columns}

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for key, spread, label, marker in (
            ("permutation", "permutation_sd", "loss of R² when permuted", "circle"),
            ("impurity_percent", "impurity_sd", "impurity importance (%)", "square"),
        ):
            plot = plots.figure(label, "", height=90 + 20 * len(names), y_range=[*map(plots.plain, names)][::-1])
            source = sources["importances"]
            colour = COLOURS[len(drawn)]
            plot.segment(f"{key}_low", "parameter", f"{key}_high", "parameter", source=source, color=colour)
            dots = plot.scatter(key, "parameter", source=source, color=colour, marker=marker, size=8)
            plots.hover(plot, dots, [("parameter", "@parameter"), (label, f"@{key}{{0.000}} ± @{spread}{{0.000}}")])
            drawn.append(plots.plot(f"importance-{key}", plot, f"{label} of the picked objective by parameter"))
        return drawn

    notes = {name: f"R² on unseen rows: {values.r2_on_unseen:.3f}" for name, values in shown.items()}
    caption = "Importance of each parameter; lines: one standard deviation over permutations and trees."
    data = {name: columns(values) for name, values in shown.items()}
    return plots.picked("importance-objectives", caption, "Objective", data, draw, notes)
