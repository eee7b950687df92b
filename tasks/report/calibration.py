"""Figures of a calibration: of one typical specimen its search and what the search learned, of all the correlations.

As figures 4, 6, 7, 8, S1 and S2 of Pekedis (2025). The typical specimen is that of the median total objective.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from scipy.stats import qmc

from tasks.bayesian import Process, fitted, informative
from tasks.correlations import correlations
from tasks.model import Parameter, file_name
from tasks.report import tables
from tasks.report.figures import COLOURS, STYLE, save, symbol
from tasks.simulate import Array
from tasks.workspace import Workspace

BACKGROUND = 100  # points over which a partial dependence is the mean
GRID, FINE = 20, 60  # points along a parameter, in contours and in curves
LEARNED = 200  # points that the process is fitted to at the most; the time it takes grows with their cube
ROOMY = 8  # more parameters than this leave room for a legend above their triangle
OBJECTIVE = "total objective (N)"
RED = "#E3000F"
COLOURED = "viridis"  # dark is low, which is good


@dataclass(frozen=True)
class Samples:
    """What the Bayesian search of one specimen saw: ``points`` ``[n, d]`` of the free ``parameters``, in their units.

    ``totals`` ``[n]`` (N) is infinite where the model failed. ``calibrated`` ``[d]`` is what all methods together came
    to, and ``method`` the one of them that did.
    """

    specimen: str
    parameters: tuple[Parameter, ...]
    points: Array
    totals: Array
    calibrated: Array
    method: str

    @property
    def best(self) -> Array:
        """The best of the search's points ``[d]``."""
        return self.points[int(np.argmin(self.totals))]

    @property
    def alive(self) -> Array:
        """Which points ``[n]`` the model did not fail at."""
        return np.isfinite(self.totals)

    def column(self, name: str) -> int:
        """Where a parameter is."""
        return [parameter.name for parameter in self.parameters].index(name)


def draw(workspace: Workspace, result: dict[str, Any]) -> list[Path]:
    """Write all figures that ``calibrate.json`` and the store have something for; returns their paths."""
    folder = workspace.out / "figures"
    name = typical(result)
    told = result["specimens"][name]
    shown = tables.convergence(name, told)
    paths = save(convergence(name, told), folder, "calibrate_typical_convergence", shown)
    if {"bayesian", "hybrid"} & set(result["methods"]):
        paths += _draw_search(samples_of(workspace, result, name), folder)
    found = result.get("correlations") or correlations(result["specimens"], workspace.model.free)
    if found.get("pairs"):
        paths += save(correlation_matrix(found), folder, "calibrate_correlations", tables.correlations(found))
    return paths


def _draw_search(samples: Samples, folder: Path) -> list[Path]:
    if samples.alive.sum() < 2:  # there is nothing to learn from
        return []
    surrogate = learned(samples)
    paths = save(influences(samples, surrogate), folder, "calibrate_surrogate_all", influence_table(samples, surrogate))
    if len(samples.parameters) > 1:
        names = [parameter.name for parameter in samples.parameters]
        sampled = tables.samples(names, samples.points, samples.totals, samples.calibrated)
        paths += save(all_samples(samples), folder, "calibrate_samples_all", sampled)
        paths += save(paired_samples(samples), folder, "calibrate_samples", sampled)
        paired = pair_table(samples, surrogate)
        paths += save(paired_influences(samples, surrogate), folder, "calibrate_surrogate", paired)
    return paths


