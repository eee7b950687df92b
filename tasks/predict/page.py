"""Prediction: bands around the curves, and how many of the measured points they hold."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import (
    Block,
    Plot,
    Section,
    Table,
    Words,
    behind,
    level,
    number,
    percent,
    plural,
    with_its_unit,
)
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.model import FORCE
from sinew.tasks.predict.result import BANDS, Coverage, PredictResult, bands_group, of_quantity
from sinew.tasks.report.folder import ResultFolder, read_results

NAME = "prediction"
COLOUR = {
    "whole": "#c9cfd5",
    "new": "#9aa4ad",
    "hdi": COLOURS[5],
    "draws": COLOURS[4],
}  # the widest band first, which is drawn behind


def section(folder: ResultFolder) -> Section:
    """Everything of ``predict.json`` and the bands in the store."""
    title, question = "Prediction", "Do the bands hold the measured curves, also of specimens that they do not know?"
    result = folder.result(PredictResult)
    if result is None:
        return Section("prediction", title, question, missing=folder.missing("predict"))
    blocks: list[Block] = [_table(result)]
    if folder.store is not None:
        kept = read_results(folder.store, [bands_group(site) for site in result.sites])
        blocks.insert(0, _bands(result, _given(result.coverage), kept))
        for name, other in (result.others or {}).items():
            its = [of_quantity(each, name) for each in kept]
            blocks.append(_bands(result, _given(other.coverage), its, name, other.unit))
    if result.others:
        blocks.append(_table_of_others(result))
    for site, prediction in result.sites.items():
        blocks += [Words(f"{site}: {why}", "note") for why in prediction.gaps]
    blocks += [Words(f"{remark}.", "warning") for remark in result.remarks]
    shares = [f"{percent(one.all)} in the band of {BANDS[band]}" for band, one in _given(result.coverage).items()]
    points = plural(max(one.points for one in result.coverage.values()), "point")
    return Section(
        "prediction", title, question, blocks,
        found=f"measured points inside: {', '.join(shares)}",
        sure=f"{level(result.probability)} would be right for a new measurement; {points}",
        failed=", ".join(
            ([f"{plural(len(result.narrow), 'band')} with too few of the points inside"] if result.narrow else [])
            + ([f"{result.failed:,} of {result.rows:,} simulations failed"] if result.failed else [])
        ),
    )  # fmt: skip


def _given(coverage: Mapping[str, Coverage]) -> dict[str, Coverage]:
    """Coverage by band, of the bands that are given anywhere."""
    return {band: coverage[band] for band in BANDS if coverage[band].all is not None}


def _bands(
    result: PredictResult,
    given: Mapping[str, Coverage],
    kept: Sequence[xr.Dataset],
    quantity: str = FORCE,
    unit: str = "N",
) -> Block:
    """The bands of a quantity that are ``given``, with the measured curves that each of ``kept``, a site, holds."""
    label_y = with_its_unit(quantity.replace("_", " "), unit)
    digits, key = ("{0.0}", "prediction") if quantity == FORCE else ("", f"prediction-{quantity}")
    bands = [band for band in COLOUR if band in given]
    data, protocols, more = _columns(kept, bands)

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for protocol in protocols:
            plot = plots.figure(f"time (s), {protocol.replace('_', ' ')}", label_y, height=320)
            source, entries = sources[protocol], []
            for band in bands:
                colour, ends = COLOUR[band], (f"{band}_low", f"{band}_high")
                area = plot.varea("time", *ends, source=source, color=colour, alpha=0.35)
                style = {"color": colour, "line_width": 1.2, "line_dash": plots.dash(bands.index(band))}
                edges = [plot.line("time", end, source=source, **style) for end in ends]
                entries.append((BANDS[band], [area, *edges]))
            line = plot.line("time", "measured", source=source, color=plots.INK, line_width=1.6)
            rows = [("time", "@time{0.0} s"), ("measured", f"@measured{digits}{behind(unit)}")]
            rows += [(BANDS[band], f"@{band}_low{digits} to @{band}_high{digits}{behind(unit)}") for band in bands]
            plots.hover(plot, line, rows)
            plots.legend(plot, [("measured", [line]), *entries])
            label = f"{protocol}: measured curve and predicted bands"
            drawn.append(plots.plot(f"{key}-{len(drawn)}", plot, label))
        return drawn

    words = {}
    for name in data:
        shares = [
            f"{BANDS[band]} {percent(one.specimens[name])}" for band, one in given.items() if name in one.specimens
        ]
        words[name] = f"measured points inside: {', '.join(shares)}" if shares else ""
    caption = (
        f"Measured curve and {level(result.probability)} bands. The band of a new specimen is predicted from "
        f"{'the population' if result.from_population else 'the other specimens of its site'}."
    )
    if quantity != FORCE:
        caption = f"The same for the {quantity.replace('_', ' ')}."
    return plots.picked(f"{key}-bands", caption + more, "Specimen", data, draw, words)


def _columns(
    kept: Sequence[xr.Dataset], bands: Sequence[str]
) -> tuple[dict[str, dict[str, dict[str, Any]]], list[str], str]:
    """Measured curves and bands by specimen and protocol, the names of all protocols, and whether there are more."""
    names = ["time", "measured", *(f"{band}_{end}" for band in bands for end in ("low", "high"))]
    curves: dict[str, dict[str, Any]] = {}
    protocols: dict[str, None] = {}
    for dataset in kept:
        specimens, kinds = (np.array([*map(str, dataset[name].to_numpy())]) for name in ("specimen", "protocol"))
        columns = {name: dataset[name].to_numpy() for name in names}
        rows: dict[tuple[str, str], list[int]] = {}
        for i, both in enumerate(zip(specimens.tolist(), kinds.tolist(), strict=True)):
            rows.setdefault(both, []).append(i)
        for (specimen, protocol), at in rows.items():
            curves.setdefault(specimen, {})[protocol] = {name: values[at] for name, values in columns.items()}
            protocols[protocol] = None
    empty = {name: np.zeros(0) for name in names}
    drawn, more = plots.first(protocols, "protocols")
    data = {name: {each: every.get(each, empty) for each in drawn} for name, every in sorted(curves.items())}
    return data, drawn, more


def _table(result: PredictResult) -> Table:
    rows = []
    for row in result.shares():
        shares = (row["share"], row["curves"], *row["by_protocol"])
        cells = ["–" if share is None else percent(share, 1) for share in shares]
        rows.append([row["site"], BANDS[row["band"]], *cells, number(row["points"])])
    header = ["site", "band", "all protocols", "whole curves", *result.protocols, "points"]
    return Table("Measured points inside the bands, and curves that are inside entirely", header, rows, words=(1,))


def _table_of_others(result: PredictResult) -> Table:
    rows = []
    for row in result.shares_of_others():
        cells = ["–" if share is None else percent(share, 1) for share in (row["share"], *row["by_protocol"])]
        rows.append([row["site"], row["quantity"], BANDS[row["band"]], *cells, number(row["points"])])
    header = ["site", "quantity", "band", "all protocols", *result.protocols, "points"]
    return Table("Measured points of further quantities inside the bands", header, rows, words=(1, 2))
