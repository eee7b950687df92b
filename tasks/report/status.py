"""What a result folder holds and what works on it, read from its files alone: it works where nothing runs."""

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
from rich.table import Column
from rich.table import Table as Grid

from sinew.runner.cluster.job_table import JobTable
from sinew.runner.console import Console
from sinew.runner.errors import StoreError, brief, one_line
from sinew.runner.printing import no_formula
from sinew.runner.progress import FAILED, FINISHED, INTERRUPTED, RUNNING, is_here, read_progress
from sinew.runner.store.schema import PENDING, STATUSES, Array
from sinew.runner.store.segment import LONGEST_MESSAGE, Segment
from sinew.runner.store.store import open_store
from sinew.runner.store.table import Table
from sinew.tasks.drawing.blocks import duration
from sinew.tasks.registry import TASKS
from sinew.tasks.study.files import last_events

PAGE = "report.html"
MOST_S = 1e9
SILENT_S = 60.0  # who works tells of it every few seconds
JOBS_SHOWN = 12
FAILURES_SHOWN = 5
LOG_TAIL_BYTES = 2**18


def read_status(folder: Path) -> dict[str, Any]:
    """Rows done, failed, running and left; rate and time left; what it cost; jobs, and the last failures."""
    now = time.time()
    jobs = JobTable(folder / "jobs").read()
    store = None if jobs and not (folder / "store.zarr").is_dir() else open_store(folder)  # None: it waits in the queue
    tables, by_job, failures = [], dict.fromkeys(jobs, 0), []
    for table in store.tables() if store is not None else ():
        outcomes = _Outcomes(table)
        failed = {name: int((outcomes.status == i).sum()) for i, name in enumerate(STATUSES) if i}
        if jobs:
            for worker, count in zip(*np.unique(outcomes.read("worker"), return_counts=True), strict=True):
                job = split_worker(str(worker))[2]
                by_job[job] = by_job.get(job, 0) + int(count)
        last = np.flatnonzero(outcomes.status > 0)[-FAILURES_SHOWN:]
        for at, worker, words in zip(last, *(outcomes.read(name, last) for name in ("worker", "message")), strict=True):
            node, _, job = split_worker(str(worker))
            status, message = STATUSES[outcomes.status[at]], str(words)[:LONGEST_MESSAGE]
            failure = {"table": brief(table.title), "row": int(outcomes.rows[at]), "status": status, "message": message}
            failures.append(failure | {"node": brief(node), "job": brief(job)})
        tables.append(
            {
                "table": brief(table.title),
                "key": one_line(table.name.rpartition("-")[2])[:6],
                "rows": max(
                    len(table), int(outcomes.rows.size)
                ),  # the journal may be ahead of what is planned in the store
                "done": int(outcomes.rows.size),
                "failed": {name: count for name, count in failed.items() if count},
                "core_hours": float(outcomes.seconds[np.isfinite(outcomes.seconds)].sum()) / 3600,
            }
        )
    _tell_apart(tables)
    by_job.pop("", None)
    return {
        "folder": str(folder),
        "study": "waiting" if store is None else brief(store.study),
        "tables": tables,
        "now": sign_of_life(folder, now),
        "jobs": [
            {
                "job": record.job,
                "role": brief(record.role),
                "nodes": brief(record.nodes),
                "state": brief(record.end) if record.ended else "running" if record.started else "waiting",
                "core_hours": record.core_hours(now),
                "rows": by_job.get(record.job, 0),
            }
            for record in jobs.values()
        ],
        "last_failures": failures,
        "core_hours": {
            "evaluations": sum(table["core_hours"] for table in tables),
            "jobs": sum(record.core_hours(now) for record in jobs.values()),
        },
        "results": [path.stem for path in _results(folder)],
        "failed_tasks": {
            task: each["reason"] for task, each in logged_tasks(folder).items() if each["state"] == FAILED
        },
    }


def _tell_apart(tables: list[dict[str, Any]]) -> None:
    """Put the beginning of a table's key behind its title where others have the same: their inputs differ."""
    titles = Counter(table["table"] for table in tables)
    for table in tables:
        key = table.pop("key")
        if titles[table["table"]] > 1:
            table["table"] += f" ({key})"


def _results(folder: Path) -> list[Path]:
    """The files of finished tasks."""
    files = (folder / f"{task}.json" for task in (*TASKS, "simulate"))
    return [file for file in files if file.is_file()]


