"""Figures of the surrogate: partial dependence of the objective on parameters and pairs (7 and S2 in Pekedis 2025).

The Bayesian search itself learns residuals along the curves; here a process of the objective is fitted, as in the
paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.stats import qmc

from sinew.tasks.calibrate.panels import (
    COLOURED,
    Samples,
    apart,
    axis_label,
    finish,
    grid,
    head,
    marks,
    name_axes,
    pairs,
    plain_log,
    star,
)
from sinew.tasks.drawing.figures import COLOURS, STYLE
from sinew.tasks.fitting.bayesian import informative
from sinew.tasks.fitting.gaussian_process import Process, fitted
from sinew.tasks.model.parameters import bounds, unscaled
from sinew.tasks.simulate import Array

BACKGROUND = 100  # points over which a partial dependence is the mean
GRID, FINE = 20, 60  # points along a parameter, in contours and in curves
LEARNED = 200  # points that the process is fitted to at the most; its time grows with their cube


@dataclass(frozen=True)
class Learned:
    """A Gaussian process of log total objective on the unit cube of ``d`` parameters, and ``background`` ``[b, d]``."""

    process: Process
    background: Array

    def along(self, columns: Sequence[int], at: Array) -> Array:
        """Objective (N) ``[g, b]`` at ``at`` ``[g, len(columns)]`` with the other parameters as in the background."""
        found = []
        for some in np.array_split(at, -(-len(at) // 50)):  # the process wants memory for all that it is asked at once
            asked = np.repeat(self.background[np.newaxis], len(some), axis=0)
            asked[:, :, columns] = some[:, np.newaxis]
            found.append(self.process.mean(asked.reshape(-1, asked.shape[-1])).reshape(len(some), -1))
        return np.exp(np.concatenate(found))


def learned(samples: Samples) -> Learned:
    """What the Bayesian search saw, its best points and, of many, some others, learned by its kernel.

    The search itself learns residuals along the curves; here it is the objective, as in the paper.
    """
    alive = np.flatnonzero(samples.alive)
    chosen = alive[informative(samples.totals[alive], LEARNED)]
    points = unscaled(samples.parameters, samples.points[chosen])
    process, _ = fitted(points, np.log(np.maximum(samples.totals[chosen, np.newaxis], 1e-12)), None)
    return Learned(
        process, qmc.LatinHypercube(len(samples.parameters), rng=np.random.default_rng(0)).random(BACKGROUND)
    )


def paired_influences(samples: Samples, surrogate: Learned) -> Figure:
    """Partial dependence of the surrogate on the pairs of :func:`pairs` as contours (figure 7).

    The mean over the background is that of the logarithm: a geometric mean in newton.
    """
    panels = pairs([parameter.name for parameter in samples.parameters])
    low, high = bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, GRID)
    columns = [(samples.column(across), samples.column(up)) for across, up in panels]
    levels = [_over_pair(surrogate, pair) for pair in columns]
    edges = np.geomspace(*apart(min(each.min() for each in levels), max(each.max() for each in levels)), 16)
    with plt.rc_context(STYLE):
        figure, axes = grid(len(panels))
        drawn = None
        for axis, (x, y), level in zip(axes, columns, levels, strict=True):
            across, up = (low[k] + (high[k] - low[k]) * line for k in (x, y))
            drawn = axis.contourf(across, up, level, edges, cmap=COLOURED, norm=LogNorm(edges[0], edges[-1]))
            axis.plot(samples.points[:, x], samples.points[:, y], ".", ms=2, color="black", alpha=0.5, label="sampled")
            marks(axis, samples, x, y)
            name_axes(axis, samples.parameters[x], samples.parameters[y])
        finish(figure, axes, samples, drawn, f"partial dependence ({samples.unit})")
    return figure


def _over_pair(surrogate: Learned, pair: tuple[int, int]) -> Array:
    """Partial dependence ``[GRID, GRID]`` (N) on two parameters, the first along the columns."""
    line = np.linspace(0.0, 1.0, GRID)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return _geometric_mean(surrogate.along(pair, grid)).reshape(GRID, GRID)


def pair_table(samples: Samples, surrogate: Learned) -> pd.DataFrame:
    """What :func:`paired_influences` shows: a row for each point of the grid of each pair."""
    low, high = bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, GRID)
    parts = []
    for across, up in pairs([parameter.name for parameter in samples.parameters]):
        x, y = samples.column(across), samples.column(up)
        values = {"across": across, "up": up, "across_value": np.tile(low[x] + (high[x] - low[x]) * line, GRID)}
        values["up_value"] = np.repeat(low[y] + (high[y] - low[y]) * line, GRID)
        parts.append(
            pd.DataFrame(values | {f"partial_dependence{samples.ending}": _over_pair(surrogate, (x, y)).ravel()})
        )
    return pd.concat(parts, ignore_index=True)


def influence_table(samples: Samples, surrogate: Learned) -> pd.DataFrame:
    """What :func:`influences` shows: a row for each point along each parameter."""
    low, high = bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, FINE)
    parts = []
    for k, parameter in enumerate(samples.parameters):
        found = surrogate.along([k], line[:, np.newaxis])
        below, above = np.quantile(found, (0.1, 0.9), axis=1)
        values = {"parameter": parameter.name, "value": low[k] + (high[k] - low[k]) * line}
        values |= {
            f"partial_dependence{samples.ending}": _geometric_mean(found),
            f"quantile_10{samples.ending}": below,
            f"quantile_90{samples.ending}": above,
        }
        parts.append(pd.DataFrame(values))
    return pd.concat(parts, ignore_index=True)


def influences(samples: Samples, surrogate: Learned) -> Figure:
    """Partial dependence of the surrogate on every parameter, and its spread over the background (figure S2)."""
    low, high = bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, FINE)
    best = unscaled(samples.parameters, samples.best)
    with plt.rc_context(STYLE):
        figure, axes = grid(len(samples.parameters), width=2.0, height=1.75, sharey=True)
        for k, (axis, parameter) in enumerate(zip(axes, samples.parameters, strict=True)):
            across = low[k] + (high[k] - low[k]) * line
            found = surrogate.along([k], line[:, np.newaxis])
            below, above = np.quantile(found, (0.1, 0.9), axis=1)
            axis.plot(across, _geometric_mean(found), color=COLOURS[0], label=f"mean over {BACKGROUND} points")
            axis.fill_between(across, below, above, color=COLOURS[0], alpha=0.2, lw=0, label="10 to 90 % of them")
            height = _geometric_mean(surrogate.along([k], best[np.newaxis, [k]]))
            axis.plot(samples.best[k], height, **star(10), label="best sampled", clip_on=False)
            axis.set_xlabel(axis_label(parameter))
            axis.set_yscale("log")
            axis.xaxis.set_major_locator(MaxNLocator(3))
        plain_log(axes[0])
        figure.supylabel(f"partial dependence ({samples.unit})", fontsize=9)
        head(figure, axes[0], samples)
    return figure


def _geometric_mean(values: Array) -> Array:
    """Of objectives ``[g, b]`` over the background."""
    return np.asarray(np.exp(np.log(values).mean(axis=1)))