def typical(result: dict[str, Any]) -> str:
    """The specimen of the median total objective; of an even number, the better of the two in the middle."""
    totals = {name: told["total_N"] for name, told in result["specimens"].items()}
    ordered = sorted(totals, key=lambda name: (totals[name], name))
    return ordered[(len(ordered) - 1) // 2]


def samples_of(workspace: Workspace, result: dict[str, Any], specimen: str) -> Samples:
    """What the store holds of a specimen's search. Raises :class:`runner.errors.StoreError` when that is nothing."""
    kept = workspace.store.read_result(f"calibrate/{file_name(specimen)}")
    free = workspace.model.free
    names = [parameter.name for parameter in free]
    told = result["specimens"][specimen]
    return Samples(
        specimen,
        free,
        kept["parameters"].sel(parameter=names).to_numpy(),
        kept["total"].to_numpy(),
        np.array([told["parameters"][name] for name in names], dtype=float),
        told["method"],
    )


def pairs(names: Sequence[str]) -> list[tuple[str, str]]:
    """A parameter of the matrix (``X_m``) with that of the fibres of the same stem (``X_f``), then what is left over.

    What is left over goes two by two, matrix first; an odd one goes with the first parameter of all.
    """
    found = [(name, f"{name[:-1]}f") for name in names if name.endswith("m") and f"{name[:-1]}f" in names]
    left = [name for name in names if not any(name in pair for pair in found)]
    left.sort(key=lambda name: not name.endswith("m"))
    if len(left) % 2 and len(names) > 1:
        left.append(next(name for name in names if name != left[-1]))
    return found + list(zip(left[::2], left[1::2], strict=False))


def convergence(specimen: str, told: dict[str, Any]) -> Figure:
    """The best objective so far of each method (figure 4), and the noise of the curves where it is known."""
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(5.2, 3.4))
        # the hybrid begins as the Bayesian search: drawn below it, both can be seen
        order = sorted(told["methods"], key=lambda method: -told["methods"][method]["trace"][-1][0])
        for number, method in enumerate(order):
            used, totals = np.array(told["methods"][method]["trace"], dtype=float).T
            label = f"{method.replace('_', ' ')}: {totals[-1]:.3g} N"
            style: Any = {"color": COLOURS[number], "lw": 2.6 - 0.8 * number, "label": label}
            axis.step(used, totals, where="post", **style)
            axis.plot(used[-1], totals[-1], "o", ms=4, color=COLOURS[number])
        if (told["noise_N"] or 0.0) > 0.0:  # neither None nor NaN
            axis.axhline(told["noise_N"], color="0.4", lw=1, ls="--", label=f"noise: {told['noise_N']:.3g} N")
        axis.set_yscale("log")
        _plain_log(axis)
        axis.set_xlabel("evaluations")
        axis.set_ylabel("lowest total objective so far (N)")
        axis.set_title(specimen, loc="left", fontsize=9)
        axis.legend()
    return figure


def paired_samples(samples: Samples) -> Figure:
    """The search's points, paired by :func:`pairs`, coloured by the objective (figure 6)."""
    panels = pairs([parameter.name for parameter in samples.parameters])
    with plt.rc_context(STYLE):
        figure, axes = _grid(len(panels))
        drawn = None
        for axis, (across, up) in zip(axes, panels, strict=True):
            x, y = samples.column(across), samples.column(up)
            drawn = _scatter(axis, samples, x, y)
            _marks(axis, samples, x, y)
            _name_axes(axis, samples.parameters[x], samples.parameters[y])
        _finish(figure, axes, samples, drawn)
    return figure


def all_samples(samples: Samples) -> Figure:
    """The search's points in every pair of parameters, each one's histogram on the diagonal (figure S1).

    All panels are squares in one pair of axes, row over column: a hundred pairs of axes would take ten times as long.
    """
    count = len(samples.parameters)
    low, high = _bounds(samples.parameters)
    inside = 0.1 + 0.8 * np.array([(each - low) / (high - low) for each in (*samples.points, samples.calibrated)])
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
            axis.plot(right + calibrated[right], down + 1 - calibrated[down], **_diamond(6), label=_came_to(samples))
        axis.plot(right + best[right], down + 1 - best[down], **_star(6), label="best sampled")
        for k, values in enumerate(points.T):
            heights, edges = np.histogram(values, 10, (0.1, 0.9))
            axis.bar(k + edges[:-1], -0.9 * heights / heights.max(), 0.08, k + 1, align="edge", color="0.7")
            axis.plot([k + best[k]] * 2, [k + 0.1, k + 1], color=RED, lw=1)
        across, along = np.tril_indices(count)
        axis.hlines(across + 1, along + 0.04, along + 1, color="black", lw=0.8)
        axis.vlines(along + 0.04, across + 0.06, across + 1, color="black", lw=0.8)
        _name_edges(axis, samples.parameters)
        if count > ROOMY:
            axis.legend(loc="upper right", title=_caption(samples), markerscale=1.5, alignment="right")
            bar = axis.inset_axes((0.6, 0.86, 0.38, 0.012))
            _colour_bar(figure.colorbar(drawn, bar, orientation="horizontal", label=OBJECTIVE))
        else:
            _finish(figure, [axis], samples, drawn)
    return figure


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
    low, high = _bounds(samples.parameters)
    points = (samples.points[chosen] - low) / (high - low)
    process, _ = fitted(points, np.log(np.maximum(samples.totals[chosen, np.newaxis], 1e-12)), None)
    return Learned(
        process, qmc.LatinHypercube(len(samples.parameters), rng=np.random.default_rng(0)).random(BACKGROUND)
    )


