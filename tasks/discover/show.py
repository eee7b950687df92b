"""How a discovery is shown: as tables and on the console."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.discover.follow_up import NextExperiment, Part
from sinew.tasks.discover.judge.confidence import in_words
from sinew.tasks.discover.judge.rules import HELD_OUT
from sinew.tasks.discover.judge.shared_checks import as_good
from sinew.tasks.discover.misfit_map import NoiseLevel
from sinew.tasks.discover.quantities import quantity_words
from sinew.tasks.discover.result import NAMES, CandidateResult, DiscoverResult, SplitGap
from sinew.tasks.drawing.blocks import listed, number, percent

SHOWN = 6  # candidates
GAP = 1.05  # times what a true model comes to, from which on an error on held-out data leaves a gap
# times the noise: cases whose names were true left at most 4.8, real skin whose names are not stable 12
FAR_BEYOND_NOISE = 5.0
UNLIKELY = 0.001  # p value below which a conflict of the protocols is reported


def table(result: DiscoverResult) -> pd.DataFrame:
    """The candidates, the best first: gain of the criterion, part of the misfit explained, gain on held-out data."""
    keys = ("gain", "explained", "held_out", "held_out_error")
    rows = {one.name: {key: getattr(one, key) for key in keys} for one in result.candidates}
    return pd.DataFrame.from_dict(rows, orient="index", dtype=float).rename_axis("effects")


def headline(result: DiscoverResult) -> str:
    """What came out, in one line."""
    return f"{result.headline}: {result.why}"


def in_one_sentence(result: DiscoverResult) -> str:
    """How much of the misfit the named effects explain, how much is left, and where; empty where none is named."""
    left = result.remainder
    if left is None or result.verdict not in NAMES:
        return ""
    names = [effect.replace("-", " ") for effect in result.effects]
    who = " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names).capitalize()
    low, high = (100.0 * clipped(1.0 - end) for end in reversed(left.interval))
    said = f"{who} {'explain' if len(names) > 1 else 'explains'} {percent(min(1.0 - left.share, 1.0))} of the misfit"
    said += f" ({low:.0f} to {high:.0f} %)"
    if not left.beyond_noise:
        return f"{said}; nothing is left beyond noise."
    where = f", mostly in {listed(left.cells, 3)}" if left.cells else ""
    said += f"; {percent(max(left.share, 0.0), 1)} is left ({number(left.newtons, 2)} N{where})."
    for one in result.parts:
        if one.rival and one.doubt == as_good(one.rival):
            either = f"{one.effect} or {one.rival}".replace("-", " ").capitalize()
            said += f" {either}, which cannot be told apart, would explain {percent(one.share)}."
    if only_describes(result):
        times = f"{times_the_noise(result):.0f} times the noise"
        said += f" That is {times}: the names describe these curves, and others may change them."
    return said


def clipped(share: float) -> float:
    """A part of the misfit; what is less than nothing or more than all of it comes from noise."""
    return min(max(share, 0.0), 1.0)


def times_the_noise(result: DiscoverResult) -> float:
    """What the candidate of the verdict leaves of the forces, root mean square in units of the noise; 0 without one."""
    judged = result.judged
    if judged is None:
        return 0.0
    return float(np.sqrt(judged.loss / result.null.floor))


def only_describes(result: DiscoverResult) -> bool:
    """Whether the named effects leave so much that they describe these curves only, not the tissue."""
    return result.verdict in NAMES and times_the_noise(result) > FAR_BEYOND_NOISE


def standing(part: Part, result: DiscoverResult) -> str:
    """How far an effect of several may be relied on."""
    if part.doubt:
        return f"not certain: {part.doubt}"
    return "certain for these curves" if only_describes(result) else "certain"


def of_the_law(result: DiscoverResult) -> str:
    """What a law says of what the effects leave, in words; empty where there is none."""
    law = result.law
    if law is None:
        return ""
    what = "what the named effects leave" if law.beside else "the misfit"
    low, high = (100.0 * clipped(end) for end in law.interval)
    said = f"{'A law describes' if len(law.names) == 1 else 'Two laws describe'} {what}: {'; '.join(law.equations)}. "
    said += f"{'It takes' if len(law.names) == 1 else 'They take'} away {percent(min(law.share, 1.0))} of the misfit "
    said += f"({low:.0f} to {high:.0f} %)"
    if law.gap.before is not None and law.gap.after is not None:
        errors = f"{law.gap.before:.2f} to {law.gap.after:.2f} times the noise"
        said += f"; the error on data that were not fitted falls from {errors}"
    return f"{said}. That is a description with predictive value, not a mechanism."


def stack_of(result: DiscoverResult) -> pd.DataFrame:
    """The misfit as a stack: what only one of the named effects explains, what any of several do, and what is left."""
    assert result.remainder is not None
    left = clipped(result.remainder.share)
    alone = {one.effect: max(one.share, 0.0) for one in result.parts if one.effect in result.effects}
    if len(result.effects) == 1:
        alone = {result.effects[0]: 1.0 - left}
    shared = max(1.0 - left - sum(alone.values()), 0.0)
    rows = [{"part": effect, "share": share} for effect, share in alone.items()]
    if len(result.effects) > 1:
        rows.append({"part": "any of these", "share": shared})
    return pd.DataFrame([*rows, {"part": "left", "share": left}])


def cells_table(result: DiscoverResult) -> pd.DataFrame:
    """Misfit of every cell, for the model as it is and with the effects."""
    rows = []
    for model, cells in (("as it is", result.cells), (result.shown_name, result.after or {})):
        rows += [{"specimen": name, "model": model, **vars(cell)} for name, every in cells.items() for cell in every]
    found = pd.DataFrame(rows)
    return found if result.compared else found.drop(columns=["quantity", "mean"], errors="ignore")


def curves_table(kept: xr.Dataset) -> pd.DataFrame:
    """Measured and modelled forces of a specimen before and after."""
    parts = []
    for dim in sorted(str(name) for name in kept.dims if str(name).startswith("time_")):
        protocol = dim.removeprefix("time_")
        columns = {"protocol": protocol, "time_s": kept[dim].to_numpy()}
        named = (("displacement", "displacement_mm"), ("measured", "measured_N"))
        for kind, name in (*named, ("bare", "as_it_is_N"), ("having", "with_effects_N")):
            if f"{kind}_{protocol}" in kept:
                columns[name] = kept[f"{kind}_{protocol}"].to_numpy()
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def summary(result: DiscoverResult, folder: Path, console: Console) -> None:
    """Print the verdict, how the best candidates did, and what goes with the verdict."""
    grid = Grid(
        "candidate", "gain", "explained", "held-out gain", "on a bound", title="Candidates, the largest gain first"
    )
    shown = result.candidates[:SHOWN]
    if result.judged is not None and result.judged not in shown:
        shown = (*shown[:-1], result.judged)
    for one in shown:
        explained = "" if one.explained is None else percent(one.explained)
        grid.add_row(one.name, _whole(one.gain), explained, held_out(one), " ".join(one.on_bound))
    console.print(grid)
    if words := quantity_words(result):
        console.print(f"compared: the force, {words}")
    for line in left_out_lines(result):
        console.print(line)
    named = f" {result.answer}" if result.answer else ""
    console.print(Text.assemble((result.verdict, "bold"), f"{named}: {result.why}"))
    console.print(in_words(result.confidence))
    if sentence := in_one_sentence(result):
        console.print(sentence)
    for part in result.parts:
        console.print(f"  {part.effect}: {standing(part, result)}")
    for line in _law_lines(result, folder):
        console.print(line)
    if words := gap_words(result):
        console.print(f"held-out error in units of noise: {words}")
    for line in (*_conflict_lines(result), *_outside_lines(result), *_next_lines(result, folder)):
        console.print(line)


def left_out_lines(result: DiscoverResult) -> list[str]:
    """Effects of the library that the solver of a user's own model does not have as it should."""
    return [f"{name} is no candidate: {why}" for name, why in (result.left_out or {}).items()]


