"""Calibration: the curves of the fitted model beside the measured ones, the parameters, and how well they are known."""

from typing import Any

import numpy as np

from sinew.tasks.calibrate.result import CalibrateResult, SpecimenFit
from sinew.tasks.calibrate.show import bound_advice, in_words, unfinished
from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import (
    Block,
    Plot,
    Section,
    Table,
    Words,
    behind,
    listed,
    number,
    plural,
    times,
    unit_cell,
    with_its_unit,
)
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.model import FORCE, Protocol
from sinew.tasks.report.folder import ResultFolder, columns_of, protocols_of
from sinew.tasks.simulate.series import with_unit
from sinew.tasks.study.curves import POINTS

NAME = "calibration"
FEW = 3  # specimens whose parameters stand side by side in a table


def section(found: ResultFolder) -> Section:
    """Everything of ``calibrate.json``, and the fitted curves that the store holds."""
    title, question = "Calibration", "Which parameters bring the model closest to each specimen, and how close is that?"
    result = found.result(CalibrateResult)
    if result is None:
        return Section("calibration", title, question, missing=found.missing("calibrate"))
    specimens = result.specimens
    fitted = {name: curves for name, fit in specimens.items() if (curves := _fitted(found, name, fit))}
    blocks: list[Block] = []
    if fitted:
        every_protocol = dict.fromkeys(protocol for every in fitted.values() for protocol in every)
        protocols, more = plots.first(every_protocol, "protocols")
        blocks.append(
            plots.picked(
                "calibration-curves",
                f"Measured curve and calibrated model, and below what the model leaves: measured less model.{more}",
                "Specimen",
                {name: _sources(every, protocols) for name, every in fitted.items()},
                lambda sources: _draw_fit(sources, protocols, _units(result)),
                {name: _in_words(specimens[name]) for name in fitted},
            )
        )
    else:
        blocks.append(Words("The curves of the fitted model are not in the store: they are drawn in figures/.", "note"))
    if cut := unfinished(result):
        blocks.append(Words(cut, "warning"))
    if advice := bound_advice(result):
        blocks.append(Words(advice, "note"))
    if len(specimens) <= FEW:
        blocks.append(_values(result))
    if len(specimens) > 1:
        blocks.append(_parameters(result))
    blocks += [_search(result), _table(result)]
    some = " in some specimens" if len(specimens) > 1 else ""
    above = [fit.above_noise for fit in specimens.values() if fit.above_noise is not None]
    bounds = sorted({name for fit in specimens.values() for name in fit.on_bound})
    free = [name for name in result.free if any(name not in fit.determined for fit in specimens.values())]
    middle = float(np.median([fit.total for fit in specimens.values()]))
    ends = f"{'median ' if some else ''}objective {in_words([middle], list(specimens.values()))}"
    if above:
        ends += f", {times(float(np.median(above)))} times what noise alone would leave{' (median)' if some else ''}"
    if len(above) < len(specimens):
        ends += f"; the curves of {plural(len(specimens) - len(above), 'specimen')} do not tell their noise"
    return Section(
        "calibration",
        title,
        question,
        blocks,
        found=f"{plural(len(specimens), 'specimen')}: {ends}",
        sure=(f"not determined{some}: {listed(free)}" if free else "all parameters are determined"),
        failed=f"on a bound{some}: {listed(bounds)}" if bounds else "",
    )


def _units(result: CalibrateResult) -> dict[str, str]:
    """The units of the quantities that are compared beside the force; none where it is the force alone."""
    first = next(iter(result.specimens.values()))
    return {name: one.unit for name, one in (first.quantities or {}).items() if name != FORCE}


