"""Sensitivity: Sobol indices of the objectives, along the protocols, and how far they are settled."""

from typing import Any

import numpy as np
from bokeh.transform import dodge

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plot, Plots, Section, Table, Words, listed, number, percent, plural
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.drawing.formats import protocols_of
from sinew.tasks.report.folder import ResultFolder, read_results
from sinew.tasks.sobol.result import SHORT, WORDS, SobolResult
from sinew.tasks.sobol.show import correlation_words, specimens_table, stored, surrogate_words

NAME = "sensitivity"
SHOWN = 6  # lines in a plot along time
#: Of each index its key, its words in the legend, its place beside the name, and its colour, marker and filling.
INDEPENDENT = (
    ("S1", "first order: alone", 0.17, COLOURS[0], "square", "white"),
    ("ST", "total order: with all its interactions", -0.17, COLOURS[1], "circle", COLOURS[1]),
)
CORRELATED = (
    ("S1", "first order: alone, and through correlated parameters", 0.25, COLOURS[0], "square", "white"),
    ("ST", "total order: beyond what the others determine", 0.0, COLOURS[1], "circle", COLOURS[1]),
    ("Sh", "Shapley effect: its share of the variance", -0.25, COLOURS[2], "diamond", COLOURS[2]),
)


def section(folder: ResultFolder) -> Section:
    """Everything of ``sobol.json`` and the indices along time."""
    title, question = "Sensitivity", "Which parameters decide how well the model fits, alone and together?"
    result = folder.result(SobolResult)
    if result is None:
        return Section("sensitivity", title, question, missing=folder.missing("sobol"))
    if result.outputs:
        question = "Which parameters decide each output, alone and together?"
    level = percent(result.confidence)
    blocks: list[Block] = [_specimens(result)] if len(result.specimens) > 1 else []
    blocks.append(_indices(result, level))
    blocks += [block for block in (_along_time(folder, result, level), _convergence(result, level)) if block]
    values, conf = (getattr(result, key) for key in (result.leading, f"{result.leading}_conf"))
    first = [f"{result.names[j]} {values[j]:.2f} ± {conf[j]:.2f}" for j in result.largest()]
    small = [name for name, value in zip(result.names, values, strict=True) if value < 0.01]
    failed = ""
    if result.failed:
        failed = f"{result.failed:,} of {result.rows:,} rows; {result.failures.rule}"
        blocks.append(Words(f"Failed rows: {failed}.", "warning"))
    sure = f"{level} intervals from {result.base_samples_used:,} {result.sample}"
    blocks += [Words(f"{words}.", "note") for words in surrogate_words(result)]
    if small:
        sure += f"; below 0.01: {listed(small, 3)}"
    return Section(
        "sensitivity", title, question, blocks,
        found=f"{_ranked(result)}: {', '.join(first)}" if first else "the objective varies too little",
        sure=sure,
        failed=failed,
    )  # fmt: skip


def _ranked(result: SobolResult) -> str:
    """The indices by which parameters are ranked, in words."""
    return "Shapley effects" if result.leading == "Sh" else WORDS[result.leading].replace("index", "indices")


def _specimens(result: SobolResult) -> Block:
    key = result.leading
    rows = [
        [str(row.Index), number(row.median), number(row.smallest), number(row.largest), str(row.largest_in)]
        for row in specimens_table(result).itertuples()
    ]
    caption = (
        f"{SHORT[key] if result.correlations else key} of each specimen's own objective: median, range, and the "
        "specimen with the largest. An index of the mean of all objectives, below, may hide what decides one specimen."
    )
    return Table(caption, ["parameter", "median", "smallest", "largest", "largest in"], rows, words=[4])


def _indices(result: SobolResult, level: str) -> Block:
    names = result.names
    shown = result.panels() | (dict(result.specimens) if len(result.specimens) > 1 else {})

    def columns(values: Any) -> dict[str, Any]:
        indices: dict[str, Any] = {"parameter": names}
        for key in result.keys[::2]:
            index, conf = (getattr(values, each) for each in (key, f"{key}_conf"))
            indices |= {key: index, f"{key}_conf": conf, f"{key}_low": index - conf, f"{key}_high": index + conf}
        return {"indices": indices}

    def draw(sources: plots.Sources) -> list[Plot]:
        across = "part of the variance" if result.correlations else "Sobol index"
        plot = plots.figure(across, "", height=110 + 24 * len(names), y_range=[*map(plots.plain, names)][::-1])
        plot.vspan(0.0, line_color=plots.MUTED, line_width=0.8)
        entries = []
        for key, label, shift, colour, marker, fill in CORRELATED if result.correlations else INDEPENDENT:
            up = dodge("parameter", shift, range=plot.y_range)
            bar = plot.segment(
                f"{key}_low", up, f"{key}_high", up, source=sources["indices"], color=colour, line_width=1.5
            )
            dots = plot.scatter(
                key, up, source=sources["indices"], marker=marker, size=8, line_color=colour, fill_color=fill
            )
            entries.append((label, [bar, dots]))
            plots.hover(plot, dots, [("parameter", "@parameter"), (key, f"@{key}{{0.0000}} ± @{key}_conf{{0.0000}}")])
        plots.legend(plot, entries)
        return [
            plots.plot("sensitivity-indices", plot, "Sobol indices of the picked objective by parameter", wide=True)
        ]

    caption = f"Sobol indices of the {result.objective}; lines: {level} intervals. {result.rows:,} rows."
    if result.correlations:
        caption += f" Rank correlations of parameters: {correlation_words(result)}."
    data = {name: columns(values) for name, values in shown.items()}
    return plots.picked("sensitivity-objectives", caption, "Objective", data, draw)