def current_page(folder: Path) -> Path | None:
    """The page of a result folder, if it is there and was built from the results that are there now.

    One that somebody else has written, in which other scripts may run, does not count.
    """
    from sinew.tasks.report.page_head import has_our_head  # slow to import

    page = folder / PAGE
    newest = max((file.stat().st_mtime_ns for file in _results(folder)), default=0)
    return page if page.is_file() and page.stat().st_mtime_ns >= newest and has_our_head(page) else None


class _Outcomes:
    """All rows of a table that have an outcome, with those that are not folded in yet.

    ``rows``, their ``status`` and ``seconds``, each ``[n]``; other columns are read when they are asked for.
    """

    def __init__(self, table: Table) -> None:
        self._table = table
        self._segments = []
        for path in table.segments():
            try:
                self._segments.append(Segment.read(path))
            except StoreError:  # folded in meanwhile
                continue
        waiting = [segment.rows for segment in self._segments]
        folded = np.flatnonzero(table.status != PENDING)
        self._folded = np.setdiff1d(folded, np.concatenate(waiting)) if waiting else folded
        rows = np.concatenate([self._folded, *waiting])
        self._order = np.argsort(rows, kind="stable")
        self.rows = rows[self._order]
        status = [table.status[self._folded], *(segment.status for segment in self._segments)]
        self.status: Array = np.concatenate(status)[self._order]
        self.seconds = self.read("wall_seconds")

    def read(self, name: str, chosen: Array | None = None) -> Array:
        """A column of all rows, or of those at the ``chosen`` positions ``[k]``."""
        places = self._order if chosen is None else self._order[chosen]
        counts = [self._folded.size, *(segment.rows.size for segment in self._segments)]
        ends = np.cumsum(counts)
        found = np.empty(places.size, dtype=object if name in ("worker", "message") else np.float64)
        for number, (end, count) in enumerate(zip(ends, counts, strict=True)):
            here = np.flatnonzero((places >= end - count) & (places < end))
            inside = places[here] - (end - count)
            if number == 0:
                found[here] = self._table.read(name, self._folded[inside])
            else:
                found[here] = self._segments[number - 1].column(name, inside)
        return found


def split_worker(worker: str) -> tuple[str, str, str]:
    """Node, process and job of the worker that evaluated a row; the job is empty outside of a batch system."""
    place, _, job = worker.partition(" job ")
    node, _, process = place.rpartition(":")
    return node, process, job


def rows_as_csv(folder: Path) -> Iterator[str]:
    """A line for each finished row: who evaluated it, where, and what came of it."""
    yield "table,row,status,attempts,seconds,node,process,job"
    for table in open_store(folder).tables():
        outcomes = _Outcomes(table)
        title = _cell(table.title)
        workers, attempts = outcomes.read("worker"), outcomes.read("attempts")
        for i, row in enumerate(outcomes.rows):
            worker = ",".join(_cell(part) for part in split_worker(str(workers[i])))
            yield f"{title},{row},{STATUSES[outcomes.status[i]]},{attempts[i]:.0f},{outcomes.seconds[i]:.6g},{worker}"


def _cell(text: str) -> str:
    """A text as a cell of a CSV table, which no spreadsheet takes for a formula."""
    text = no_formula(one_line(text))
    return '"' + text.replace('"', '""') + '"' if set(text) & set('",') else text


def sign_of_life(folder: Path, now: float) -> dict[str, Any] | None:
    facts = read_progress(folder)
    if facts is None:
        return None
    age = now - facts["time"]
    alive = age < SILENT_S and facts.get("state", RUNNING) == RUNNING and is_here(facts.get("process")) is not False
    if "state" not in facts:  # written by an older version, which did not record how it ended
        alive = alive and facts["done"] < facts["total"]
    return {**facts, "title": brief(str(facts["title"])), "age_s": round(age, 1), "alive": alive}


def logged_tasks(folder: Path) -> dict[str, Any]:
    """The state of each task, from the end of the log; with its seconds, or the reason why it failed."""
    tasks: dict[str, Any] = {}
    for event in last_events(folder, LOG_TAIL_BYTES):
        task, message = str(event.get("task")), event.get("message")
        if task in TASKS and message == "task started":
            tasks[task] = {"state": INTERRUPTED}
        elif task in TASKS and message == "task failed":
            tasks[task] = {"state": FAILED, "reason": brief(one_line(str(event.get("reason", ""))))}
        elif task in TASKS and message == "task finished":
            seconds = event.get("seconds")
            tasks[task] = {"state": FINISHED} | ({"seconds": seconds} if is_seconds(seconds) else {})
    return tasks


