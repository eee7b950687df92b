"""What the figures of a search share: the search's points, panels, markers, labels and logarithmic scales."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from sinew.tasks.drawing.figures import symbol
from sinew.tasks.model import Parameter
from sinew.tasks.simulate import Array

RED = "#E3000F"
COLOURED = "viridis"  # dark is low, which is good
ROOMY = 8  # with more parameters than this, a legend fits above their triangle


@dataclass(frozen=True)
class Samples:
    """What the Bayesian search of one specimen saw: ``points`` ``[n, d]`` of the free ``parameters``, in their units.

    ``totals`` ``[n]`` (N) is infinite where the model failed. ``calibrated`` ``[d]`` is what all methods together came
    to, and ``method`` the one of them that did. ``unit`` is that of the totals.
    """

    specimen: str
    parameters: tuple[Parameter, ...]
    points: Array
    totals: Array
    calibrated: Array
    method: str
    unit: str = "N"

    @property
    def objective(self) -> str:
        """What the totals are, with their unit."""
        return f"total objective ({self.unit})"

    @property
    def ending(self) -> str:
        """What the unit adds to the names of columns."""
        return "_N" if self.unit == "N" else ""

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


def grid(count: int, *, width: float = 2.35, height: float = 2.1, sharey: bool = False) -> tuple[Figure, list[Axes]]:
    """As many panels as asked for, up to four in a row."""
    columns = min(count, 4)
    rows = -(-count // columns)
    shape = (max(width * columns + 0.8, 4.5), height * rows + 0.6)
    figure, axes = plt.subplots(rows, columns, figsize=shape, squeeze=False, sharey=sharey)
    for axis in axes.flat[count:]:
        axis.remove()
    return figure, list(axes.flat[:count])


def marks(axis: Axes, samples: Samples, x: int, y: int) -> None:
    """The search's best, and what became of it where another method went on."""
    if samples.method != "bayesian":
        axis.plot(samples.calibrated[x], samples.calibrated[y], **diamond(13), label=came_to(samples), clip_on=False)
    axis.plot(samples.best[x], samples.best[y], **star(13), label="best sampled", clip_on=False)


def star(size: float) -> dict[str, Any]:
    return {"marker": "*", "ls": "none", "color": RED, "ms": size, "mec": "white", "mew": 0.04 * size, "zorder": 5}


def diamond(size: float) -> dict[str, Any]:
    return {"marker": "D", "ls": "none", "mfc": "none", "mec": RED, "mew": 1.2, "ms": 0.45 * size, "zorder": 4}


def came_to(samples: Samples) -> str:
    return f"calibrated ({samples.method.replace('_', ' ')})"


def name_axes(axis: Axes, across: Parameter, up: Parameter) -> None:
    axis.set_xlabel(axis_label(across))
    axis.set_ylabel(axis_label(up))
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.yaxis.set_major_locator(MaxNLocator(4))


def finish(figure: Figure, axes: list[Axes], samples: Samples, drawn: Any, label: str | None = None) -> None:
    colour_bar(figure.colorbar(drawn, ax=axes, label=label or samples.objective, aspect=35, shrink=0.9))
    head(figure, axes[0], samples)


def head(figure: Figure, axis: Axes, samples: Samples) -> None:
    """What is shown, and the legend of one panel, above all panels."""
    handles, labels = axis.get_legend_handles_labels()
    columns = len(labels) if figure.get_figwidth() > 6 else 1
    title = caption(samples)
    figure.legend(handles, labels, loc="outside upper left", ncols=columns, title=title, alignment="left")


def caption(samples: Samples) -> str:
    failed = int((~samples.alive).sum())
    return f"{samples.specimen}, {len(samples.totals)} evaluations" + (f", {failed} failed (×)" if failed else "")


def axis_label(parameter: Parameter) -> str:
    return symbol(parameter.name) + (f" ({parameter.unit})" if parameter.unit not in ("", "1") else "")


def colour_bar(bar: Any) -> None:
    """Ticks of a logarithmic colour bar as plain numbers."""
    low, high = bar.mappable.norm.vmin, bar.mappable.norm.vmax
    ticks = round_numbers(low, high)
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.minorticks_off()


def plain_log(axis: Axes) -> None:
    """Ticks of a logarithmic ordinate as plain numbers, also within a decade."""
    low, high = axis.get_ylim()
    ticks = round_numbers(low, high)
    axis.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axis.minorticks_off()
    axis.set_ylim(low, high)


def round_numbers(low: float, high: float) -> list[float]:
    """Some 3 to 8 round numbers between two positive ones."""
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    for steps in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [float(f"{step * decade:.3g}") for decade in decades for step in steps]
        inside = [number for number in found if low <= number <= high]
        if len(inside) >= 3:
            return inside
    return [float(number) for number in MaxNLocator(5).tick_values(low, high) if low <= number <= high]


def apart(low: float, high: float) -> tuple[float, float]:
    """Two limits of a logarithmic scale, which must not be equal."""
    return (low, high) if high > 1.001 * low else (0.999 * low, 1.001 * low)
