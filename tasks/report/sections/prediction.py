"""Prediction: bands around the curves, and how many of the measured points they hold."""

from typing import Any

import numpy as np
import xarray as xr

from tasks.report import plots
from tasks.report.blocks import Block, Plot, Section, Table, Words, number, percent, plural
from tasks.report.figures import COLOURS
from tasks.report.folder import Found

BANDS = {"hdi": "mean and HDI bounds", "draws": "draws from the posterior", "new": "a new specimen"}


def section(found: Found) -> Section:
    """Everything of ``predict.json`` and the bands in the store."""
    title, question = "Prediction", "Do the bands hold the measured curves, also of specimens that they do not know?"
    result = found.results.get("predict")
    if result is None:
        return Section("prediction", title, question, missing=found.missing("predict"))
    blocks: list[Block] = [_table(result)]
    if found.store is not None:
        blocks.insert(0, _bands(result, {site: found.store.read_result(f"predict/{site}") for site in result["sites"]}))
    for site, told in result["sites"].items():
        blocks += [Words(f"{site}: {why}", "note") for why in (told["no_new"], told["no_stresses"]) if why]
    inside = {band: told["all"] for band, told in result["coverage"].items() if told["all"] is not None}
    points = plural(max(int(result["coverage"][band].get("points") or 0) for band in BANDS), "point")
    return Section(
        "prediction", title, question, blocks,
        found="measured points inside: "
        + ", ".join(f"{percent(inside[band])} in the band of {BANDS[band]}" for band in BANDS if band in inside),
        sure=f"{percent(result['probability'])} would be right for a new measurement; {points}",
        failed=f"{result['failed']:,} of {result['rows']:,} simulations failed" if result["failed"] else "",
    )  # fmt: skip


def _bands(result: dict[str, Any], kept: dict[str, xr.Dataset]) -> Block:
    shown = [name for name in BANDS if result["coverage"][name]["all"] is not None]
    wide = [name for name in ("new", "hdi", "draws") if name in shown]  # the widest behind
    curves: dict[str, dict[str, Any]] = {}
    protocols: list[str] = []
    for dataset in kept.values():
        specimens, kinds = (np.array([*map(str, dataset[name].to_numpy())]) for name in ("specimen", "protocol"))
        for specimen in dict.fromkeys(specimens):
            for protocol in dict.fromkeys(kinds[specimens == specimen]):
                at = np.flatnonzero((specimens == specimen) & (kinds == protocol))
                columns = {name: dataset[name].to_numpy()[at] for name in ("time", "measured")}
                for band in wide:
                    columns |= {f"{band}_{end}": dataset[f"{band}_{end}"].to_numpy()[at] for end in ("low", "high")}
                curves.setdefault(str(specimen), {})[str(protocol)] = columns
                if protocol not in protocols:
                    protocols.append(str(protocol))
    empty = {
        name: np.zeros(0) for name in ("time", "measured", *(f"{b}_{end}" for b in wide for end in ("low", "high")))
    }
    data = {name: {each: every.get(each, empty) for each in protocols} for name, every in sorted(curves.items())}

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for protocol in protocols:
            plot = plots.figure(f"time (s), {protocol.replace('_', ' ')}", "force (N)", height=320)
            told, entries = sources[protocol], []
            for band in wide:
                colour = {"new": "#9aa4ad", "hdi": COLOURS[5], "draws": COLOURS[4]}[band]
                area = plot.varea("time", f"{band}_low", f"{band}_high", source=told, color=colour, alpha=0.35)
                edges = [
                    plot.line("time", f"{band}_{end}", source=told, color=colour, line_width=1.2,
                              line_dash=plots.dash(wide.index(band)))
                    for end in ("low", "high")
                ]  # fmt: skip
                entries.append((BANDS[band], [area, *edges]))
            line = plot.line("time", "measured", source=told, color=plots.INK, line_width=1.6)
            rows = [("time", "@time{0.0} s"), ("measured", "@measured{0.0} N")]
            rows += [(BANDS[band], f"@{band}_low{{0.0}} to @{band}_high{{0.0}} N") for band in wide]
            plots.hover(plot, line, rows)
            plots.legend(plot, [("measured", [line]), *entries])
            drawn.append(
                plots.plot(f"prediction-{len(drawn)}", plot, f"{protocol}: measured curve and predicted bands")
            )
        return drawn

    told = {}
    for name in data:
        parts = [
            f"{BANDS[band]} {percent(result['coverage'][band]['specimens'].get(name))}"
            for band in shown
            if name in result["coverage"][band]["specimens"]
        ]
        told[name] = f"measured points inside: {', '.join(parts)}" if parts else ""
    caption = (
        f"Measured curve and {percent(result['probability'])} bands. The band of a new specimen is predicted from the "
        "other specimens of its site."
    )
    return plots.picked("prediction-bands", caption, "Specimen", data, draw, told)


def _table(result: dict[str, Any]) -> Table:
    protocols = list(result["coverage"]["hdi"]["protocols"])
    rows = []
    for site, told in (
        {site: told["coverage"] for site, told in result["sites"].items()} | {"all": result["coverage"]}
    ).items():
        for band, label in BANDS.items():
            if told[band]["all"] is not None:
                cells = [told[band]["all"], *(told[band]["protocols"].get(name) for name in protocols)]
                points = number(told[band].get("points"))
                rows.append([site, label, *("–" if cell is None else percent(cell, 1) for cell in cells), points])
    return Table(
        "Measured points inside the bands", ["site", "band", "all protocols", *protocols, "points"], rows, words=(1,)
    )
