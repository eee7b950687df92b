"""Figures of a calibration: how each search converged (4 in Pekedis 2025), and the fitted curves.

The points of a search, what a surrogate learns from them, and correlations have modules of their own:
``sample_figures``, ``surrogate_figures`` and ``correlation_figure``. The typical specimen, of which these are drawn, is
that of the median total objective.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from sinew.runner.errors import BadInput
from sinew.tasks.calibrate import correlation_figure, sample_figures, surrogate_figures
from sinew.tasks.calibrate.panels import Samples, plain_log
from sinew.tasks.calibrate.result import (
    CalibrateResult,
    Correlations,
    NoCorrelations,
    QuantityFit,
    SpecimenFit,
    search_group,
)
from sinew.tasks.calibrate.show import (
    convergence_table,
    correlations_table,
    curves_table,
    quantity_table,
    samples_table,
    searches_table,
)
from sinew.tasks.calibrate.task import fitted_curves
from sinew.tasks.drawing.blocks import behind
from sinew.tasks.drawing.figures import COLOURS, MEASURED, STYLE, headline, save
from sinew.tasks.drawing.formats import DRAWN
from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.drawing.views import FigureKind
from sinew.tasks.model import FORCE, Specimen, file_name
from sinew.tasks.simulate import Array
from sinew.tasks.study.workspace import Workspace


def draw(workspace: Workspace, result: CalibrateResult) -> None:
    """Write all figures, each with its table."""
    folder = workspace.out / "figures"
    save(calibration_convergence(result), folder, "calibrate_convergence", searches_table(result))
    for specimen in workspace.cohort.specimens:
        fit = result.specimens.get(specimen.name)
        if fit is not None:
            forces = fitted_curves(workspace, specimen, fit.parameters)
            figure = measured_and_fitted(specimen, forces, fit.rmse_N)
            save(figure, folder, f"calibrate_{file_name(specimen.name)}", curves_table(specimen, forces))
            for name, quantity in (fit.quantities or {}).items():
                if name != FORCE:
                    courses = fitted_curves(workspace, specimen, fit.parameters, name)
                    figure = quantity_and_fitted(specimen, courses, name, quantity)
                    table = quantity_table(specimen, name, quantity.unit, courses)
                    save(figure, folder, f"calibrate_{file_name(specimen.name)}_{name}", table)
    _draw_typical(workspace, result)


def _draw_typical(workspace: Workspace, result: CalibrateResult) -> list[Path]:
    """Write the figures of one typical specimen and of the correlations."""
    folder = workspace.out / "figures"
    name = result.typical
    fit = result.specimens[name]
    paths = save(convergence(name, fit), folder, "calibrate_typical_convergence", convergence_table(name, fit))
    if result.has_search:
        paths += _draw_search(samples_of(workspace, result, name), folder)
    found = result.correlations
    if isinstance(found, Correlations):
        drawn = correlation_figure.correlation_matrix(found)
        paths += save(drawn, folder, "calibrate_correlations", correlations_table(found))
    return paths


def _draw_search(samples: Samples, folder: Path) -> list[Path]:
    if samples.alive.sum() < 2:  # there is nothing to learn from
        return []
    surrogate = surrogate_figures.learned(samples)
    paths = save(
        surrogate_figures.influences(samples, surrogate),
        folder,
        "calibrate_surrogate_all",
        surrogate_figures.influence_table(samples, surrogate),
    )
    if len(samples.parameters) > 1:
        names = [parameter.name for parameter in samples.parameters]
        sampled = samples_table(names, samples.points, samples.totals, samples.calibrated, samples.ending)
        paths += save(sample_figures.all_samples(samples), folder, "calibrate_samples_all", sampled)
        paths += save(sample_figures.paired_samples(samples), folder, "calibrate_samples", sampled)
        paired = surrogate_figures.pair_table(samples, surrogate)
        paths += save(surrogate_figures.paired_influences(samples, surrogate), folder, "calibrate_surrogate", paired)
    return paths


def _correlations(result: CalibrateResult, folder: Path) -> Figure:
    found = result.correlations
    if isinstance(found, NoCorrelations):
        raise BadInput(folder / "calibrate.json", "holds no correlations", f"more specimens ({found.reason})")
    return correlation_figure.correlation_matrix(found)


def samples_of(workspace: Workspace, result: CalibrateResult, specimen: str) -> Samples:
    """The stored search of a specimen. Raises :class:`sinew.runner.errors.StoreError` when there is none."""
    kept = workspace.store.read_result(search_group(specimen))
    free = workspace.model.free
    names = [parameter.name for parameter in free]
    fit = result.specimens[specimen]
    return Samples(
        specimen,
        free,
        kept["parameters"].sel(parameter=names).to_numpy(),
        kept["total"].to_numpy(),
        np.array(fit.values(names), dtype=float),
        fit.method,
        fit.unit,
    )


def convergence(specimen: str, fit: SpecimenFit) -> Figure:
    """The best objective so far of each method (figure 4), and the noise of the curves where it is known."""
    with plt.rc_context(STYLE):
        figure, axis = plt.subplots(figsize=(5.2, 3.4))
        # the hybrid begins as the Bayesian search: drawn below it, both can be seen
        order = sorted(fit.methods, key=lambda method: -fit.methods[method].trace[-1][0])
        for number, method in enumerate(order):
            used, totals = fit.methods[method].steps.T
            label = f"{method.replace('_', ' ')}: {totals[-1]:.3g}{fit.behind}"
            style: Any = {"color": COLOURS[number], "lw": 2.6 - 0.8 * number, "label": label}
            axis.step(used, totals, where="post", **style)
            axis.plot(used[-1], totals[-1], "o", ms=4, color=COLOURS[number])
        if fit.floor:
            axis.axhline(fit.floor, color="0.4", lw=1, ls="--", label=f"noise: {fit.floor:.3g}{fit.behind}")
        axis.set_yscale("log")
        plain_log(axis)
        axis.set_xlabel("evaluations")
        axis.set_ylabel(f"lowest total objective so far ({fit.unit})")
        axis.set_title(specimen, loc="left", fontsize=9)
        axis.legend()
    return figure


def calibration_convergence(result: CalibrateResult) -> Figure:
    """How far above the noise of its curves each specimen's objective is, against evaluations: a panel by method."""
    methods = result.methods
    with plt.rc_context(STYLE):
        size = (3.4 * len(methods) + 0.6, 3.2)
        figure, axes = plt.subplots(1, len(methods), figsize=size, sharex=True, sharey=True, squeeze=False)
        for axis, method in zip(axes[0], methods, strict=True):
            ends = []
            for fit in result.specimens.values():
                found = fit.methods.get(method)
                if found is None or not fit.floor:
                    continue
                used, totals = found.steps.T
                above = np.maximum(100 * (totals / fit.floor - 1.0), 0.1)
                axis.step(used, above, where="post", color=COLOURS[0], lw=0.7, alpha=0.6)
                ends.append(above[-1])
            if ends:  # the noise is known
                axis.set_xscale("log")
                axis.set_yscale("log")
            axis.set_xlabel("evaluations")
            middle = f", median {np.median(ends):.3g} %" if ends else ""
            axis.set_title(f"{method.replace('_', ' ')}{middle}", loc="left", fontsize=9)
        axes[0, 0].set_ylabel("objective above the noise (%)")
    return figure