def paired_influences(samples: Samples, surrogate: Learned) -> Figure:
    """Partial dependence of the surrogate on the pairs of :func:`pairs` as contours (figure 7).

    The mean over the background is that of the logarithm: a geometric mean in newton.
    """
    panels = pairs([parameter.name for parameter in samples.parameters])
    low, high = _bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, GRID)
    columns = [(samples.column(across), samples.column(up)) for across, up in panels]
    levels = [_over_pair(surrogate, pair) for pair in columns]
    edges = np.geomspace(*_apart(min(each.min() for each in levels), max(each.max() for each in levels)), 16)
    with plt.rc_context(STYLE):
        figure, axes = _grid(len(panels))
        drawn = None
        for axis, (x, y), level in zip(axes, columns, levels, strict=True):
            across, up = (low[k] + (high[k] - low[k]) * line for k in (x, y))
            drawn = axis.contourf(across, up, level, edges, cmap=COLOURED, norm=LogNorm(edges[0], edges[-1]))
            axis.plot(samples.points[:, x], samples.points[:, y], ".", ms=2, color="black", alpha=0.5, label="sampled")
            _marks(axis, samples, x, y)
            _name_axes(axis, samples.parameters[x], samples.parameters[y])
        _finish(figure, axes, samples, drawn, "partial dependence (N)")
    return figure


def _over_pair(surrogate: Learned, pair: tuple[int, int]) -> Array:
    """Partial dependence ``[GRID, GRID]`` (N) on two parameters, the first along the columns."""
    line = np.linspace(0.0, 1.0, GRID)
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    return _geometric_mean(surrogate.along(pair, grid)).reshape(GRID, GRID)


def pair_table(samples: Samples, surrogate: Learned) -> pd.DataFrame:
    """What :func:`paired_influences` shows: a row for each point of the grid of each pair."""
    low, high = _bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, GRID)
    parts = []
    for across, up in pairs([parameter.name for parameter in samples.parameters]):
        x, y = samples.column(across), samples.column(up)
        values = {"across": across, "up": up, "across_value": np.tile(low[x] + (high[x] - low[x]) * line, GRID)}
        values["up_value"] = np.repeat(low[y] + (high[y] - low[y]) * line, GRID)
        parts.append(pd.DataFrame(values | {"partial_dependence_N": _over_pair(surrogate, (x, y)).ravel()}))
    return pd.concat(parts, ignore_index=True)


def influence_table(samples: Samples, surrogate: Learned) -> pd.DataFrame:
    """What :func:`influences` shows: a row for each point along each parameter."""
    low, high = _bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, FINE)
    parts = []
    for k, parameter in enumerate(samples.parameters):
        found = surrogate.along([k], line[:, np.newaxis])
        below, above = np.quantile(found, (0.1, 0.9), axis=1)
        values = {"parameter": parameter.name, "value": low[k] + (high[k] - low[k]) * line}
        values |= {"partial_dependence_N": _geometric_mean(found), "quantile_10_N": below, "quantile_90_N": above}
        parts.append(pd.DataFrame(values))
    return pd.concat(parts, ignore_index=True)