def _time_columns(
    dataset: Any, protocol: str, output: str | None, key: str, chosen: list[int], beside: str
) -> dict[str, Any]:
    """Values, and ends of intervals, of the ``chosen`` parameters' indices ``key`` along a protocol."""
    if stored(key, protocol, output) not in dataset:
        return {"time": [], beside: []} | {f"{kind}{j}": [] for j in chosen for kind in "vlh"}
    index, conf = (dataset[stored(each, protocol, output)].to_numpy() for each in (key, f"{key}_conf"))
    return {
        "time": dataset[f"time_{protocol}"].to_numpy(),
        beside: dataset[f"{beside}_{protocol}"].to_numpy(),
        **{f"v{j}": index[j] for j in chosen},
        **{f"l{j}": index[j] - conf[j] for j in chosen},
        **{f"h{j}": index[j] + conf[j] for j in chosen},
    }


def _along_time(folder: ResultFolder, result: SobolResult, level: str) -> Block | None:
    if folder.store is None or not result.tables:
        return None
    names = result.names
    leading = result.leading
    order = WORDS[leading]
    tables = dict.fromkeys(result.tables.values())
    names_of_results = [f"sobol_time/{table}" for table in tables]
    read = read_results(folder.store, names_of_results, f"{leading}_", parameter=names)
    every = dict(zip(tables, read, strict=True))
    kept = {name: every[table] for name, table in result.tables.items()}
    protocols, more = plots.first(dict.fromkeys(n for each in kept.values() for n in protocols_of(each)), "protocols")
    outputs = bool(result.outputs)
    of, beside, unit = ("the picked output", "displacement", "mm") if outputs else ("the force", "measured", "N")
    digits = "0.000" if outputs else "0.0"
    shown = result.courses()
    strongest = np.zeros(len(names))
    for specimen, output in shown.values():
        for protocol in protocols:
            if (key := stored(leading, protocol, output)) in kept[specimen]:
                index = np.nan_to_num(kept[specimen][key].to_numpy())
                strongest = np.maximum(strongest, index.max(axis=1))
    chosen = [int(j) for j in np.argsort(-strongest)[:SHOWN]]

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for protocol in protocols:
            across = f"time (s), {protocol.replace('_', ' ')}"
            plot = plots.figure(across, order + ("" if outputs else " of the force"), height=330)
            entries = []
            for rank, j in enumerate(chosen):
                colour = plots.colour(rank)
                band = plot.varea("time", f"l{j}", f"h{j}", source=sources[protocol], color=colour, alpha=0.15)
                style = {"color": colour, "line_dash": plots.dash(rank), "line_width": 1.6}
                line = plot.line("time", f"v{j}", source=sources[protocol], **style)
                rows = [("parameter", plots.words(names[j])), ("time", "@time{0.0} s"), ("index", f"@v{j}{{0.000}}"),
                        (beside, f"@{beside}{{{digits}}} {unit}")]  # fmt: skip
                plots.hover(plot, line, rows)
                entries.append((names[j], [line, band]))
            plots.legend(plot, entries)
            plot.y_range.start = -0.05
            label = f"{protocol}: which parameters decide {of}, along time"
            drawn.append(plots.plot(f"sensitivity-time-{len(drawn)}", plot, label))
        return drawn

    caption = (
        f"{_ranked(result)[0].upper()}{_ranked(result)[1:]} of {of} along each protocol, the {len(chosen)} largest; "
        f"bands: {level} intervals.{more}"
    )
    data = {
        name: {
            protocol: _time_columns(kept[specimen], protocol, output, leading, chosen, beside) for protocol in protocols
        }
        for name, (specimen, output) in shown.items()
    }
    return plots.picked("sensitivity-times", caption, "Output" if outputs else "Specimen", data, draw)


def _convergence(result: SobolResult, level: str) -> Block | None:
    curve = result.convergence
    sizes = curve.base_samples
    if len(sizes) < 2:
        return None
    total, conf = curve.ST, curve.ST_conf
    chosen = np.argsort(-np.nan_to_num(total[-1]))[:SHOWN]

    plot = plots.figure(result.sample, "total order index", x_axis_type="log", height=300)
    plot.xaxis.ticker = list(sizes)
    entries = []
    for rank, j in enumerate(chosen):
        index, half = total[:, j], conf[:, j]
        columns: dict[str, Any] = {
            "size": sizes,
            "index": index,
            "conf": half,
            "low": index - half,
            "high": index + half,
        }
        source = plots.source(f"convergence-{j}", columns)
        colour = plots.colour(rank)
        line = plot.line("size", "index", source=source, color=colour, line_dash=plots.dash(rank))
        bar = plot.segment("size", "low", "size", "high", source=source, color=colour)
        dots = plot.scatter("size", "index", source=source, color=colour, marker=plots.MARKERS[rank], size=7)
        rows = [
            ("parameter", plots.words(result.names[j])),
            (result.sample, "@size"),
            ("index", "@index{0.000} ± @conf{0.000}"),
        ]
        plots.hover(plot, dots, rows)
        entries.append((result.names[j], [line, bar, dots]))
    plots.legend(plot, entries)
    shown = plots.plot(
        "sensitivity-convergence", plot, f"Total order indices over the number of {result.sample}", wide=True
    )
    words = (
        f"How the largest indices settle as the design grows; lines: {level} intervals, {plural(len(sizes), 'size')}."
    )
    return Plots("sensitivity-settling", words, [shown])
