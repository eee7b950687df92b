"""Figures of the points of a search: in chosen pairs of parameters and in all (6 and S1 in Pekedis 2025)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from sinew.tasks.calibrate.panels import (
    COLOURED,
    RED,
    ROOMY,
    Samples,
    apart,
    axis_label,
    came_to,
    caption,
    colour_bar,
    diamond,
    finish,
    grid,
    marks,
    name_axes,
    pairs,
    star,
)
from sinew.tasks.drawing.figures import STYLE
from sinew.tasks.model import Parameter
from sinew.tasks.model.parameters import unscaled
from sinew.tasks.simulate import Array


def paired_samples(samples: Samples) -> Figure:
    """The search's points, paired by :func:`pairs`, coloured by the objective (figure 6)."""
    panels = pairs([parameter.name for parameter in samples.parameters])
    with plt.rc_context(STYLE):
        figure, axes = grid(len(panels))
        drawn = None
        for axis, (across, up) in zip(axes, panels, strict=True):
            x, y = samples.column(across), samples.column(up)
            drawn = _scatter(axis, samples, x, y)
            marks(axis, samples, x, y)
            name_axes(axis, samples.parameters[x], samples.parameters[y])
        finish(figure, axes, samples, drawn)
    return figure


def all_samples(samples: Samples) -> Figure:
    """The search's points in every pair of parameters, each one's histogram on the diagonal (figure S1).

    All panels are squares in one pair of axes, row over column: a hundred pairs of axes would take ten times as long.
    """
    count = len(samples.parameters)
    inside = 0.1 + 0.8 * unscaled(samples.parameters, np.array([*samples.points, samples.calibrated]))
    points, calibrated = inside[:-1], inside[-1]
    best = points[int(np.argmin(samples.totals))]
    down, right = np.tril_indices(count, -1)
    order = _worst_first(samples)
    side = max(4.5, 0.72 * count + 1.0)
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(side, side))
        x, y = right + points[:, right], down + 1 - points[:, down]
        axis.scatter(x[~samples.alive], y[~samples.alive], 4, "0.6", marker="x", lw=0.5, rasterized=True)
        totals = np.repeat(samples.totals[order], down.size)
        drawn = axis.scatter(x[order], y[order], 5, totals, cmap=COLOURED, norm=_norm(totals), lw=0, rasterized=True)
        if samples.method != "bayesian":
            axis.plot(right + calibrated[right], down + 1 - calibrated[down], **diamond(6), label=came_to(samples))
        axis.plot(right + best[right], down + 1 - best[down], **star(6), label="best sampled")
        for k, values in enumerate(points.T):
            heights, edges = np.histogram(values, 10, (0.1, 0.9))
            axis.bar(k + edges[:-1], -0.9 * heights / heights.max(), 0.08, k + 1, align="edge", color="0.7")
            axis.plot([k + best[k]] * 2, [k + 0.1, k + 1], color=RED, lw=1)
        across, along = np.tril_indices(count)
        axis.hlines(across + 1, along + 0.04, along + 1, color="black", lw=0.8)
        axis.vlines(along + 0.04, across + 0.06, across + 1, color="black", lw=0.8)
        _name_edges(axis, samples.parameters)
        if count > ROOMY:
            axis.legend(loc="upper right", title=caption(samples), markerscale=1.5, alignment="right")
            bar = axis.inset_axes((0.6, 0.86, 0.38, 0.012))
            colour_bar(figure.colorbar(drawn, bar, orientation="horizontal", label=samples.objective))
        else:
            finish(figure, [axis], samples, drawn)
    return figure


def _scatter(axis: Axes, samples: Samples, x: int, y: int) -> Any:
    failed, order = samples.points[~samples.alive], _worst_first(samples)
    axis.scatter(failed[:, x], failed[:, y], 16, "0.6", marker="x", lw=0.7)
    for k, limits in ((x, axis.set_xlim), (y, axis.set_ylim)):
        margin = 0.06 * (samples.parameters[k].maximum - samples.parameters[k].minimum)
        limits(samples.parameters[k].minimum - margin, samples.parameters[k].maximum + margin)
    totals = samples.totals[order]
    points = samples.points[order]
    return axis.scatter(points[:, x], points[:, y], 16, totals, cmap=COLOURED, norm=_norm(totals), lw=0)


def _worst_first(samples: Samples) -> Array:
    """Which points ``[k]`` to draw in which order, so that the best are on top."""
    order = np.argsort(-samples.totals, kind="stable")
    return order[samples.alive[order]]


def _norm(totals: Array) -> LogNorm:
    return LogNorm(*apart(float(totals.min()), float(totals.max())))


def _name_edges(axis: Axes, parameters: Sequence[Parameter]) -> None:
    """Names, and ends of the ranges, at the left and lower edge of a triangle of panels."""
    count = len(parameters)
    middles = np.arange(count) + 0.5
    axis.set_xticks(middles, [f"\n{axis_label(each)}" for each in parameters])
    axis.set_yticks(
        middles[1:], [f"{axis_label(each)}\n" for each in parameters[1:]], rotation=90, va="center", ma="center"
    )
    for k, each in enumerate(parameters):
        for end, place, side, upright in ((each.minimum, 0.1, "left", "bottom"), (each.maximum, 0.94, "right", "top")):
            axis.text(k + place, count + 0.06, f"{end:g}", size=6, ha=side, va="top")
            if k:
                axis.text(-0.02, k + 1 - place, f"{end:g}", size=6, ha="right", va=upright)
    axis.set_xlim(-0.05, count)
    axis.set_ylim(count + 0.06, 0)
    axis.tick_params(length=0)
    axis.spines[:].set_visible(False)