def influences(samples: Samples, surrogate: Learned) -> Figure:
    """Partial dependence of the surrogate on every parameter, and its spread over the background (figure S2)."""
    low, high = _bounds(samples.parameters)
    line = np.linspace(0.0, 1.0, FINE)
    best = (samples.best - low) / (high - low)
    with plt.rc_context(STYLE):
        figure, axes = _grid(len(samples.parameters), width=2.0, height=1.75, sharey=True)
        for k, (axis, parameter) in enumerate(zip(axes, samples.parameters, strict=True)):
            across = low[k] + (high[k] - low[k]) * line
            found = surrogate.along([k], line[:, np.newaxis])
            below, above = np.quantile(found, (0.1, 0.9), axis=1)
            axis.plot(across, _geometric_mean(found), color=COLOURS[0], label=f"mean over {BACKGROUND} points")
            axis.fill_between(across, below, above, color=COLOURS[0], alpha=0.2, lw=0, label="10 to 90 % of them")
            height = _geometric_mean(surrogate.along([k], best[np.newaxis, [k]]))
            axis.plot(samples.best[k], height, **_star(10), label="best sampled", clip_on=False)
            axis.set_xlabel(_label(parameter))
            axis.set_yscale("log")
            axis.xaxis.set_major_locator(MaxNLocator(3))
        _plain_log(axes[0])
        figure.supylabel("partial dependence (N)", fontsize=9)
        _head(figure, axes[0], samples)
    return figure


def correlation_matrix(found: dict[str, Any]) -> Figure:
    """Repeated-measures correlations of :func:`tasks.correlations.correlations` (figure 8)."""
    names = found["names"]
    size = max(4.5, 0.52 * len(names) + 1.6)
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(size + 0.6, size))
        level = np.full((len(names), len(names)), np.nan)
        for pair in found["pairs"]:
            row, column = sorted((names.index(name) for name in pair["parameters"]), reverse=True)
            corner = (column - 0.5, row - 0.5)
            if "r" not in pair:
                axis.add_patch(Rectangle(corner, 1, 1, color="0.9", lw=0))
                continue
            level[row, column] = pair["r"]
            stars = "**" if pair["p_holm"] < 0.05 else "*" if pair["p"] < 0.05 else ""
            shade = "white" if abs(pair["r"]) > 0.6 else "black"
            axis.text(column, row, f"{pair['r']:.2f}\n{stars}".rstrip(), ha="center", va="center", size=7, color=shade)
            if not pair["determined"]:
                axis.add_patch(Rectangle(corner, 1, 1, fill=False, hatch="////", ec="0.45", lw=0, alpha=0.6))
        image = axis.imshow(level, cmap="RdBu_r", vmin=-1, vmax=1)
        axis.set_xticks(range(len(names) - 1), [symbol(name) for name in names[:-1]])
        axis.set_yticks(range(1, len(names)), [symbol(name) for name in names[1:]])
        axis.set_ylim(len(names) - 0.5, 0.5)
        axis.set_xlim(-0.5, len(names) - 1.5)
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        figure.colorbar(image, ax=axis, shrink=0.7, label="correlation $r$")
        notes = [
            f"{len(found['donors'])} donors, {found['specimens']} specimens of {len(found['sites'])} sites",
            "*  p < 0.05",
            f"**  p < 0.05 adjusted for {found['tests']} pairs (Holm)",
            "hatched: not determined in most specimens",
            "grey: does not vary within donors",
        ]
        if len(names) > ROOMY:
            axis.text(1, 1, "\n".join(notes), transform=axis.transAxes, ha="right", va="top", linespacing=1.5)
        else:
            axis.set_title("\n".join(notes), loc="left", fontsize=8)
    return figure


