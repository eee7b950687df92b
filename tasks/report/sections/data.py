"""Data: the specimens, their curves, and what is known of both; without measured forces, how far they are pulled."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plot, Section, Table, behind, number, plural, span, with_its_unit
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.study.curves import POINTS, MeasuredCurve, MeasuredQuantity

MOST_QUANTITIES = 20  # that have plots of their own
AXES = {
    "time": "time (s)",
    "displacement": "displacement (mm)",
    "force": "force (N)",
    "strain": "strain, displacement / length (%)",
    "stress": "nominal stress, force / area (MPa)",
}
TOOLTIPS = {
    "time": ("time", "@time{0.00} s"),
    "displacement": ("displacement", "@displacement{0.0000} mm"),
    "force": ("force", "@force{0.0} N"),
    "strain": ("strain", "@strain{0.000} %"),
    "stress": ("stress", "@stress{0.0000} MPa"),
}
FORCES, STRESSES, DISPLACEMENTS = (
    (("time", "force"), ("displacement", "force")),
    (("strain", "stress"),),
    (("time", "displacement"),),
)


def section(found: ResultFolder) -> Section:
    """All measured curves that the folder holds."""
    title, question = "Data", "What was measured?"
    measured = found.measured
    if not measured:
        return Section("data", title, question, missing=f"No curves are kept here yet: `sinew run {found.study}`.")
    curves = [(name, protocol, curve) for name, every in measured.items() for protocol, curve in every.items()]
    sites = sorted({name.rpartition("/")[0] for name in measured} - {""})
    protocols = list(dict.fromkeys(protocol for _, protocol, _ in curves))
    drawn, more = plots.first(protocols, "protocols")
    largest = max(curve.total for *_, curve in curves)
    bars = {name: _geometry(found, name) for name in measured}
    sized = found.forces and any(map(_sizes, bars.values()))
    across = FORCES + (STRESSES if sized else ()) if found.forces else DISPLACEMENTS
    what = "Measured curves" if found.forces else "Nothing was measured: displacements that the study asks for"
    quantities = {
        quantity: one.unit for *_, curve in curves for quantity, one in curve.others.items() if one.values.size
    }
    quantities = dict(islice(quantities.items(), MOST_QUANTITIES))
    blocks: list[Block] = [
        plots.picked(
            "data-curves",
            f"{what}, each at up to {plural(min(largest, POINTS), 'point')} that represent it.{more}",
            "Specimen",
            {name: _sources(every, drawn, bars[name]) for name, every in measured.items()},
            lambda sources: _draw(sources, drawn, across),
        ),
        *([_beside(measured, drawn, quantities)] if quantities else []),
        _table(found, bars, quantities),
        *_read_from(measured),
    ]
    kind = "curve" if found.forces else "protocol"
    evaluated = len(set(found.tables) & set(measured))
    of = f" of {plural(len(sites), 'site')}" if sites else ""
    return Section(
        "data",
        title,
        question,
        blocks,
        found=f"{plural(len(measured), 'specimen')}{of}, {plural(len(curves), kind)} ({', '.join(protocols)})"
        + ("" if found.forces else "; nothing was measured")
        + (f"; {evaluated} of them evaluated" if 0 < evaluated < len(measured) else "")
        + (f"; compared beside the force: {', '.join(map(_words, quantities))}" if quantities else ""),
    )


def _beside(
    measured: Mapping[str, Mapping[str, MeasuredCurve]], protocols: list[str], quantities: Mapping[str, str]
) -> Block:
    """What is compared beside the force: a plot for each quantity, points in a colour for each protocol."""
    nothing = MeasuredQuantity("1", np.zeros(0), np.zeros(0))

    def sources(every: Mapping[str, MeasuredCurve]) -> dict[str, dict[str, Any]]:
        found = {}
        for quantity in quantities:
            for protocol in protocols:
                one = every[protocol].others.get(quantity, nothing) if protocol in every else nothing
                found[f"{protocol}: {quantity}"] = {"time": one.time_s, "value": one.values}
        return found

    def draw(drawn_of: plots.Sources) -> list[Plot]:
        drawn = []
        for count, (quantity, unit) in enumerate(quantities.items()):
            plot = plots.figure(AXES["time"], with_its_unit(_words(quantity), unit), height=320)
            entries = []
            for number_, protocol in enumerate(protocols):
                source = drawn_of[f"{protocol}: {quantity}"]
                dots = plot.scatter("time", "value", source=source, color=plots.colour(number_), size=4)
                plots.hover(plot, dots, [(protocol, ""), TOOLTIPS["time"], (_words(quantity), f"@value{behind(unit)}")])
                entries.append((protocol.replace("_", " "), [dots]))
            plots.legend(plot, entries)
            label = f"Measured {_words(quantity)} of the picked specimen over time, points for each protocol"
            drawn.append(plots.plot(f"data-beside-{count}", plot, label))
        return drawn

    return plots.picked(
        "data-beside",
        "What is compared beside the force, at the stored points at which it was measured.",
        "Specimen",
        {name: sources(every) for name, every in measured.items()},
        draw,
    )


def _words(quantity: str) -> str:
    return quantity.replace("_", " ")


def _sources(every: dict[str, MeasuredCurve], protocols: list[str], bar: dict[str, Any]) -> dict[str, dict[str, Any]]:
    empty = np.zeros(0)
    length, area = _sizes(bar) or (np.nan, np.nan)
    sources = {}
    for protocol in protocols:
        curve = every.get(protocol)
        time, moved, force = (empty,) * 3 if curve is None else (curve.time_s, curve.displacement_mm, curve.force_N)
        columns = {"time": time, "displacement": moved, "force": force}
        sources[protocol] = columns | {"strain": 100.0 * moved / length, "stress": force / area}
    return sources


def _sizes(bar: dict[str, Any]) -> tuple[float, float] | None:
    """Length (mm) and area (mm²) of a specimen; None where they are not known."""
    sides = [bar.get(f"{side}_mm") for side in ("length", "width", "thickness")]
    if not all(isinstance(side, int | float) and side > 0 for side in sides):
        return None
    length, width, thickness = (float(side or np.nan) for side in sides)
    return length, width * thickness


def _draw(sources: plots.Sources, protocols: list[str], axes: Sequence[tuple[str, str]]) -> list[Plot]:
    drawn: list[Plot] = []
    for across, up in axes:
        plot = plots.figure(AXES[across], AXES[up], height=320)
        entries = []
        for number_, protocol in enumerate(protocols):
            style = {"color": plots.colour(number_), "line_dash": plots.dash(number_), "line_width": 1.6}
            line = plot.line(across, up, source=sources[protocol], **style)
            shown = [TOOLTIPS[name] for name in dict.fromkeys(("time", across, up))]
            plots.hover(plot, line, [(protocol, ""), *shown])
            entries.append((protocol.replace("_", " "), [line]))
        plots.legend(plot, entries)
        what = {"force": "Measured force", "stress": "Measured nominal stress", "displacement": "Displacement"}[up]
        label = f"{what} of the picked specimen over {across}, a line for each protocol"
        drawn.append(plots.plot(f"data-{across}", plot, label, wide=len(axes) % 2 == 1 and across == axes[-1][0]))
    return drawn


def _table(found: ResultFolder, bars: Mapping[str, dict[str, Any]], quantities: Mapping[str, str]) -> Table:
    rows, square = [], False
    for name, every in found.measured.items():
        bar = bars[name]
        length, width, thickness = (bar.get(f"{side}_mm") or np.nan for side in ("length", "width", "thickness"))
        sizes = (length, width, thickness, width * thickness)
        peak = _farthest(np.concatenate([curve.force_N for curve in every.values()]))
        lasts = max(float(curve.time_s[-1] - curve.time_s[0]) for curve in every.values())
        points = sum(curve.total for curve in every.values())
        farthest = _farthest(np.concatenate([curve.displacement_mm for curve in every.values()]))
        stress, strain = peak / sizes[-1], 100.0 * farthest / length
        square |= width == thickness
        rows.append([name, ", ".join(every), *(number(size, 4) for size in sizes), number(lasts), f"{points:,}",
                     number(peak), number(stress), number(strain),
                     *(_reach(every, quantity) for quantity in quantities)])  # fmt: skip
    header = ["specimen", "protocols", "length (mm)", "width (mm)", "thickness (mm)", "area (mm²)", "time (s)",
              "points", "peak force (N)", "peak stress (MPa)", "peak strain (%)",
              *(with_its_unit(_words(name), unit) for name, unit in quantities.items())]  # fmt: skip
    title = "Specimens; width and thickness are equal where only the cross-section was given" if square else "Specimens"
    return Table(title, header, rows, words=(1,), open=len(rows) <= 6)


def _read_from(measured: Mapping[str, Mapping[str, MeasuredCurve]]) -> Iterator[Table]:
    """The file of each curve, which of its columns were read in which units, and what was changed."""
    rows = [
        [name, protocol, curve.source]
        for name, every in measured.items()
        for protocol, curve in every.items()
        if curve.source
    ]
    if rows:
        header = ["specimen", "protocol", "file, columns and units"]
        yield Table("Files that the curves were read from", header, rows, words=(1, 2), open=len(rows) <= 6)


def _farthest(values: Any) -> float:
    """The value of the largest size, with its sign: compression is negative."""
    return float(values[np.argmax(np.abs(values))])


def _reach(every: Mapping[str, MeasuredCurve], quantity: str) -> str:
    """From the smallest to the largest value of a quantity, over all protocols of a specimen."""
    values = [curve.others[quantity].values for curve in every.values() if quantity in curve.others]
    values = [each for each in values if each.size]
    return span(np.concatenate(values).tolist()) if values else "–"


def _geometry(found: ResultFolder, name: str) -> dict[str, Any]:
    """Sizes of a specimen, from its evaluations or from the log."""
    if name in found.tables:
        return dict(found.tables[name][0].identity["specimen"])
    for run in reversed(found.runs):
        sizes = run.get("specimens")
        if isinstance(sizes, dict) and isinstance(sizes.get(name), dict):
            return dict(sizes[name])
    return {}
