"""How emulators are shown: as a table and on the console."""

from pathlib import Path

import numpy as np
import pandas as pd
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.console import Console
from sinew.tasks.drawing.blocks import percent, plural
from sinew.tasks.surrogate.result import OfSpecimen, SurrogateResult


def table(result: SurrogateResult) -> pd.DataFrame:
    """How well each course is emulated, by specimen, output and protocol."""
    rows = [
        {
            "specimen": name, "output": course.output, "protocol": course.protocol, "unit": course.unit,
            "spread": course.spread, "error": course.error, "fresh_error": course.fresh_error,
            "fresh_inside": course.fresh_inside, "runs": one.runs, "failed": one.failed,
        }
        for name, one in result.specimens.items()
        for course in one.courses.values()
    ]  # fmt: skip
    return pd.DataFrame(rows).set_index(["specimen", "output", "protocol"])


def headline(result: SurrogateResult) -> str:
    """What came out, in one line."""
    runs = sum(one.runs for one in result.specimens.values())
    asked = "" if result.reached else f"; {percent(result.asked, 1)} was asked"
    return f"errors of at most {percent(result.error, 1)} of the spread from {plural(runs, 'run')}{asked}"


def fresh(one: OfSpecimen) -> tuple[float, float]:
    """The largest error at runs that had not been seen, and the smallest part inside 95 % intervals; NaN without."""
    courses = list(one.courses.values())
    errors, inside = ([getattr(each, name) for each in courses] for name in ("fresh_error", "fresh_inside"))
    known = np.isfinite(errors)
    return (float(np.max(errors)), float(np.min(inside))) if courses and known.all() else (np.nan, np.nan)


def tested(result: SurrogateResult) -> tuple[float, float] | None:
    """The largest error at fresh runs of all specimens, and the smallest part inside; None where there were none."""
    seen = [each for each in map(fresh, result.specimens.values()) if np.isfinite(each[0])]
    return (max(error for error, _ in seen), min(inside for _, inside in seen)) if seen else None


def kinds(one: OfSpecimen) -> str:
    """Which emulators were chosen, in words."""
    names = {"chaos": "polynomial chaos", "process": "Gaussian process"}
    count = {kind: sum(each.kind == kind for each in one.components) for kind in names}
    return ", ".join(f"{names[kind]} {number}" for kind, number in count.items() if number) or "nothing varies"


def region(one: OfSpecimen) -> str:
    """What is known of where a model fails, in words; empty where nothing failed."""
    if not one.failed:
        return ""
    said = f"{one.failed:,} of {one.runs:,} runs failed"
    if not np.isfinite(one.caught):
        return f"{said}: too few, or too many, to learn where"
    foreseen = f"in cross-validation, {percent(one.caught)} of the failures were foreseen"
    return f"{said}; {foreseen}, and {percent(one.mistaken)} of the other runs were wrongly expected to fail"


def summary(result: SurrogateResult, folder: Path, console: Console) -> None:
    """Print how well each specimen is emulated."""
    grid = Grid("specimen", "runs", "largest error", "fresh runs", "inside 95 %", "components", title="Emulators")
    for name, one in result.specimens.items():
        error, inside = fresh(one)
        seen = ("–", "–") if np.isnan(error) else (percent(error, 1), percent(inside))
        grid.add_row(name, f"{one.runs:,}", percent(one.error, 1), *seen, kinds(one))
    console.print(grid)
    console.print("errors (rms) in parts of the course's spread over runs: of left-out runs, and of fresh ones")
    for name, one in result.specimens.items():
        if words := region(one):
            console.print(Text.assemble((f"{name}: ", ""), (words, "red")))
    if not result.reached:
        more = f"{percent(result.asked, 1)} was asked: more surrogate.runs, narrower ranges, or fewer free parameters"
        console.print(Text(more, style="red"))