def _grid(count: int, *, width: float = 2.35, height: float = 2.1, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    """As many panels as asked for, up to four in a row."""
    columns = min(count, 4)
    rows = -(-count // columns)
    shape = (max(width * columns + 0.8, 4.5), height * rows + 0.6)
    figure, axes = plt.subplots(rows, columns, figsize=shape, squeeze=False, sharey=sharey)
    for axis in axes.flat[count:]:
        axis.remove()
    return figure, list(axes.flat[:count])


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
    return LogNorm(*_apart(float(totals.min()), float(totals.max())))


def _marks(axis: Axes, samples: Samples, x: int, y: int) -> None:
    """The search's best, and what became of it where another method went on."""
    if samples.method != "bayesian":
        axis.plot(samples.calibrated[x], samples.calibrated[y], **_diamond(13), label=_came_to(samples), clip_on=False)
    axis.plot(samples.best[x], samples.best[y], **_star(13), label="best sampled", clip_on=False)


def _star(size: float) -> dict[str, Any]:
    return {"marker": "*", "ls": "none", "color": RED, "ms": size, "mec": "white", "mew": 0.04 * size, "zorder": 5}


def _diamond(size: float) -> dict[str, Any]:
    return {"marker": "D", "ls": "none", "mfc": "none", "mec": RED, "mew": 1.2, "ms": 0.45 * size, "zorder": 4}


def _came_to(samples: Samples) -> str:
    return f"calibrated ({samples.method.replace('_', ' ')})"


def _name_axes(axis: Axes, across: Parameter, up: Parameter) -> None:
    axis.set_xlabel(_label(across))
    axis.set_ylabel(_label(up))
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.yaxis.set_major_locator(MaxNLocator(4))


def _name_edges(axis: Axes, parameters: Sequence[Parameter]) -> None:
    """Names, and ends of the ranges, at the left and lower edge of a triangle of panels."""
    count = len(parameters)
    middles = np.arange(count) + 0.5
    axis.set_xticks(middles, [f"\n{_label(each)}" for each in parameters])
    axis.set_yticks(
        middles[1:], [f"{_label(each)}\n" for each in parameters[1:]], rotation=90, va="center", ma="center"
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


def _finish(figure: Figure, axes: list[Axes], samples: Samples, drawn: Any, label: str = OBJECTIVE) -> None:
    _colour_bar(figure.colorbar(drawn, ax=axes, label=label, aspect=35, shrink=0.9))
    _head(figure, axes[0], samples)


def _head(figure: Figure, axis: Axes, samples: Samples) -> None:
    """What is shown, and the legend of one panel, above all panels."""
    handles, labels = axis.get_legend_handles_labels()
    columns = len(labels) if figure.get_figwidth() > 6 else 1
    title = _caption(samples)
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, title=title, alignment="left")


def _caption(samples: Samples) -> str:
    failed = int((~samples.alive).sum())
    return f"{samples.specimen}, {len(samples.totals)} evaluations" + (f", {failed} failed (×)" if failed else "")


def _label(parameter: Parameter) -> str:
    return symbol(parameter.name) + (f" ({parameter.unit})" if parameter.unit not in ("", "1") else "")


def _colour_bar(bar: Any) -> None:
    """Ticks of a logarithmic colour bar as plain numbers."""
    low, high = bar.mappable.norm.vmin, bar.mappable.norm.vmax
    ticks = _round_numbers(low, high)
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()


def _plain_log(axis: Axes) -> None:
    """Ticks of a logarithmic ordinate as plain numbers, also within a decade."""
    low, high = axis.get_ylim()
    ticks = _round_numbers(low, high)
    axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_ylim(low, high)


def _round_numbers(low: float, high: float) -> list[float]:
    """Some 3 to 8 round numbers between two positive ones."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [float(f"{step * decade:.3g}") for decade in decades for step in steps]
        inside = [number for number in found if low <= number <= high]
        if len(inside) >= 3:
            return inside
    return [float(number) for number in MaxNLocator(5).tick_values(low, high) if low <= number <= high]


def _apart(low: float, high: float) -> tuple[float, float]:
    """Two limits of a logarithmic scale, which must not be equal."""
    return (low, high) if high > 1.001 * low else (0.999 * low, 1.001 * low)


def _bounds(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    return np.array([each.minimum for each in parameters]), np.array([each.maximum for each in parameters])


def _geometric_mean(values: Array) -> Array:
    """Of objectives ``[g, b]`` over the background."""
    return np.asarray(np.exp(np.log(values).mean(axis=1)))