def measured_and_fitted(specimen: Specimen, forces: Mapping[str, Array], rmse_N: Mapping[str, float]) -> Figure:
    """Measured curves and the calibrated model: over time above, over displacement below."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(2, len(specimen.curves), figsize=(3.2 * len(specimen.curves), 5.0), squeeze=False)
        for column, curve in enumerate(specimen.curves):
            history = curve.protocol
            keep = drawn_points(history, curve.force_N, forces[curve.name], count=DRAWN)
            for axis, across in zip(axes[:, column], (history.time_s, history.displacement_mm), strict=True):
                axis.plot(across[keep], curve.force_N[keep], color=MEASURED, lw=1.6, label="measured", rasterized=True)
                axis.plot(
                    across[keep], forces[curve.name][keep], color=COLOURS[1], lw=0.7, label="model", rasterized=True
                )
            axes[0, column].set_title(f"{curve.name.replace('_', ' ')}: RMSE {rmse_N[curve.name]:.3g} N", fontsize=9)
            axes[0, column].set_xlabel("time (s)")
            axes[1, column].set_xlabel("displacement (mm)")
        for axis in axes[:, 0]:
            axis.set_ylabel("force (N)")
        axes[1, -1].legend()
        headline(figure, specimen.name, 10)
    return figure


def quantity_and_fitted(specimen: Specimen, courses: Mapping[str, Array], name: str, quantity: QuantityFit) -> Figure:
    """A quantity that is compared beside the force: what was measured and the calibrated model, over time."""
    unit = behind(quantity.unit)
    with plt.rc_context(STYLE):
        size = (3.2 * len(specimen.curves), 2.8)
        figure, axes = plt.subplots(1, len(specimen.curves), figsize=size, squeeze=False)
        for axis, curve in zip(axes[0], specimen.curves, strict=True):
            time_s = curve.protocol.time_s
            axis.plot(time_s, curve.others[name], ".", ms=2, color=MEASURED, label="measured", rasterized=True)
            axis.plot(time_s, courses[curve.name], color=COLOURS[1], lw=0.7, label="model", rasterized=True)
            title = f"{curve.name.replace('_', ' ')}: RMSE {quantity.rmse[curve.name]:.3g}{unit}"
            axis.set_title(title, fontsize=9)
            axis.set_xlabel("time (s)")
        axes[0, 0].set_ylabel(name.replace("_", " ") + ("" if not unit else f" ({quantity.unit})"))
        axes[0, -1].legend()
        headline(figure, specimen.name, 10)
    return figure


FIGURES: Mapping[str, FigureKind[CalibrateResult]] = {
    "convergence": FigureKind(lambda result, folder, _: calibration_convergence(result)),
    "search": FigureKind(
        lambda result, folder, specimen: convergence(specimen, result.specimens[specimen]),
        lambda result: list(result.specimens),
    ),
    "correlations": FigureKind(lambda result, folder, _: _correlations(result, folder)),
}