def is_seconds(value: Any) -> TypeGuard[float]:
    """Whether a value from a file, which may say anything, can be what something took."""
    return isinstance(value, int | float) and 0 <= value < MOST_S


def print_status(found: dict[str, Any]) -> None:
    """The same for a person."""
    console = Console(highlight=False)
    title = one_line(f"{found['study']}: {found['folder']}")
    grid = Grid(Column("evaluations", overflow="fold"), "rows", "done", "failed", "left", "core-hours", title=title)
    for table in found["tables"]:
        failed = sum(table["failed"].values())
        cells = (table["rows"], table["done"], failed, table["rows"] - table["done"])
        grid.add_row(one_line(table["table"]), *(f"{cell:,}" for cell in cells), f"{table['core_hours']:.3g}")
    console.print(grid)
    console.print(_now(found["now"]))
    if found["jobs"]:
        _print_jobs(console, found)
    for failure in found["last_failures"]:
        place = f" ({failure['node']}{', job ' + failure['job'] if failure['job'] else ''})"
        words = f"{failure['table']}, row {failure['row']}: {failure['status']}: {failure['message']}"
        console.print(one_line(words + place))
    for task, reason in found["failed_tasks"].items():
        console.print(f"{task} failed: {reason}", soft_wrap=True)
    console.print(f"finished: {', '.join(found['results']) or 'nothing yet'}")


def _now(progress: dict[str, Any] | None) -> str:
    if progress is None:
        return "nothing runs"
    line = one_line(f"{progress['title']}: {progress['done']:,} of {progress['total']:,} rows")
    if not progress["alive"]:
        return f"nothing runs; last sign of life {duration(round(progress['age_s']))} ago ({line})"
    left = f", {duration(round(progress['eta_s']))} left for these" if progress.get("eta_s") is not None else ""
    counted = f"{progress.get('running', 0):,} running, {progress.get('rows_per_s', 0):.4g} rows/s{left}"
    return f"{line}, {counted}{about_left(left_of_run(progress))}"


def left_of_run(progress: dict[str, Any]) -> float | None:
    """Seconds that the whole run will still take: the rest of the task that runs, and all that wait for it.

    None where the run made no estimate. The file may come from anywhere.
    """
    expected, tasks, now = (progress.get(name) for name in ("expected_s", "tasks", "task"))
    if not isinstance(expected, dict) or not isinstance(tasks, dict) or not isinstance(now, str):
        return None
    seconds = {n: float(s) for n, s in expected.items() if is_seconds(s)}
    since = progress.get("task_since")
    usable = isinstance(since, int | float) and 0 <= since <= progress["time"]
    elapsed = progress["time"] - since if usable else 0.0
    running = max(seconds.get(now, 0.0) - elapsed, progress.get("eta_s") or 0.0)
    return running + sum(seconds.get(name, 0.0) for name, state in tasks.items() if state == "waiting")


def about_left(seconds: float | None) -> str:
    return f", about {duration(round(seconds))} left of the run" if seconds is not None else ""


def _print_jobs(console: Console, found: dict[str, Any]) -> None:
    jobs = found["jobs"]
    live = [job for job in jobs if job["state"] in ("running", "waiting")]
    ended = [job for job in jobs if job["state"] not in ("running", "waiting")]
    shown = ended[-max(JOBS_SHOWN - len(live), 3) :] + live[:JOBS_SHOWN]
    grid = Grid("job", "role", "node", "state", "rows", "core-hours")
    for job in shown:
        words = (one_line(str(job[name])) for name in ("job", "role", "nodes", "state"))
        grid.add_row(*words, f"{job['rows']:,}", f"{job['core_hours']:.3g}")
    console.print(grid)
    if len(shown) < len(jobs):
        which = ", all ended" if len(live) <= JOBS_SHOWN else ""
        console.print(f"{len(jobs) - len(shown):,} more jobs{which}: see --json")
    cost = found["core_hours"]
    console.print(f"cost: {cost['jobs']:.3g} core-hours of jobs, {cost['evaluations']:.3g} of them in evaluations")