def _fitted(found: ResultFolder, name: str, fit: SpecimenFit) -> dict[str, dict[str, Any]]:
    """Measured and simulated forces at the calibrated parameters by protocol, as the store holds them."""
    for table in found.tables.get(name, []):
        row = table.find(np.array([fit.values(table.names)]))
        if row[0] < 0 or table.status[row[0]] != 0:
            continue
        curves = {}
        for protocol in protocols_of(table):
            time, moved, force = columns_of(table, protocol)
            model = table.read(f"force_{protocol}", row)[0]
            keep = drawn_points(Protocol(protocol, time, moved), force, model, count=POINTS)
            kept = {"time": time[keep], "displacement": moved[keep], "measured": force[keep], "model": model[keep]}
            curves[protocol] = kept | {"left": kept["measured"] - kept["model"]}
            for quantity in fit.quantities or ():
                seen = table.coordinate(f"measured_{quantity}_{protocol}")
                if quantity == FORCE or seen is None:
                    continue
                model = table.read(f"{quantity}_{protocol}", row)[0]
                there = np.flatnonzero(np.isfinite(seen))
                own = {"time": time[there], "measured": seen[there], "model": model[there]}
                curves[f"{protocol}: {quantity}"] = own | {"left": own["measured"] - own["model"]}
        return curves
    return {}


def _sources(every: dict[str, dict[str, Any]], protocols: list[str]) -> dict[str, dict[str, Any]]:
    empty = dict.fromkeys(("time", "displacement", "measured", "model", "left"), np.zeros(0))
    return {protocol: every.get(protocol, empty) for protocol in protocols}


def _draw_fit(sources: plots.Sources, protocols: list[str], units: dict[str, str]) -> list[Plot]:
    """A plot for each of ``protocols``: of the force, or ``PROTOCOL: QUANTITY`` of a quantity of ``units``."""
    drawn: list[Plot] = []
    for protocol in protocols:
        quantity = next((name for name in units if protocol.endswith(f": {name}")), FORCE)
        if quantity != FORCE:
            drawn.append(_draw_quantity(sources[protocol], protocol, quantity, units[quantity], len(drawn)))
            continue
        fit = plots.figure("time (s)", "force (N)")
        measured = fit.line("time", "measured", source=sources[protocol], color=plots.MEASURED, line_width=3.2)
        model = fit.line("time", "model", source=sources[protocol], color=COLOURS[1], line_width=1.3)
        plots.legend(fit, [(f"{protocol.replace('_', ' ')}: measured", [measured]), ("model", [model])])
        rows = [("time", "@time{0.00} s"), ("measured", "@measured{0.0} N"), ("model", "@model{0.0} N")]
        plots.hover(fit, model, rows)
        left = plots.figure("time (s)", "measured less model (N)", height=190, x_range=fit.x_range)
        left.line("time", "left", source=sources[protocol], color=COLOURS[1], line_width=0.9)
        dots = left.scatter("time", "left", source=sources[protocol], color=COLOURS[1], size=2.5)
        plots.hover(left, dots, [("time", "@time{0.00} s"), ("left", "@left{0.00} N")])
        left.hspan(0.0, line_color=plots.INK, line_width=0.7)
        label = f"{protocol}: measured and fitted force, and what the fitted model leaves"
        drawn.append(plots.plot(f"calibration-fit-{len(drawn)}", fit, label, below=left))
    return drawn


def _draw_quantity(source: Any, title: str, quantity: str, unit: str, number_: int) -> Plot:
    """What was measured of a quantity and the fitted model, at the points that are kept, and what the model leaves."""
    fit = plots.figure("time (s)", with_its_unit(quantity.replace("_", " "), unit))
    measured = fit.scatter("time", "measured", source=source, color=plots.MEASURED, size=4)
    model = fit.line("time", "model", source=source, color=COLOURS[1], line_width=1.3)
    plots.legend(fit, [(f"{title.replace('_', ' ')}, measured", [measured]), ("model", [model])])
    rows = [("time", "@time{0.00} s"), ("measured", f"@measured{behind(unit)}"), ("model", f"@model{behind(unit)}")]
    plots.hover(fit, model, rows)
    left = plots.figure("time (s)", "measured less model", height=190, x_range=fit.x_range)
    dots = left.scatter("time", "left", source=source, color=COLOURS[1], size=2.5)
    plots.hover(left, dots, [("time", "@time{0.00} s"), ("left", f"@left{behind(unit)}")])
    left.hspan(0.0, line_color=plots.INK, line_width=0.7)
    label = f"{title}: measured and fitted, and what the fitted model leaves"
    return plots.plot(f"calibration-fit-{number_}", fit, label, below=left)


