"""Screening: elementary effects by Morris."""

from typing import Any

import numpy as np

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plot, Section, Words, listed, percent
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.morris.result import Effects, MorrisResult
from sinew.tasks.report.folder import ResultFolder

NAME = "screening"
SMALL = 0.01  # of the largest effect


def section(folder: ResultFolder) -> Section:
    """Everything of ``morris.json``."""
    title, question = "Screening", "Which parameters can be left alone, at the price of a few rows?"
    result = folder.result(MorrisResult)
    if result is None:
        return Section(NAME, title, question, missing=folder.missing("morris"))
    star, conf = result.mu_star, result.mu_star_conf
    first = [f"{result.names[j]} {star[j]:.3g} ± {conf[j]:.2g}" for j in np.argsort(-star)[:3]]
    small = [name for name, value in zip(result.names, star, strict=True) if value < SMALL * star.max()]
    blocks: list[Block] = [_effects(result)]
    failed = ""
    if result.failed:
        left_out = result.trajectories - result.trajectories_used
        failed = f"{result.failed:,} of {result.rows:,} rows; {left_out:,} trajectories are left out"
        blocks.append(Words(f"Failed rows: {failed}.", "warning"))
    sure = f"{percent(result.confidence)} intervals from {result.trajectories_used:,} trajectories"
    return Section(
        NAME, title, question, blocks,
        found=f"mean absolute effects ({result.unit}): {', '.join(first)}",
        sure=sure + (f"; below a hundredth of the largest: {listed(small, 3)}" if small else ""),
        failed=failed,
    )  # fmt: skip


def _effects(result: MorrisResult) -> Block:
    names = result.names

    def columns(effects: Effects) -> dict[str, Any]:
        star, conf = effects.mu_star, effects.mu_star_conf
        return {
            "effects": {
                "parameter": names, "mu": effects.mu, "star": star, "conf": conf, "sigma": effects.sigma,
                "low": star - conf, "high": star + conf,
            }
        }  # fmt: skip

    def draw(sources: plots.Sources) -> list[Plot]:
        source, unit = sources["effects"], result.unit
        rows = [("parameter", "@parameter"), ("mu*", f"@star{{0.000}} ± @conf{{0.000}} {unit}"),
                ("mu", f"@mu{{0.000}} {unit}"), ("sigma", f"@sigma{{0.000}} {unit}")]  # fmt: skip
        labels = [*map(plots.plain, names)][::-1]
        bars = plots.figure(f"mean absolute effect ({unit})", "", height=90 + 20 * len(names), y_range=labels)
        bars.segment("low", "parameter", "high", "parameter", source=source, color=COLOURS[0])
        dots = bars.scatter("star", "parameter", source=source, color=COLOURS[0], marker="circle", size=8)
        plots.hover(bars, dots, rows)
        plane = plots.figure(
            f"mean absolute effect ({unit})", f"standard deviation ({unit})", height=90 + 20 * len(names)
        )
        points = plane.scatter("star", "sigma", source=source, color=COLOURS[1], marker="square", size=8)
        plots.hover(plane, points, rows)
        return [
            plots.plot("screening-effects", bars, "Mean absolute effect of each parameter on the picked objective"),
            plots.plot("screening-plane", plane, "Mean absolute effect against standard deviation, by parameter"),
        ]

    caption = (
        f"Elementary effects of each parameter's whole range on the {result.objective}; lines: "
        f"{percent(result.confidence)} intervals. Points far up: the effect depends on the other parameters."
    )
    data = {name: columns(effects) for name, effects in result.panels().items()}
    return plots.picked("screening-objectives", caption, "Objective", data, draw)