def gap_of(result: DiscoverResult) -> tuple[str, SplitGap] | None:
    """The kind of held-out data on which the model as it is leaves a gap to a true one, and the gap; None without."""
    for kind, one in (result.gap.splits or {}).items():
        if one.closed is not None and one.before > GAP * one.floor:
            return kind, one
    return None


def gap_words(result: DiscoverResult) -> str:
    """How much of the gap on held-out data the effects close, in words; empty where nothing was held out."""
    found = gap_of(result)
    if result.gap.splits is None and result.gap.before is not None:  # of an older version
        return f"{result.gap.before:.2f} as it is, {result.gap.after:.2f} with {result.shown_name}"
    if found is None:
        first = next(iter((result.gap.splits or {}).values()), None)
        return "" if first is None else f"{first.before:.2f} as it is, a true model {first.floor:.2f}: no gap to close"
    kind, one = found
    ends = f"{one.before:.2f} as it is, {one.after:.2f} with {result.shown_name} on {HELD_OUT[kind]}"
    closed = min(one.closed, 1.0) if one.closed is not None else 0.0
    return f"{ends} (a true model: {one.floor:.2f}); gap closed: {closed:.2f}"


def held_out(one: CandidateResult) -> str:
    """A candidate's gain on held-out data with its standard error; empty where nothing was held out."""
    if one.held_out is None:
        return ""
    error = "unknown" if one.held_out_error is None else _whole(one.held_out_error)
    return f"{_whole(one.held_out)} ± {error}"