def _in_words(fit: SpecimenFit) -> str:
    parts = [f"RMSE {', '.join(f'{name} {_error(fit, name)}' for name in fit.rmse_N)}"]
    for quantity, one in (fit.quantities or {}).items():
        if quantity != FORCE:
            unit = behind(one.unit)
            errors = ", ".join(f"{name} {number(rmse, 3)}{unit}" for name, rmse in one.rmse.items())
            parts.append(f"{quantity.replace('_', ' ')}: RMSE {errors}, noise {number(one.noise, 3)}{unit}")
    parts.append(f"by {fit.method.replace('_', ' ')}{', not converged' if fit.unfinished else ''}")
    if fit.on_bound:
        parts.append(f"on a bound: {', '.join(fit.on_bound)}")
    if fit.confounded:
        pair = fit.confounded[0]
        parts.append(f"hard to tell apart: {' and '.join(pair.parameters)} ({pair.correlation:+.2f})")
    return "; ".join(parts)


def _error(fit: SpecimenFit, protocol: str) -> str:
    """The error of a protocol in newton, in % of the peak force, and as R2."""
    r2 = fit.r2[protocol]
    as_r2 = f", R² {_r2(r2)}" if r2 is not None else ""
    return f"{number(fit.rmse_N[protocol])} N ({number(fit.percent_of_peak(protocol), 2)} % of the peak{as_r2})"


def _r2(value: float) -> str:
    """R2 with digits enough to tell it from 1."""
    return f"{value:.4f}" if value < 0.99995 else "above 0.9999"


def _values(result: CalibrateResult) -> Table:
    """Every parameter of a few specimens."""
    width = {name: high - low for name, (low, high) in zip(result.free, result.bounds, strict=True)}
    rows = []
    for name, unit, meaning in zip(result.names, result.units, result.meanings, strict=True):
        cells = []
        for fit in result.specimens.values():
            value = number(fit.parameters[name], 4)
            if name not in width:
                value += " (fixed)"
            elif name not in fit.determined:
                value += " (not determined)"
            elif name in fit.on_bound:
                value += " (on a bound)"
            else:
                value += f" ± {number(fit.sd_of_range[name] * width[name], 2)}"
            cells.append(value)
        rows.append([name, unit_cell(unit), meaning, *cells])
    header = ["parameter", "unit", "what it is", *result.specimens]
    return Table(
        "Calibrated parameters ± standard deviation, from the curvature at the fit", header, rows, words=(1, 2)
    )


