"""Emulators: how well few runs stand for the model."""

import numpy as np

from sinew.tasks.drawing import plots
from sinew.tasks.drawing.blocks import Block, Plots, Section, Table, Words, listed, number, percent
from sinew.tasks.drawing.figures import COLOURS
from sinew.tasks.report.folder import ResultFolder
from sinew.tasks.surrogate.result import SurrogateResult
from sinew.tasks.surrogate.show import headline, kinds, region, tested

NAME = "surrogate"
NAMED = 6  # specimens in a sentence
LISTED = 40  # courses in a table that is open
ERRORS = (
    "Errors are root mean squares, in parts of the spread of the course over the runs. Left-out runs are those that an "
    "emulator was not trained with; fresh ones are those of the last batch, of which the emulator before it knew "
    "nothing. Intervals were set by left-out runs, so the part of fresh ones inside is the test of these intervals."
)


def section(folder: ResultFolder) -> Section:
    """Everything of ``surrogate.json``."""
    title, question = "Emulators", "How well do few runs stand for the model?"
    result = folder.result(SurrogateResult)
    if result is None:
        return Section(NAME, title, question, missing=folder.missing("surrogate"))
    blocks: list[Block] = [_growth(result), _courses(result)]
    blocks.append(Words(ERRORS, "note"))
    failed = [f"{name}: {words}" for name, one in result.specimens.items() if (words := region(one))]
    blocks += [Words(each, "warning") for each in failed[:NAMED]]
    chosen = [f"{name}: {kinds(one)}" for name, one in result.specimens.items()]
    words = listed(chosen, NAMED)
    blocks.append(Words(f"Emulators of principal components, by cross-validation: {words}.", "note"))
    sure = ""
    if (found := tested(result)) is not None:
        error, inside = found
        sure = f"at fresh runs at most {percent(error, 1)}; at least {percent(inside)} of points inside 95 % intervals"
    if not result.reached:
        failed.insert(0, f"not as small as asked ({percent(result.asked, 1)})")
    return Section(NAME, title, question, blocks, found=headline(result), sure=sure, failed=listed(failed, 2))


def _growth(result: SurrogateResult) -> Block:
    """The largest error of each specimen as runs were added."""
    plot = plots.figure("runs of a specimen", "largest error (% of the spread)", height=260, y_axis_type="log")
    entries = []
    worst, more = plots.first(sorted(result.specimens.items(), key=lambda each: -each[1].error), "specimens")
    for i, (name, one) in enumerate(worst):
        columns = {"runs": one.sizes, "error": 100 * np.maximum(one.errors, 1e-9), "name": [name] * len(one.sizes)}
        source, colour = plots.source(f"surrogate-{i}", columns), COLOURS[i % len(COLOURS)]
        line = plot.line("runs", "error", source=source, color=colour)
        dots = plot.scatter("runs", "error", source=source, color=colour, size=7)
        plots.hover(plot, dots, [("", "@name"), ("runs", "@runs"), ("error", "@error{0.00} %")])
        entries.append((name, [line, dots]))
    plots.legend(plot, entries)
    label = "The largest error of each specimen's emulator against the number of runs"
    caption = f"The largest error of left-out runs as runs were added; {percent(result.asked, 1)} was asked.{more}"
    return Plots("surrogate-growth", caption, [plots.plot("surrogate-errors", plot, label, wide=True)])


def _courses(result: SurrogateResult) -> Table:
    rows = [
        [f"{name} {each.output} {each.protocol}", f"{number(each.spread)} {each.unit}", percent(each.error, 1),
         percent(each.fresh_error, 1), percent(each.fresh_inside)]
        for name, one in result.specimens.items()
        for each in one.courses.values()
    ]  # fmt: skip
    header = ["course", "spread", "error, left out", "error, fresh", "fresh, inside 95 %"]
    return Table("Errors of the emulators", header, rows, words=(1,), open=len(rows) <= LISTED)
