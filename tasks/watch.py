"""A live view of a result folder, read from its files alone: of a run that goes on anywhere, ended, or was cut short.

Nothing is ever written to the folder. What runs tells of itself in ``progress.json``; rows, failures and jobs are those
of :mod:`tasks.status`, which takes longer the more rows there are, so a thread looks them up now and then.
"""

import json
import os
import select
import signal
import socket
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table as Grid
from rich.text import Text

from runner.dashboard import way_to
from runner.errors import SinewError
from runner.progress import FAILED, FINISHED, INTERRUPTED, RUNNING
from tasks.problems import BadInput, one_line
from tasks.status import duration, read_status, sign_of_life
from tasks.task import TASKS

LOOK_EVERY_S, SHARE = 2.0, 10  # the thread that looks rows up rests for SHARE times as long as that took
ENDS_S = 10.0  # for that thread, at the end
LINE_EVERY_S = 10.0
NOTES_SHOWN, FAILURES_SHOWN, FINISHED_SHOWN = 12, 3, 8
LOG_TAIL_BYTES = 2**18
ABSENT, QUEUED, UNKNOWN = "absent", "queued", "unknown"
OVER = (FINISHED, FAILED, INTERRUPTED)
_MARKS = {
    FINISHED: "[green]done[/]",
    RUNNING: "[cyan]running[/]",
    FAILED: "[red]failed[/]",
    INTERRUPTED: "[yellow]interrupted[/]",
}