def _whole(value: float) -> str:
    """A number without decimals."""
    return number(float(f"{value:.0f}"))


def _conflict_lines(result: DiscoverResult) -> Iterator[str]:
    worst = result.conflict.worst
    if result.conflict.p < UNLIKELY and worst is not None:
        yield (
            f"the protocols want different parameters ({unlikely(result.conflict.p)}): most of all {worst.parameter}, "
            f"{worst.values[0]:.4g} in {worst.curves[0]}, {worst.values[1]:.4g} in {worst.curves[1]}"
        )


def _outside_lines(result: DiscoverResult) -> Iterator[str]:
    if result.outside:
        nearest = result.outside.similar[0]
        yield (
            f"what the model as it is leaves looks most like {nearest.effect} (cosine {nearest.cosine:.2f} of at most "
            f"{result.outside.largest_cosine:.2f}); a description, no mechanism:"
        )
        yield from (f"  {one.specimen}: {one.sentence}" for one in result.outside.corrections)


def _law_lines(result: DiscoverResult, folder: Path) -> Iterator[str]:
    """A law, the study with it, and the test that would refute it."""
    if law := result.law:
        yield of_the_law(result)
        yield f"the study with it: {folder / law.path}"
        if test := law.refuted_by:
            against = " + ".join(law.other) or "the model without it"
            yield (
                f"what would refute it: {test.name} ({test.words}); there, it and {against} differ by up to "
                f"{test.newtons:.1f} N"
            )


def _next_lines(result: DiscoverResult, folder: Path) -> Iterator[str]:
    """The experiment to do next, or the study with the effects."""
    if experiment := result.next_experiment:
        yield (
            f"what would tell: {experiment.name} ({experiment.words}); then {wrong_one(experiment)} is off by up to "
            f"{experiment.newtons:.1f} N, {experiment.at_s:.0f} s into the test"
        )
    if result.model:
        yield f"the study with it: {folder / result.model.path}\n{result.model.difference}"


def wrong_one(experiment: NextExperiment) -> str:
    """What a test that tells two candidates apart is off by, if it is wrong: either of them, or the bare model."""
    return "the wrong one" if experiment.pair.other and experiment.pair.truth else "the model without it"


def noise_words(level: NoiseLevel) -> str:
    """The noise of a specimen: its standard deviation at rest, and what it grows by with the force."""
    grows = f" and {100 * level.proportional:.2g} % of the force" if level.proportional > 0 else ""
    return f"{number(level.sd_N)} N{grows}"


def unlikely(p: float) -> str:
    """A probability that may be too small for a number of the machine."""
    return f"p {p:.1g}" if p > 0.0 else "p below 1e-300"