def _parameters(result: CalibrateResult) -> Block:
    """A parameter of all specimens; those that are not determined are open."""
    specimens = result.specimens
    units = dict(zip(result.names, result.units, strict=True))
    names = list(specimens)

    def values(parameter: str) -> dict[str, Any]:
        found: dict[str, dict[str, Any]] = {
            kind: {"specimen": [], "value": [], "spread": []} for kind in ("determined", "free")
        }
        for name, fit in specimens.items():
            kind = found["determined" if parameter in fit.determined else "free"]
            kind["specimen"].append(name)
            kind["value"].append(fit.parameters[parameter])
            kind["spread"].append(100 * fit.sd_of_range.get(parameter, np.nan))
        for kind in found.values():  # a legend shows the marker of the first point, so there must be one
            kind["specimen"].append(names[0])
            kind["value"].append(np.nan)
            kind["spread"].append(np.nan)
        return found

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure(
            "value", "", height=max(220, 90 + 17 * len(names)), y_range=[*map(plots.plain, names)][::-1]
        )
        entries = []
        for kind, style, label in (
            ("determined", {"marker": "circle", "fill_color": COLOURS[0]}, "determined by the curves"),
            ("free", {"marker": "square", "fill_color": "white"}, "not determined"),
        ):
            dots = plot.scatter("value", "specimen", source=sources[kind], size=8, line_color=COLOURS[0], **style)
            rows = [("specimen", "@specimen"), ("value", "@value{0.0000}"), ("sd", "@spread{0.0} % of the range")]
            plots.hover(plot, dots, rows)
            entries.append((label, [dots]))
        plots.legend(plot, entries)
        return [plots.plot("calibration-values", plot, "The picked parameter of every specimen", wide=True)]

    what = dict(zip(result.names, result.meanings, strict=True))
    words = {
        name: f"{name}{'' if units[name] == '1' else f' ({units[name]})'}{what[name] and ': '}{what[name]}"
        for name in result.free
    }
    data = {name: values(name) for name in result.free}
    return plots.picked(
        "calibration-parameters", "Calibrated parameters of all specimens.", "Parameter", data, draw, words
    )


def _search(result: CalibrateResult) -> Block:
    """How the objective of each specimen fell."""
    specimens, first = result.specimens, next(iter(result.specimens.values()))

    def lines(method: str) -> dict[str, Any]:
        xs, ys, names = [], [], []
        for name, fit in specimens.items():
            trace = fit.methods[method].trace if method in fit.methods else []
            used = [each[0] for each in trace]
            xs += [*used, np.nan]
            ys += [*(each[1] for each in trace), np.nan]
            names += [name] * (len(used) + 1)
        return {"trace": {"used": xs, "total": ys, "specimen": names}}

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure("evaluations", f"lowest objective so far ({first.unit})", y_axis_type="log")
        plot.step("used", "total", source=sources["trace"], mode="after", color=COLOURS[0], alpha=0.6)
        dots = plot.scatter("used", "total", source=sources["trace"], size=3, color=COLOURS[0])
        rows = [("specimen", "@specimen"), ("evaluations", "@used"), ("objective", f"@total{{0.00}}{first.behind}")]
        plots.hover(plot, dots, rows)
        return [
            plots.plot("calibration-search", plot, "The lowest objective of each specimen over evaluations", wide=True)
        ]

    data = {method.replace("_", " "): lines(method) for method in result.methods}
    return plots.picked("calibration-searches", "How the search went, a line for each specimen.", "Method", data, draw)


def _table(result: CalibrateResult) -> Table:
    rows = []
    for name, fit in result.specimens.items():
        worst = max((fit.percent_of_peak(protocol) for protocol in fit.rmse_N), default=np.nan)
        lowest = min((r2 for r2 in fit.r2.values() if r2 is not None), default=None)
        rows.append([name, number(fit.total_N, 4), number(fit.noise_N, 4), times(fit.above_noise), number(worst, 2),
                     "–" if lowest is None else _r2(lowest),
                     ", ".join(fit.on_bound) or "–", ", ".join(result.not_determined(fit)) or "–",
                     *(number(value, 4) for value in fit.sums().values()),
                     *(number(value, 4) for value in fit.values(result.names))])  # fmt: skip
    header = ["specimen", "sum of RMSEs (N)", "sum of noise (N)", "RMSE / noise",
              "largest RMSE (% of peak)", "lowest R²", "on a bound", "not determined",
              *(f"{with_unit(name, unit)}, sum of RMSEs" for name, unit in _units(result).items()),
              *map(with_its_unit, result.names, result.units)]  # fmt: skip
    return Table("Fits of all specimens", header, rows, words=(6, 7), open=len(rows) <= 3)
