"""Calibration: the curves of the fitted model beside the measured ones, the parameters, and how well they are known."""

from typing import Any

import numpy as np

from tasks.calibrate import often_on_bound
from tasks.evaluate import kept_points
from tasks.model import Protocol
from tasks.report import plots
from tasks.report.blocks import Block, Plot, Section, Table, Words, beyond, listed, meanings, number, plural
from tasks.report.figures import COLOURS
from tasks.report.folder import POINTS, Found, columns_of

FEW = 3  # specimens whose parameters stand side by side in a table


def section(found: Found) -> Section:
    """Everything of ``calibrate.json``, and the fitted curves that the store holds."""
    title, question = "Calibration", "Which parameters bring the model closest to each specimen, and how close is that?"
    result = found.results.get("calibrate")
    if result is None:
        return Section("calibration", title, question, missing=found.missing("calibrate"))
    specimens = result["specimens"]
    fitted = {name: curves for name, told in specimens.items() if (curves := _fitted(found, name, told))}
    blocks: list[Block] = []
    if fitted:
        protocols = list(dict.fromkeys(protocol for every in fitted.values() for protocol in every))
        blocks.append(
            plots.picked(
                "calibration-curves",
                "Measured curve and calibrated model, and below what the model leaves: measured less model.",
                "Specimen",
                {name: _sources(every, protocols) for name, every in fitted.items()},
                lambda sources: _draw_fit(sources, protocols),
                {name: _in_words(specimens[name]) for name in fitted},
            )
        )
    else:
        blocks.append(Words("The curves of the fitted model are not in the store: they are drawn in figures/.", "note"))
    if told := often_on_bound(result):
        blocks.append(Words(told, "note"))
    if len(specimens) <= FEW:
        blocks.append(_values(result))
    if len(specimens) > 1:
        blocks.append(_parameters(result))
    blocks += [_search(result), _table(result)]
    above = [told["above_noise"] for told in specimens.values() if told["above_noise"] is not None]
    bounds = sorted({name for told in specimens.values() for name in told["on_bound"]})
    free = [name for name in result["free"] if any(name not in told["determined"] for told in specimens.values())]
    totals = [told["total_N"] for told in specimens.values()]
    ends = f"median objective {number(float(np.median(totals)))} N"
    if above:
        ends += f", above the noise of the curves: {beyond(float(np.median(above)))} (median)"
    if len(above) < len(specimens):
        ends += f"; the curves of {plural(len(specimens) - len(above), 'specimen')} do not tell their noise"
    return Section(
        "calibration",
        title,
        question,
        blocks,
        found=f"{plural(len(specimens), 'specimen')}: {ends}",
        sure=(f"not determined in some specimens: {listed(free)}" if free else "all parameters are determined"),
        failed=f"on a bound in some specimens: {listed(bounds)}" if bounds else "",
    )


