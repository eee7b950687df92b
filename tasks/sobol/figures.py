"""Figures of Sobol indices: by parameter, along time, and how they settle with the size of the design."""

from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.runner.store.store import open_store
from sinew.tasks.drawing.figures import COLOURS, PANELS, STYLE, save, symbol
from sinew.tasks.drawing.formats import protocols_of
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.sobol.field_figures import field_table, on_the_mesh, variables_of
from sinew.tasks.sobol.of_fields import stored_as
from sinew.tasks.sobol.result import WORDS, SobolResult
from sinew.tasks.sobol.show import beside, convergence_table, stored, table, time_table
from sinew.tasks.study.workspace import Workspace

SHOWN = 6  # parameters in figures along time and of the convergence
POINTS_OF_A_TURN = 8  # from one turn of a displacement to the next, so that lines between them show it
_DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
_MARKERS = "osv^D*"


def draw(workspace: Workspace, result: SobolResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    shown = table(result).rename_axis(["objective", "parameter"]).reset_index()
    save(indices(result), folder, "sobol", shown)
    if result.convergence.base_samples:
        save(convergence(result), folder, "sobol_convergence", convergence_table(result))
    for specimen, output in result.courses().values():
        name = result.tables[specimen]
        dataset = workspace.store.read_result(f"sobol_time/{name}", parameter=result.names)
        ending = "" if output is None else f"_{output}"
        figure = along_time(dataset, result.names, output, result.leading)
        save(figure, folder, f"sobol_time_{name}{ending}", time_table(dataset, output, result.leading))
    for specimen, protocol in result.field_courses().values():
        dataset = workspace.store.read_result(stored_as(specimen, protocol))
        for variable in variables_of(dataset):
            if (shown_on := on_the_mesh(dataset, variable)) is not None:
                name = f"sobol_field_{specimen}_{protocol}_{variable}"
                save(shown_on, folder, name, field_table(dataset, variable))


def _along_time(result: SobolResult, folder: Path, course: str) -> Figure:
    specimen, output = result.courses()[course]
    dataset = open_store(folder).read_result(f"sobol_time/{result.tables[specimen]}", parameter=result.names)
    return along_time(dataset, result.names, output, result.leading)


def indices(result: SobolResult) -> Figure:
    """Indices with intervals: the total objective above, each protocol below."""
    keys = result.keys[::2]
    shown = dict(islice(result.panels().items(), PANELS))
    with plt.rc_context(STYLE):
        height = 2.1 * len(shown) + 0.4
        figure, axes = plt.subplots(len(shown), 1, figsize=(7.5, height), sharex=True, squeeze=False)
        at = np.arange(len(result.names))
        for axis, (title, values) in zip(axes[:, 0], shown.items(), strict=True):
            for number, key in enumerate(keys):
                bars, errors = getattr(values, key), getattr(values, f"{key}_conf")
                shift, label = 0.8 * ((number + 0.5) / len(keys) - 0.5), WORDS[key].removesuffix(" index")
                axis.bar(
                    at + shift, bars, 0.76 / len(keys), yerr=errors, color=COLOURS[number], label=label,
                    error_kw={"lw": 0.8},
                )  # fmt: skip
            axis.axhline(0, color="black", lw=0.6)
            axis.set_title(title.replace("_", " "), loc="left", fontsize=9)
            axis.set_ylabel("part of the variance" if result.correlations else "Sobol index")
        axes[0, 0].legend(ncols=len(keys))
        axes[-1, 0].set_xticks(at, [symbol(name) for name in result.names])
        percent = round(100 * result.confidence)
        figure.suptitle(f"{result.rows:,} rows, {result.failed:,} failed; bars: {percent} % intervals", fontsize=9)
    return figure


def along_time(dataset: xr.Dataset, names: list[str], output: str | None = None, key: str = "ST") -> Figure:
    """Indices (``ST``, ``S1`` or ``Sh``) of the force, or of an ``output``, along each protocol: the largest of all.

    Below is what was measured, or the displacement where nothing was.
    """
    protocols = protocols_of(dataset)
    strongest = np.zeros(len(names))
    for protocol in protocols:
        index = dataset[stored(key, protocol, output)].to_numpy()
        strongest = np.fmax(strongest, np.nan_to_num(index).max(axis=1))
    chosen = np.argsort(-strongest)[:SHOWN]
    with plt.rc_context(STYLE):
        size = (3.4 * len(protocols) + 0.6, 4.6)
        figure, axes = plt.subplots(2, len(protocols), figsize=size, squeeze=False, sharex="col", height_ratios=(3, 1))
        for (above, below), protocol in zip(axes.T, protocols, strict=True):
            time = dataset[f"time_{protocol}"].to_numpy()
            apart = not _joined(dataset, protocol)
            for rank, j in enumerate(chosen):
                index, conf = (dataset[stored(each, protocol, output)].to_numpy()[j] for each in (key, f"{key}_conf"))
                colour = COLOURS[rank % len(COLOURS)]
                style: dict[str, Any] = {"linestyle": _DASHES[rank % len(_DASHES)], "lw": 1.3}
                style |= {"linestyle": "", "marker": ".", "ms": 4} if apart else {}
                above.plot(time, index, color=colour, label=symbol(names[j]), **style)
                if not apart:
                    above.fill_between(time, index - conf, index + conf, color=colour, alpha=0.15, lw=0)
            few = f", {time.size} points of it" if apart else ""
            above.set_title(f"{protocol.replace('_', ' ')}{few}", loc="left", fontsize=9)
            above.set_ylim(-0.02, None)
            kind, unit = beside(dataset, protocol, output)
            below.plot(time, dataset[f"{kind}_{protocol}"], "." if apart else "-", color="black", lw=0.9, ms=3)
            below.set_xlabel("time (s)")
        of = "the force" if output is None else output.replace("_", " ")
        axes[0, 0].set_ylabel(f"{WORDS[key]} of {of}")
        axes[1, 0].set_ylabel(f"{'measured' if kind == 'measured' else 'moved'} ({unit})")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(chosen))
        figure.supxlabel(f"specimen {dataset.attrs['specimen']}", fontsize=8, x=0.99, ha="right")
    return figure


