"""The state of a run for a person: a picture for a terminal, and a line for everywhere else."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table as Grid
from rich.text import Text

from sinew.runner.errors import one_line
from sinew.runner.progress import FAILED, FINISHED, INTERRUPTED, RUNNING
from sinew.tasks.cli.watch_state import ABSENT, QUEUED, UNKNOWN
from sinew.tasks.drawing.blocks import duration
from sinew.tasks.report.status import about_left

if TYPE_CHECKING:
    from sinew.tasks.study.estimate import Estimate

NOTES_SHOWN, FAILURES_SHOWN, FINISHED_SHOWN = 12, 3, 8
_MARKS = {
    FINISHED: ("done", "green"),
    RUNNING: ("running", "cyan"),
    FAILED: ("failed", "red"),
    INTERRUPTED: ("interrupted", "yellow"),
}


def picture(found: dict[str, Any]) -> RenderableType:
    """What was found, as something that rich can print."""
    parts: list[RenderableType] = [_head(found)]
    if found["tasks"]:
        parts.append(_tasks_line(found["tasks"]))
    if found["now"] is not None and found["now"]["total"]:
        parts.append(_bar(found["now"], found["state"]))
    if found["notes"]:
        parts.append(_notes_table(found))
    if found["rows"]:
        parts.append(_rows_table(found["rows"]))
    failures = sorted(found["failures"], key=lambda one: one["row"])[-FAILURES_SHOWN:]
    for one in failures:
        where = f" ({one['node']})" if one["node"] else ""
        words = one_line(f"{one['table']}, row {one['row']}: {one['status']}: {one['message']}{where}")
        parts.append(Text(words, style="red", no_wrap=True, overflow="ellipsis"))
    if found["error"]:
        parts.append(Text(one_line(found["error"]), style="red"))
    if found["problem"]:
        parts.append(Text(one_line(found["problem"]), style="yellow"))
    if found["dashboard"]:
        parts.append(Text(f"dashboard: {found['dashboard']}", overflow="fold"))
    return Group(*parts)


_WORDS = {
    ABSENT: "is not there yet; waiting for a run to begin",
    QUEUED: "waits in the queue",
    UNKNOWN: "nothing has run here yet",
    INTERRUPTED: "interrupted: run the same command again to go on, finished rows are kept",
    FAILED: "failed; mend what the line below says and run the same command again, finished rows are kept",
}


def _head(found: dict[str, Any]) -> Text:
    style = {RUNNING: "cyan", FINISHED: "green", FAILED: "red"}.get(found["state"], "yellow")
    head = Text(one_line(f"{found['study']}: " if found["study"] else "") + one_line(found["folder"]) + "  ", "bold")
    head.append(_WORDS.get(found["state"], found["state"]), style)
    if found["state"] == INTERRUPTED and found["now"] is not None:
        head.append(f" (last sign of life {duration(round(found['now']['age_s']))} ago)")
    if found["state"] == RUNNING:
        head.append(_forces(found) + about_left(found["left_s"]))
    return head


def _forces(found: dict[str, Any]) -> str:
    """How many work on it."""
    jobs, words = found["jobs"], ""
    if isinstance(found["workers"], int):
        words = f", {found['workers']} worker{'s' if found['workers'] != 1 else ''}"
    if jobs["running"] or jobs["waiting"]:
        words += f", {jobs['running']} jobs run, {jobs['waiting']} wait"
    return words


def _tasks_line(tasks: list[dict[str, Any]]) -> Text:
    cells = []
    for one in tasks:
        took = f" {duration(round(one['seconds']))}" if "seconds" in one else ""
        cells.append(Text.assemble(f"{one['task']} ", _MARKS.get(one["state"], (one["state"], "dim")), took))
    return Text("  ").join(cells)


def _bar(now: dict[str, Any], state: str) -> RenderableType:
    grid = Grid.grid(padding=(0, 1))
    grid.add_column(overflow="ellipsis", no_wrap=True)
    grid.add_column(width=24)
    grid.add_column(no_wrap=True)
    words = f"{now['done']:,} of {now['total']:,} {now['of']}"
    if state == RUNNING and now["done"] < now["total"]:
        words += f", {now['rows_per_s'] or 0:,.3g}/s"
        words += f", {duration(round(now['eta_s']))} left" if now["eta_s"] is not None else ""
        words += f", {now['running']:,} run" if now["running"] else ""
    cells = Text(words)
    if now["failed"]:
        cells.append(f", {now['failed']:,} failed", "red")
    grid.add_row(Text(now["title"]), ProgressBar(total=max(now["total"], 1), completed=now["done"]), cells)
    return grid


def _notes_table(found: dict[str, Any]) -> RenderableType:
    grid = Grid.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column(no_wrap=True, overflow="ellipsis")
    shown = list(found["notes"].items())
    for name, note in shown[:NOTES_SHOWN]:
        grid.add_row(Text(name, "bold"), Text(note["words"]))
    if len(shown) > NOTES_SHOWN:
        grid.add_row("", Text(f"{len(shown) - NOTES_SHOWN} more: see --json", "dim"))
    return grid


def _rows_table(tables: list[dict[str, Any]]) -> RenderableType:
    """Rows by table: those that are not done yet first, since there is room for a few only."""
    grid = Grid("evaluations", box=None, padding=(0, 2), header_style="dim")
    for name in ("rows", "done", "failed", "left"):
        grid.add_column(name, justify="right")
    ordered = sorted(tables, key=lambda one: one["done"] >= one["rows"])
    for one in ordered[:FINISHED_SHOWN]:
        cells = (one["rows"], one["done"], one["failed"], one["rows"] - one["done"])
        grid.add_row(one_line(one["table"]), *(f"{cell:,}" for cell in cells))
    if len(ordered) > FINISHED_SHOWN:
        rest = ordered[FINISHED_SHOWN:]
        sums = [sum(one[name] for one in rest) for name in ("rows", "done", "failed")]
        cells = (*sums, sums[0] - sums[1])
        grid.add_row(f"and {len(rest)} more", *(f"{cell:,}" for cell in cells))
    return grid


def estimate_table(found: Estimate) -> RenderableType:
    """What each task takes, and all of them."""
    grid = Grid("task", box=None, padding=(0, 2), header_style="dim")
    for name in ("evaluations", "time"):
        grid.add_column(name, justify="right")
    for one in found.tasks:
        evaluations = f"{one.evaluations:,}" if one.evaluations and not one.done else "-"
        grid.add_row(one.task, evaluations, "done already" if one.done else duration(round(one.wall_s)))
    if found.workers is None:
        words = f"about {duration(round(found.wall_s))} with one slot; many slots share the evaluations"
    else:
        words = f"about {duration(round(found.wall_s))} with {found.workers} worker{'s' if found.workers != 1 else ''}"
    tried = f"an evaluation took {found.row_s:.3g} s just now; expect half to twice the time. Nothing was written."
    done = [one.task for one in found.tasks if one.done]
    kept = f"Done already, and kept if nothing has changed: {', '.join(done)}." if done else ""
    return Group(grid, Text(f"{words}: {tried}"), *([Text(kept)] if kept else []))


def line(found: dict[str, Any]) -> str:
    """What was found, in one line."""
    now, words = found["now"], [_head(found).plain]
    if found["state"] == RUNNING and now is not None and now["total"]:
        eta = f", {duration(round(now['eta_s']))} left" if now["eta_s"] is not None else ""
        failed = f", {now['failed']:,} failed" if now["failed"] else ""
        words.append(f"{now['title']}: {now['done']:,} of {now['total']:,} {now['of']}{failed}{eta}")
    elif found["tasks"]:
        words.append(", ".join(f"{one['task']} {one['state']}" for one in found["tasks"]))
    words += [f"{name}: {note['words']}" for name, note in list(found["notes"].items())[-1:]]
    if found["error"]:
        words.append(found["error"])
    return one_line("; ".join(words))