def _fitted(found: Found, name: str, told: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Measured and simulated forces at the calibrated parameters by protocol, as the store holds them."""
    for table in found.tables.get(name, []):
        names = [str(each) for each in np.asarray(table.group["parameter"][:])]  # type: ignore[index]
        row = table.find(np.array([[told["parameters"][each] for each in names]]))
        if row[0] < 0 or table.status[row[0]] != 0:
            continue
        curves = {}
        for protocol in map(str, np.asarray(table.group["protocol"][:])):  # type: ignore[index]
            time, moved, force = columns_of(table, protocol)
            model = table.read(f"force_{protocol}", row)[0]
            keep = kept_points(Protocol(protocol, time, moved), POINTS)
            kept = {"time": time[keep], "displacement": moved[keep], "measured": force[keep], "model": model[keep]}
            curves[protocol] = kept | {"left": kept["measured"] - kept["model"]}
        return curves
    return {}


def _sources(every: dict[str, dict[str, Any]], protocols: list[str]) -> dict[str, dict[str, Any]]:
    empty = dict.fromkeys(("time", "displacement", "measured", "model", "left"), np.zeros(0))
    return {protocol: every.get(protocol, empty) for protocol in protocols}


def _draw_fit(sources: plots.Sources, protocols: list[str]) -> list[Plot]:
    drawn: list[Plot] = []
    for protocol in protocols:
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


def _in_words(told: dict[str, Any]) -> str:
    parts = [f"RMSE {', '.join(f'{name} {number(value)} N' for name, value in told['rmse_N'].items())}"]
    parts.append(f"by {told['method'].replace('_', ' ')}")
    if told["on_bound"]:
        parts.append(f"on a bound: {', '.join(told['on_bound'])}")
    if told["confounded"]:
        pair = told["confounded"][0]
        parts.append(f"hard to tell apart: {' and '.join(pair['parameters'])} ({pair['correlation']:+.2f})")
    return "; ".join(parts)


def _values(result: dict[str, Any]) -> Table:
    """Every parameter of a few specimens."""
    width = {name: high - low for name, (low, high) in zip(result["free"], result["bounds"], strict=True)}
    rows = []
    for name, unit, meaning in zip(result["names"], result["units"], meanings(result), strict=True):
        cells = []
        for told in result["specimens"].values():
            value = number(told["parameters"][name], 4)
            if name not in width:
                value += " (fixed)"
            elif name not in told["determined"]:
                value += " (not determined)"
            elif name in told["on_bound"]:
                value += " (on a bound)"
            else:
                value += f" ± {number(told['sd_of_range'][name] * width[name], 2)}"
            cells.append(value)
        rows.append([name, "" if unit == "1" else unit, meaning, *cells])
    header = ["parameter", "unit", "what it is", *result["specimens"]]
    return Table(
        "Calibrated parameters ± standard deviation, from the curvature at the fit", header, rows, words=(1, 2)
    )


def _parameters(result: dict[str, Any]) -> Block:
    """A parameter of all specimens; those that are not determined are open."""
    specimens = result["specimens"]
    units = dict(zip(result["names"], result["units"], strict=True))
    names = list(specimens)

    def values(parameter: str) -> dict[str, Any]:
        found: dict[str, dict[str, Any]] = {
            kind: {"specimen": [], "value": [], "spread": []} for kind in ("determined", "free")
        }
        for name, told in specimens.items():
            kind = found["determined" if parameter in told["determined"] else "free"]
            kind["specimen"].append(name)
            kind["value"].append(told["parameters"][parameter])
            kind["spread"].append(100 * told["sd_of_range"].get(parameter, np.nan))
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

    what = dict(zip(result["names"], meanings(result), strict=True))
    told = {
        name: f"{name}{'' if units[name] == '1' else f' ({units[name]})'}{what[name] and ': '}{what[name]}"
        for name in result["free"]
    }
    data = {name: values(name) for name in result["free"]}
    return plots.picked(
        "calibration-parameters", "Calibrated parameters of all specimens.", "Parameter", data, draw, told
    )


def _search(result: dict[str, Any]) -> Block:
    """How the objective of each specimen fell."""
    specimens = result["specimens"]

    def lines(method: str) -> dict[str, Any]:
        xs, ys, names = [], [], []
        for name, told in specimens.items():
            trace = told["methods"].get(method, {}).get("trace", [])
            used = [each[0] for each in trace]
            xs += [*used, np.nan]
            ys += [*(each[1] for each in trace), np.nan]
            names += [name] * (len(used) + 1)
        return {"trace": {"used": xs, "total": ys, "specimen": names}}

    def draw(sources: plots.Sources) -> list[Plot]:
        plot = plots.figure("evaluations", "lowest objective so far (N)", y_axis_type="log")
        plot.step("used", "total", source=sources["trace"], mode="after", color=COLOURS[0], alpha=0.6)
        dots = plot.scatter("used", "total", source=sources["trace"], size=3, color=COLOURS[0])
        rows = [("specimen", "@specimen"), ("evaluations", "@used"), ("objective", "@total{0.00} N")]
        plots.hover(plot, dots, rows)
        return [
            plots.plot("calibration-search", plot, "The lowest objective of each specimen over evaluations", wide=True)
        ]

    data = {method.replace("_", " "): lines(method) for method in result["methods"]}
    return plots.picked("calibration-searches", "How the search went, a line for each specimen.", "Method", data, draw)


def _table(result: dict[str, Any]) -> Table:
    rows = []
    for name, told in result["specimens"].items():
        free = [parameter for parameter in result["free"] if parameter not in told["determined"]]
        rows.append([name, number(told["total_N"], 4), number(told["noise_N"], 4), beyond(told["above_noise"]),
                     ", ".join(told["on_bound"]) or "–", ", ".join(free) or "–",
                     *(number(told["parameters"][each], 4) for each in result["names"])])  # fmt: skip
    units = ["" if unit == "1" else f" ({unit})" for unit in result["units"]]
    header = ["specimen", "RMSEs together (N)", "noise together (N)", "above the noise", "on a bound", "not determined",
              *(f"{name}{unit}" for name, unit in zip(result["names"], units, strict=True))]  # fmt: skip
    return Table("Fits of all specimens", header, rows, words=(4, 5), open=len(rows) <= 3)