@dataclass
class Rows:
    """Rows, failures and jobs of a folder, looked up by a thread; :meth:`now` never waits for it."""

    folder: Path
    _found: dict[str, Any] = field(default_factory=dict)
    _problem: str = ""
    _wake: threading.Event = field(default_factory=threading.Event)

    def now(self) -> tuple[dict[str, Any], str]:
        """What was found last, and why nothing could be found."""
        return self._found, self._problem

    def look(self) -> float:
        """Look them up; returns how many seconds it took."""
        started = time.monotonic()
        try:
            if (self.folder / "store.zarr").is_dir() or (self.folder / "jobs" / "jobs.jsonl").is_file():
                self._found = read_status(self.folder)
            self._problem = ""
        except SinewError as error:  # a table that is being created, or damage, which its line names
            self._problem = str(error)
        return time.monotonic() - started

    @contextmanager
    def followed(self) -> Iterator[None]:
        """Look now and then until the end."""

        def follow() -> None:
            pause = 0.0
            while not self._wake.wait(pause):
                pause = max(LOOK_EVERY_S, SHARE * self.look())

        thread = threading.Thread(target=follow, name="sinew-watch", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._wake.set()
            thread.join(ENDS_S)  # what the interpreter ends in the middle of a look shows as an error


def look(folder: Path, rows: Rows) -> dict[str, Any]:
    """What can be said of a folder now, as plain data: what ``--json`` prints and :func:`picture` shows."""
    found, problem = rows.now()
    now = sign_of_life(folder, time.time())
    told = _told_tasks(folder)
    jobs = found.get("jobs", [])
    live = [job for job in jobs if job["state"] in ("running", "waiting")]
    state = _state(folder, now, told, live)
    part = _part(now, state)
    return {
        "folder": str(folder),
        "study": found.get("study"),
        "state": state,
        "error": (now or {}).get("error") or None,
        "tasks": _tasks(folder, now, told, state),
        "now": _counted(now) if now is not None else None,
        "task": part,
        "notes": _notes(now, part),
        "workers": (now or {}).get("workers"),
        "jobs": {
            "running": sum(job["state"] == "running" for job in live),
            "waiting": _waiting(live),
            "all": len(jobs),
        },
        "rows": [
            {"table": t["table"], "rows": t["rows"], "done": t["done"], "failed": sum(t["failed"].values())}
            for t in found.get("tables", [])
        ],
        "failures": found.get("last_failures", []),
        "dashboard": way_to((now or {}).get("dashboard"), socket.gethostname()) if state == RUNNING else None,
        "problem": problem or None,
    }


def _waiting(jobs: list[dict[str, Any]]) -> int:
    return sum(job["state"] == "waiting" for job in jobs)


def _state(folder: Path, now: dict[str, Any] | None, told: dict[str, Any], live: list[dict[str, Any]]) -> str:
    if now is not None and now["alive"]:
        return RUNNING
    if any(job["role"] == "coordinator" for job in live):
        return QUEUED
    if now is not None and now.get("state") in (FINISHED, FAILED, INTERRUPTED):
        return str(now["state"])
    if now is not None and "state" in now:  # its process is gone, or silent, and did not say why
        return INTERRUPTED
    if told:
        return FINISHED if all(each["state"] == FINISHED for each in told.values()) else INTERRUPTED
    return UNKNOWN if folder.is_dir() else ABSENT


def _told_tasks(folder: Path) -> dict[str, Any]:
    """What the end of the log says of each task."""
    tasks: dict[str, Any] = {}
    with suppress(OSError), open(folder / "log.jsonl", "rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - LOG_TAIL_BYTES))
        for line in file.read(LOG_TAIL_BYTES).splitlines():
            with suppress(ValueError, RecursionError):  # the first line is cut, the last may be
                event = json.loads(line)
                task = str(event.get("task")) if isinstance(event, dict) else ""
                if task in TASKS and event.get("message") == "task started":
                    tasks[task] = {"state": INTERRUPTED}
                elif task in TASKS and event.get("message") == "task finished":
                    seconds = event.get("seconds")
                    usable = isinstance(seconds, int | float) and 0 <= seconds < 1e9
                    tasks[task] = {"state": FINISHED} | ({"seconds": seconds} if usable else {})
    return tasks


def _tasks(folder: Path, now: dict[str, Any] | None, told: dict[str, Any], state: str) -> list[dict[str, Any]]:
    """The tasks of this folder: those of the last command in its order, after those that were done before."""
    states = (now or {}).get("tasks") or {}
    wanted = [task for task in states if task in TASKS]
    before = [task for task in TASKS if task not in wanted]
    before = [task for task in before if task in told or (folder / f"{task}.json").is_file()]
    ended = {RUNNING: RUNNING, QUEUED: "waiting"}.get(state, state)
    found = []
    for task in before + wanted:
        one = dict(told.get(task, {"state": FINISHED}))
        if task in wanted:
            one["state"] = {"finished": FINISHED, "running": ended}.get(str(states[task]), "waiting")
        if one["state"] != FINISHED:
            one.pop("seconds", None)
        found.append({"task": task, **one})
    return found


def _counted(now: dict[str, Any]) -> dict[str, Any]:
    names = ("title", "of", "done", "total", "failed", "running", "rows_per_s", "eta_s", "age_s", "alive")
    counted = {name: now.get(name) for name in names}
    return counted | {"title": one_line(str(now["title"]))[:200], "of": one_line(str(now.get("of") or "rows"))[:20]}


def _part(now: dict[str, Any] | None, state: str) -> str | None:
    """The task whose notes are worth a look: the one that runs, else the last that has any."""
    notes = (now or {}).get("notes") or {}
    task = (now or {}).get("task")
    if state == RUNNING or task in notes:
        return task if isinstance(task, str) else None
    return str(list(notes)[-1]) if notes else None


def _notes(now: dict[str, Any] | None, part: str | None) -> dict[str, Any]:
    notes = ((now or {}).get("notes") or {}).get(part)
    notes = notes if isinstance(notes, dict) else {}
    return {
        one_line(name)[:100]: note | {"words": one_line(note["words"])[:300]}
        for name, note in notes.items()
        if isinstance(note, dict) and isinstance(note.get("words"), str)
    }


# ---- for a person


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
    QUEUED: "waits in SLURM's queue",
    UNKNOWN: "nothing has run here yet",
    INTERRUPTED: "interrupted: run the same command again to go on, finished rows are kept",
    FAILED: "failed; mend what the line below says and run the same command again, finished rows are kept",
}


def _head(found: dict[str, Any]) -> Text:
    style = {RUNNING: "cyan", FINISHED: "green", FAILED: "red"}.get(found["state"], "yellow")
    head = Text(one_line(f"{found['study']}: " if found["study"] else "") + one_line(found["folder"]) + "  ", "bold")
    head.append(_WORDS.get(found["state"], found["state"]), style)
    if found["state"] == INTERRUPTED and found["now"] is not None:
        head.append(f" (last sign of life {duration(found['now']['age_s'])} ago)")
    if found["state"] == RUNNING:
        head.append(_forces(found))
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
        took = f" {duration(one['seconds'])}" if "seconds" in one else ""
        cells.append(f"{one['task']} {_MARKS.get(one['state'], '[dim]' + one['state'] + '[/]')}{took}")
    return Text.from_markup("  ".join(cells))


def _bar(now: dict[str, Any], state: str) -> RenderableType:
    grid = Grid.grid(padding=(0, 1))
    grid.add_column(overflow="ellipsis", no_wrap=True)
    grid.add_column(width=24)
    grid.add_column(no_wrap=True)
    words = f"{now['done']:,} of {now['total']:,} {now['of']}"
    if state == RUNNING and now["done"] < now["total"]:
        words += f", {now['rows_per_s'] or 0:,.3g}/s"
        words += f", {duration(now['eta_s'])} left" if now["eta_s"] is not None else ""
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
        grid.add_row(escape(one_line(one["table"])), *(f"{cell:,}" for cell in cells))
    if len(ordered) > FINISHED_SHOWN:
        rest = ordered[FINISHED_SHOWN:]
        sums = [sum(one[name] for one in rest) for name in ("rows", "done", "failed")]
        cells = (*sums, sums[0] - sums[1])
        grid.add_row(f"and {len(rest)} more", *(f"{cell:,}" for cell in cells))
    return grid


def line(found: dict[str, Any]) -> str:
    """What was found, in one line."""
    now, words = found["now"], [_head(found).plain]
    if found["state"] == RUNNING and now is not None and now["total"]:
        eta = f", {duration(now['eta_s'])} left" if now["eta_s"] is not None else ""
        failed = f", {now['failed']:,} failed" if now["failed"] else ""
        words.append(f"{now['title']}: {now['done']:,} of {now['total']:,} {now['of']}{failed}{eta}")
    elif found["tasks"]:
        words.append(", ".join(f"{one['task']} {one['state']}" for one in found["tasks"]))
    words += [f"{name}: {note['words']}" for name, note in list(found["notes"].items())[-1:]]
    if found["error"]:
        words.append(found["error"])
    return one_line("; ".join(words))


# ---- the command

Form = Literal["picture", "json"]


def watch(folder: Path, *, form: Form = "picture", once: bool = False, every_s: float = 1.0) -> dict[str, Any]:
    """Show a folder until its run is over, or until ``q`` or Ctrl-C; returns what was seen last.

    Where nothing has run yet, it waits. Raises :class:`BadInput` when ``folder`` is no folder, or, with ``once``, when
    it is not there.
    """
    _check(folder, once=once)
    rows = Rows(folder)
    if once:
        rows.look()
        found = look(folder, rows)
        if form == "json":
            print(json.dumps(found), flush=True)
        else:
            Console(highlight=False).print(picture(found))
        return found
    console = Console(highlight=False)
    live = form == "picture" and console.is_terminal and not console.is_dumb_terminal
    if folder.is_dir():
        rows.look()
    with rows.followed():
        return _live(folder, rows, console, every_s) if live else _lines(folder, rows, form, every_s)


def _check(folder: Path, *, once: bool) -> None:
    if os.path.lexists(folder) and not folder.is_dir():
        raise BadInput(folder, "is a file", "a result folder, as given to --out")
    if not once:
        return
    if not folder.is_dir():
        raise BadInput(folder, "is not there", "a result folder, as given to --out; without --once, it is waited for")


def _live(folder: Path, rows: Rows, console: Console, every_s: float) -> dict[str, Any]:
    found = look(folder, rows)
    with _keys() as pressed, Live(picture(found), console=console, auto_refresh=False) as shown:
        while found["state"] not in OVER:
            if pressed(every_s) in ("q", "Q"):
                break
            found = look(folder, rows)
            shown.update(Group(picture(found), Text("q or Ctrl-C leaves, whatever runs goes on", "dim")), refresh=True)
        rows.look()
        found = look(folder, rows)
        shown.update(picture(found), refresh=True)
    return found


def _lines(folder: Path, rows: Rows, form: Form, every_s: float) -> dict[str, Any]:
    """A line when something has changed: at once for a program, now and then, or at a new state, for a person."""
    last: dict[str, Any] = {}
    told_at = -LINE_EVERY_S
    while True:
        found = look(folder, rows)
        over = found["state"] in OVER
        if over:
            rows.look()
            found = look(folder, rows)
        new_state = found["state"] != last.get("state") or found["tasks"] != last.get("tasks")
        if _changed(found, last) and (form == "json" or new_state or time.monotonic() - told_at >= LINE_EVERY_S):
            print(json.dumps(found) if form == "json" else line(found), flush=True)
            last, told_at = found, time.monotonic()
        if over:
            return found
        time.sleep(every_s)


def _changed(found: dict[str, Any], last: dict[str, Any]) -> bool:
    def of(one: dict[str, Any]) -> dict[str, Any]:
        now = {
            name: fact for name, fact in (one.get("now") or {}).items() if name not in ("age_s", "rows_per_s", "eta_s")
        }
        return {**one, "now": now}

    return not last or of(found) != of(last)


@contextmanager
def _keys() -> Iterator[Callable[[float], str]]:
    """Single keys of the terminal; gives a function that waits so many seconds for one and returns it, or nothing."""
    if not sys.stdin.isatty():

        def nothing(seconds: float) -> str:
            time.sleep(seconds)
            return ""

        yield nothing
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)

    def pressed(seconds: float) -> str:
        ready, _, _ = select.select([terminal], [], [], seconds)
        return (os.read(terminal, 1).decode("ascii", "replace") or "q") if ready else ""

    def put_back(*_: Any) -> None:
        raise SystemExit(128 + signal.SIGTERM)

    handler = signal.signal(signal.SIGTERM, put_back)
    try:
        tty.setcbreak(terminal)
        yield pressed
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
        signal.signal(signal.SIGTERM, handler)
