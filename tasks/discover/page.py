"""Discovery: where model and measurements disagree, and which effect would explain it."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from bokeh.models import LinearColorMapper
from bokeh.models.annotations import ColorBar

from sinew.tasks.discover.figures import FAR
from sinew.tasks.discover.follow_up import Part
from sinew.tasks.discover.judge.confidence import in_words
from sinew.tasks.discover.quantities import leftovers, mean_words, quantity_words, rows_of, units_of
from sinew.tasks.discover.result import CandidateResult, DiscoverResult, Estimate
from sinew.tasks.discover.show import (
    FAR_BEYOND_NOISE,
    UNLIKELY,
    clipped,
    gap_of,
    gap_words,
    held_out,
    in_one_sentence,
    left_out_lines,
    noise_words,
    of_the_law,
    only_describes,
    stack_of,
    standing,
    times_the_noise,
    unlikely,
    wrong_one,
)
from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Code, Facts, Plot, Plots, Section, Table, Words, listed, number, percent
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.drawing.thinning import drawn_points
from sinew.tasks.model import Protocol, file_name
from sinew.tasks.report.folder import ResultFolder

NAME = "discovery"
POINTS = 800  # of a curve
MOST_SEEN = 6  # specimens that are named
SLOW = 0.99  # correlation of the noise of neighbouring points, from which on noise and shape cannot be told apart
MEANING = {
    "NONE": "Nothing disagrees far beyond chance, and no effect improves the fit clearly.",
    "NAMED": "The named effects explain the disagreement, nothing else does as well, and they predict unseen data.",
    "PARTLY": "The named effects are certainly missing. They do not explain all of the disagreement.",
    "AMBIGUOUS": "The data cannot tell the effects of the set apart.",
    "OUTSIDE": "Model and data disagree, and nothing in the library explains enough of it to be named.",
}
FEWEST_ALIKE = 2  # effects of a set
FAILS = "This effect fits best, but it fails a check; the reason says which."
NO_FIT = "The fit of the model as it is does not allow a verdict yet."
DESCRIBES = (
    "The named effects describe these curves best. So much misfit is left that the model is not that of this tissue; "
    "other curves may give other names."
)
#: Blue to red through white (RdBu of ColorBrewer), for colour-blind readers too; dots say what is beyond chance.
_COLOURS = ("#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582", "#d6604d", "#b2182b")


def section(found: ResultFolder) -> Section:
    """Everything of ``discover.json``, and the curves with and without the effects."""
    title, question = "Discovery", "Where do model and measurements disagree, and what is missing?"
    result = found.result(DiscoverResult)
    if result is None:
        return Section("discovery", title, question, missing=found.missing("discover"))
    sentence = in_one_sentence(result)
    blocks: list[Block] = [Words(sentence)] if sentence else []
    blocks.append(_verdict(result))
    if result.remainder is not None:
        blocks.append(_stack(result))
    if result.parts:
        blocks.append(_parts(result))
    if found.store is not None:
        blocks.append(_curves(found, result))
        if result.compared:
            blocks.append(_quantities(found, result))
    blocks += [_cells(result), _candidates(result), *_others(result)]
    sure = f"misfit explained: {percent(result.explained)}" if result.explained is not None else ""
    if gap_of(result) is not None:
        sure = f"held-out error in units of noise: {gap_words(result)}"
    bounds = result.judged.on_bound if result.judged is not None else ()
    return Section(
        "discovery", title, question, blocks,
        found=f"{_answer(result)}; {sentence or result.why}",
        sure=sure,
        failed=f"on a bound: {', '.join(bounds)}" if bounds else "",
    )  # fmt: skip


def _answer(result: DiscoverResult) -> str:
    return f"{result.verdict}: {result.answer}" if result.answer else result.verdict


def _verdict(result: DiscoverResult) -> Facts:
    conflict = result.conflict
    rows = [
        ("verdict", _answer(result)),
        ("because", result.why),
        ("that means", _meaning(result)),
        ("how far to trust it", in_words(result.confidence)),
    ]
    if result.judged is not None and len(result.judged.gains) > 1:
        gains = result.judged.gains
        seen = [name for name, gain in gains.items() if gain > 0.0]
        if 0 < len(seen) < len(gains):
            rows.append(("it improves the fit of", f"{listed(seen, MOST_SEEN)}, of {len(gains)} specimens"))
    if words := gap_words(result):
        rows.append(("held-out error, in units of noise", words))
    worst = conflict.worst
    if conflict.p < UNLIKELY and worst is not None:
        rows.append(("conflict of protocols", f"{unlikely(conflict.p)}: most of all {worst.parameter}, "
                     f"{number(worst.values[0])} in {worst.curves[0]}, {number(worst.values[1])} in "
                     f"{worst.curves[1]}"))  # fmt: skip
    if result.left_out:
        rows.append(("left out", "; ".join(left_out_lines(result))))
    if words := quantity_words(result):
        rows.append(("compared beside the force", words))
    noise = [f"{name} {noise_words(one)}" for name, one in result.noise.items()]
    rows.append(("noise (standard deviation)", ", ".join(noise)))
    slow = [name for name, one in result.noise.items() if one.ar1 >= SLOW]
    slow += [
        f"{name}, {quantity}"
        for name, others in (result.compared or {}).items()
        for quantity, one in others.items()
        if one.ar1 >= SLOW
    ]
    if slow:
        words = f"that of {listed(slow)} changes so slowly that it may hold a part of what the model lacks"
        rows.append(("mind the noise", words))
    return Facts(rows)


def _meaning(result: DiscoverResult) -> str:
    if only_describes(result):
        return DESCRIBES
    if result.verdict == "AMBIGUOUS" and len(result.set) < FEWEST_ALIKE:
        return FAILS if result.set else NO_FIT
    return MEANING[result.verdict]


def _curves(found: ResultFolder, result: DiscoverResult) -> Plots:
    assert found.store is not None
    effects = result.shown_name
    models = {"bare": "the model as it is"} | ({"having": f"with {effects}"} if effects else {})
    data: dict[str, dict[str, Any]] = {}
    every = dict.fromkeys(cell.protocol for cells in result.cells.values() for cell in cells)
    protocols, more = plots.first(every, "protocols")
    for name in result.cells:
        kept = found.store.read_result(f"discover/{file_name(name)}")
        data[name] = {}
        for protocol in protocols:
            columns = {key: np.zeros(0) for key in ("time", "measured", *models, *(f"left_{key}" for key in models))}
            if f"time_{protocol}" in kept.variables:
                time, measured = (kept[f"{key}_{protocol}"].to_numpy() for key in ("time", "measured"))
                moved = kept[f"displacement_{protocol}"].to_numpy()
                forces = {key: kept[f"{key}_{protocol}"].to_numpy() for key in models}
                keep = drawn_points(Protocol(protocol, time, moved), measured, *forces.values(), count=POINTS)
                columns = {"time": time[keep], "measured": measured[keep]}
                for key, force in forces.items():
                    columns |= {key: force[keep], f"left_{key}": (measured - force)[keep]}
            data[name][protocol] = columns

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for protocol in protocols:
            source = sources[protocol]
            plot = plots.figure(f"time (s), {protocol.replace('_', ' ')}", "force (N)")
            line = plot.line("time", "measured", source=source, color=plots.MEASURED, line_width=3.4)
            entries = [("measured", [line])]
            left = plots.figure("time (s)", "measured less model (N)", height=230, x_range=plot.x_range)
            rows = [("time", "@time{0.00} s"), ("measured", "@measured{0.0} N")]
            leftovers = []
            for key, label in models.items():
                colour = COLOURS[1] if key == "bare" else COLOURS[0]
                style = {"color": colour, "line_dash": "dashed" if key == "bare" else "solid"}
                entries.append((label, [plot.line("time", key, source=source, line_width=1.4, **style)]))
                rest = left.line("time", f"left_{key}", source=source, line_width=1.0, **style)
                leftovers.append((label, [rest]))
                plots.hover(left, rest, [(label, f"@left_{key}{{0.00}} N"), ("time", "@time{0.00} s")])
                rows.append((label, f"@{key}{{0.0}} N"))
            plots.hover(plot, line, rows)
            left.hspan(0.0, line_color=plots.INK, line_width=0.7)
            plots.legend(plot, entries)
            plots.legend(left, leftovers)
            label = f"{protocol}: forces with and without effects, and what either model leaves"
            drawn.append(plots.plot(f"discovery-curves-{len(drawn)}", plot, label, below=left))
        return drawn

    notes = {name: f"noise {noise_words(result.noise[name])} (standard deviation)" for name in data}
    caption = f"Measured and modelled forces, and below what either model leaves.{more}"
    return plots.picked("discovery-curves", caption, "Specimen", data, draw, notes)


def _quantities(found: ResultFolder, result: DiscoverResult) -> Plots:
    """What either model leaves of each quantity beside the force."""
    assert found.store is not None
    models = {"bare": "the model as it is"} | ({"having": f"with {result.shown_name}"} if result.shown else {})
    data: dict[str, dict[str, dict[str, Any]]] = {}
    for specimen in result.compared or {}:
        kept = found.store.read_result(f"discover/{file_name(specimen)}")
        for quantity, parts in leftovers(kept, result, specimen).items():
            data[f"{specimen}, {quantity}"] = {
                protocol: {name: values[:: -(-values.size // POINTS) or 1] for name, values in columns.items()}
                for protocol, columns in parts.items()
            }
    protocols, more = plots.first(dict.fromkeys(name for parts in data.values() for name in parts), "protocols")
    nothing = {name: np.zeros(0) for name in ("time", *models)}
    data = {option: {name: parts.get(name, nothing) for name in protocols} for option, parts in data.items()}

    def draw(sources: plots.Sources) -> list[Plot]:
        drawn: list[Plot] = []
        for protocol in protocols:
            plot = plots.figure(f"time (s), {protocol.replace('_', ' ')}", "measured less model (noise)", height=230)
            entries = []
            for key, label in models.items():
                line = plot.line(
                    "time", key, source=sources[protocol], color=COLOURS[1] if key == "bare" else COLOURS[0],
                    line_width=1.0, line_dash="dashed" if key == "bare" else "solid",
                )  # fmt: skip
                entries.append((label, [line]))
                plots.hover(plot, line, [(label, f"@{key}{{0.0}}"), ("time", "@time{0.00} s")])
            plot.hspan(0.0, line_color=plots.INK, line_width=0.7)
            plots.legend(plot, entries)
            label = f"{protocol}: what either model leaves of the quantity, in units of its noise"
            drawn.append(plots.plot(f"discovery-quantities-{len(drawn)}", plot, label))
        return drawn

    caption = f"What either model leaves of each quantity beside the force, in units of its noise.{more}"
    return plots.picked("discovery-quantities", caption, "Specimen and quantity", data, draw)


def _cells(result: DiscoverResult) -> Plots:
    """Misfit by specimen, quantity and cell: a row for the model as it is, one with the effects."""
    rows, units = rows_of(result, "as it is"), units_of(result)
    columns: dict[str, list[Any]] = {key: [] for key in ("cell", "row", "z", "shade", "limit", "mean", "beyond")}
    for name, cells in rows:
        for cell in cells:
            columns["cell"].append(f"{cell.protocol.replace('_', ' ')}: {cell.phase} {cell.number}")
            columns["row"].append(name)
            columns["z"].append(cell.z)
            columns["shade"].append(float(np.clip(cell.z, -FAR, FAR)))
            columns["limit"].append(cell.limit)
            columns["mean"].append(mean_words(cell, units))
            columns["beyond"].append(0.3 if cell.beyond_chance else 0.0)
    labels = list(dict.fromkeys(columns["cell"]))
    plot = plots.figure(
        "", "", height=190 + 34 * len(rows), x_range=[*map(plots.plain, labels)],
        y_range=[*map(plots.plain, dict.fromkeys(columns["row"]))][::-1],
    )  # fmt: skip
    mapper = LinearColorMapper(palette=_COLOURS, low=-FAR, high=FAR)
    source = plots.source("cells", columns)
    boxes = plot.rect(
        "cell", "row", 1, 1, source=source, fill_color={"field": "shade", "transform": mapper}, line_color="white"
    )
    beyond: dict[str, list[str]] = {"row": [], "cell": []}
    for cell, row, flag in zip(columns["cell"], columns["row"], columns["beyond"], strict=True):
        if flag:
            beyond["row"].append(row)
            beyond["cell"].append(cell)
    plot.scatter("cell", "row", source=plots.source("beyond", beyond), size=4, color=plots.INK)
    plot.xaxis.major_label_orientation = 1.4
    plot.xaxis.major_label_text_font_size = "9px"
    bar = ColorBar(color_mapper=mapper, title="units of chance", height=10, width=220, location=(0, 0), padding=4)
    plot.add_layout(bar, "above")
    hover = [("cell", "@cell"), ("", "@row"), ("misfit", "@z{0.0} (limit @limit{0.0})"), ("mean", "@mean")]
    plots.hover(plot, boxes, hover)
    shown = plots.plot(
        "discovery-cells", plot, "Misfit of each part of each test, before and with the effects", wide=True
    )
    words = "Misfit of each part of each test: measured above (red) or below (blue) the model; dots: beyond chance."
    return Plots("discovery-map", words, [shown])


def _candidates(result: DiscoverResult) -> Table:
    rows = [
        [
            one.name,
            number(one.gain),
            percent(one.explained),
            held_out(one) or "–",
            " ".join(one.on_bound) or "–",
        ]
        for one in result.candidates
    ]
    header = ["effects", "gain", "misfit explained", "held-out gain", "on a bound"]
    return Table("Candidates, the largest gain first", header, rows, words=(4,), open=len(rows) <= 8)


def _stack(result: DiscoverResult) -> Plots:
    """What the named effects explain of the misfit, and what is left."""
    stack = stack_of(result)
    ends = 100.0 * stack["share"].cumsum().to_numpy()
    plot = plots.figure("part of the misfit beyond noise (%)", "", height=130, y_range=["misfit"])
    entries = []
    for i, (part, share, end) in enumerate(zip(stack["part"], 100.0 * stack["share"], ends, strict=True)):
        columns = {"row": ["misfit"], "part": [part], "share": [share], "begin": [end - share], "end": [end]}
        fill = {"left": "#cccccc", "any of these": "#8c8c8c"}.get(part, COLOURS[i % len(COLOURS)])
        source = plots.source(f"stack-{i}", columns)
        bar = plot.hbar("row", left="begin", right="end", height=0.7, source=source, color=fill, line_color="white")
        plots.hover(plot, bar, [("", "@part"), ("misfit", "@share{0.0} %")])
        entries.append((f"{part}: {share:.1f} %", [bar]))
    plot.yaxis.visible = False
    plots.legend(plot, entries)
    words = "The misfit beyond noise: what only one of the named effects explains, what any of them does, the rest."
    label = "The misfit as a stack of what the effects explain and what is left"
    return Plots("discovery-stack", words, [plots.plot("discovery-stack-bars", plot, label, wide=True)])


def _parts(result: DiscoverResult) -> Table:
    """The effects that were fitted together, and why some of them are not certain."""
    rows = [
        [one.effect, percent(clipped(one.share), 1), " to ".join(percent(clipped(end), 1) for end in one.interval),
         number(one.evidence),
         number(one.ratio, 2), _in_place(one), standing(one, result)]
        for one in result.parts
    ]  # fmt: skip
    caption = "Effects fitted together: the part of the misfit that would be left in addition without each"
    header = ["effect", "misfit", "90 % interval", "evidence", "without it, times", "best in its place", ""]
    return Table(caption, header, rows, words=(5, 6))


def _in_place(part: Part) -> str:
    """The effect that does best in the place of one."""
    if not part.rival:
        return "–"
    return f"{part.rival} (evidence {number(part.rival_evidence)}, misfit {number(part.rival_ratio, 2)} times)"


def _others(result: DiscoverResult) -> list[Block]:
    """Parameters of the effects, and what goes with the verdict."""
    given = times_the_noise(result) <= FAR_BEYOND_NOISE
    blocks: list[Block] = [] if result.judged is None else [_parameters(result.judged, intervals=given)]
    if result.outside:
        nearest = result.outside.similar[0]
        like = f"looks most like {nearest.effect} (cosine {nearest.cosine:.2f})"
        lines = [f"What the model as it is leaves {like}. That is a description, not a mechanism."]
        lines += [f"{one.specimen}: {one.sentence}" for one in result.outside.corrections]
        blocks += [Words(line, "note") for line in lines]
    blocks += _law(result)
    if experiment := result.next_experiment:
        words = (
            f"What would tell: {experiment.name} ({experiment.words}). Then {wrong_one(experiment)} is off by up to "
            f"{experiment.newtons:.1f} N, {experiment.at_s:.0f} s into the test."
        )
        blocks.append(Words(words, "note"))
    if result.model:
        blocks.append(Code(f"The study with it, {result.model.path}", result.model.difference, open=False))
    return blocks


def _law(result: DiscoverResult) -> Iterator[Block]:
    """A law with its parameters, the test that would refute it, and the study with it."""
    law = result.law
    if law is None:
        return
    yield Words(of_the_law(result))
    yield _estimates("Parameters of the model with the law, with 90 % intervals", law.parameters)
    if test := law.refuted_by:
        against = " + ".join(law.other) or "the model without it"
        words = f"What would refute it: {test.name} ({test.words}). There, it and {against} differ by up to "
        yield Words(f"{words}{number(test.newtons, 2)} N.", "note")
    yield Code(f"The study with the law, {law.path}", law.difference, open=False)


def _parameters(judged: CandidateResult, *, intervals: bool) -> Table:
    if not intervals:
        caption = f"Parameters of {judged.name}; intervals would tell the noise only, and far more than noise is left"
        return _estimates(caption, judged.parameters, intervals=False)
    caption = f"Parameters of {judged.name}, with 90 % intervals"
    if judged.on_bound:
        caption += f"; {' '.join(judged.on_bound)} ended on a bound, where an interval is open"
    return _estimates(caption, judged.parameters)


def _estimates(caption: str, parameters: Mapping[str, Mapping[str, Estimate]], *, intervals: bool = True) -> Table:
    rows = [
        [specimen, name, number(one.value, 4), one.unit, *(number(end, 4) for end in one.interval if intervals)]
        for specimen, every in parameters.items()
        for name, one in every.items()
    ]
    header = ["specimen", "parameter", "value", "unit", *(["from", "to"] if intervals else [])]
    return Table(caption, header, rows, words=(1, 3), open=len(rows) <= 8)
