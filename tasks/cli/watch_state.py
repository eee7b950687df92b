"""The state of a run, read from its files alone: it runs anywhere, has ended, or was cut short.

Nothing is ever written to the folder. A run keeps ``progress.json`` up to date; rows, failures and jobs come from
:mod:`sinew.tasks.report.status`, which takes longer the more rows there are, so a thread reads them now and then.
"""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sinew.runner.cluster.dashboard import way_to
from sinew.runner.errors import SinewError, one_line
from sinew.runner.progress import FAILED, FINISHED, INTERRUPTED, RUNNING
from sinew.tasks.registry import TASKS
from sinew.tasks.report.status import left_of_run, logged_tasks, read_status, sign_of_life

LOOK_EVERY_S, SHARE = 2.0, 10  # the thread that looks rows up rests for SHARE times as long as that took
ENDS_S = 10.0  # for that thread, at the end
ABSENT, QUEUED, UNKNOWN = "absent", "queued", "unknown"


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
    logged = logged_tasks(folder)
    jobs = found.get("jobs", [])
    live = [job for job in jobs if job["state"] in ("running", "waiting")]
    state = _state(folder, now, logged, live)
    part = _part(now, state)
    return {
        "folder": str(folder),
        "study": found.get("study"),
        "state": state,
        "error": (now or {}).get("error") or None,
        "left_s": left_of_run(now) if now is not None and state == RUNNING else None,
        "tasks": _tasks(folder, now, logged, state),
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


def _state(folder: Path, now: dict[str, Any] | None, logged: dict[str, Any], live: list[dict[str, Any]]) -> str:
    if now is not None and now["alive"]:
        return RUNNING
    if any(job["role"] == "coordinator" for job in live):
        return QUEUED
    if now is not None and now.get("state") in (FINISHED, FAILED, INTERRUPTED):
        return str(now["state"])
    if now is not None and "state" in now:  # its process is gone, or silent, and did not say why
        return INTERRUPTED
    if logged:
        return FINISHED if all(each["state"] == FINISHED for each in logged.values()) else INTERRUPTED
    return UNKNOWN if folder.is_dir() else ABSENT


def _tasks(folder: Path, now: dict[str, Any] | None, logged: dict[str, Any], state: str) -> list[dict[str, Any]]:
    """The tasks of this folder: those of the last command in its order, after those that were done before."""
    states = (now or {}).get("tasks") or {}
    wanted = [task for task in states if task in TASKS]
    before = [task for task in TASKS if task not in wanted]
    before = [task for task in before if task in logged or (folder / f"{task}.json").is_file()]
    ended = {RUNNING: RUNNING, QUEUED: "waiting"}.get(state, state)
    words = {"finished": FINISHED, "failed": FAILED, "not run": "not run", "running": ended}
    found = []
    for task in before + wanted:
        one = dict(logged.get(task, {"state": FINISHED}))
        if task in wanted:
            one["state"] = words.get(str(states[task]), "waiting")
        if one["state"] != FINISHED:
            one.pop("seconds", None)
        if one["state"] != FAILED:
            one.pop("reason", None)
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
