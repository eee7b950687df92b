"""Importance: what a random forest that learned the rows of the sensitivity study looks at."""

from typing import Any

import numpy as np

from tasks.report import plots
from tasks.report.blocks import Block, Plot, Section
from tasks.report.figures import COLOURS, panels
from tasks.report.folder import Found


def section(found: Found) -> Section:
    """Everything of ``importance.json``."""
    title, question = "Importance", "Does a model that knows no Sobol indices look at the same parameters?"
    result = found.results.get("importance")
    if result is None:
        return Section("importance", title, question, missing=found.missing("importance"))
    loss = np.array(result["permutation"], dtype=float)
    first = [f"{result['names'][j]} {loss[j]:.2f}" for j in np.argsort(-np.nan_to_num(loss))[:3]]
    return Section(
        "importance", title, question, [_importances(result)],
        found=f"loss of R² when permuted: {', '.join(first)}",
        sure=f"R² {result['r2_on_unseen']:.3f} on {result['rows_tested']:,} unseen rows",
        failed=f"{result['failed']:,} rows left out" if result["failed"] else "",
    )  # fmt: skip


def _importances(result: dict[str, Any]) -> Block:
    names = result["names"]
    shown = panels(result)

    def columns(values: dict[str, Any]) -> dict[str, Any]:
        told: dict[str, Any] = {"parameter": names}
        for key, spread in (("impurity_percent", "impurity_sd"), ("permutation", "permutation_sd")):
            value, sd = (np.array(values[each], dtype=float) for each in (key, spread))
            told |= {key: value, spread: sd, f"{key}_low": value - sd, f"{key}_high": value + sd}
        return {"importances": told}

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for key, spread, label, marker in (
            ("permutation", "permutation_sd", "loss of R² when permuted", "circle"),
            ("impurity_percent", "impurity_sd", "impurity importance (%)", "square"),
        ):
            plot = plots.figure(label, "", height=90 + 20 * len(names), y_range=[*map(plots.plain, names)][::-1])
            told = sources["importances"]
            colour = COLOURS[len(drawn)]
            plot.segment(f"{key}_low", "parameter", f"{key}_high", "parameter", source=told, color=colour)
            dots = plot.scatter(key, "parameter", source=told, color=colour, marker=marker, size=8)
            plots.hover(plot, dots, [("parameter", "@parameter"), (label, f"@{key}{{0.000}} ± @{spread}{{0.000}}")])
            drawn.append(plots.plot(f"importance-{key}", plot, f"{label} of the picked objective by parameter"))
        return drawn

    told = {name: f"R² on unseen rows: {values['r2_on_unseen']:.3f}" for name, values in shown.items()}
    caption = "Importance of each parameter; lines: one standard deviation over permutations and trees."
    data = {name: columns(values) for name, values in shown.items()}
    return plots.picked("importance-objectives", caption, "Objective", data, draw, told)