def _joined(dataset: xr.Dataset, protocol: str) -> bool:
    """Whether the points of a protocol are so close that lines between them show its course.

    Of many cycles, few points are kept: lines would cut off their peaks.
    """
    name = f"displacement_{protocol}"
    if name not in dataset.variables:
        return True
    steps = np.diff(dataset[name].to_numpy())
    turns = np.count_nonzero(np.diff(np.sign(steps[steps != 0.0])))
    return bool(steps.size >= POINTS_OF_A_TURN * turns)


def convergence(result: SobolResult) -> Figure:
    """How the total order indices settle as the design grows."""
    curve = result.convergence
    sizes = np.array(curve.base_samples)
    chosen = np.argsort(-np.nan_to_num(curve.ST[-1]))[:SHOWN]
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(6, 3.6))
        for rank, j in enumerate(chosen):
            at = sizes * (1 + 0.02 * (rank - SHOWN / 2))
            label, marker = symbol(result.names[j]), _MARKERS[rank % len(_MARKERS)]
            axis.errorbar(at, curve.ST[:, j], curve.ST_conf[:, j], label=label, marker=marker, ms=4, lw=1, capsize=2)
        axis.set_xscale("log", base=2)
        axis.set_xticks(sizes, [f"{size:,}" for size in sizes], rotation=30)
        axis.minorticks_off()
        axis.set_xlabel(result.sample)
        axis.set_ylabel(f"total order index, {result.total}")
        axis.legend(ncols=3)
    return figure


FIGURES: Mapping[str, FigureKind[SobolResult]] = {
    "indices": FigureKind(lambda result, folder, _: indices(result)),
    "convergence": FigureKind(
        lambda result, folder, _: convergence(result),
        lambda result: ["total"] if result.convergence.base_samples else [],
    ),
    "time": FigureKind(_along_time, lambda result: list(result.courses())),
}
