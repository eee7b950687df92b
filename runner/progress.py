"""What a person sees while evaluations run: a bar on a terminal, a line now and then elsewhere, a file for others."""

import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.text import Text

log = logging.getLogger("sinew")


PROGRESS = "progress.json"
TELL_EVERY_S, SHOW_EVERY_S = 2.0, 10.0

#: Called with the number of rows that are finished now, how many of them failed, and how many batches are running.
Report = Callable[[int, int, int], None]


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:,.3g} {task.fields['of']}/s" if task.speed else "")


@contextmanager
def progress(
    title: str, total: int, folder: Path, *, of: str = "rows", done: int = 0, quiet: bool = False
) -> Iterator[Report]:
    """Show how ``total`` rows, or whatever is counted, come along: rate and time left. ``done`` are there from before.

    ``folder/progress.json`` says the same to whoever asks from elsewhere, see :func:`read_progress`.
    """
    started = time.monotonic()
    shown = told = started
    facts: dict[str, Any] = {"title": title, "done": done, "total": total, "failed": 0, "running": 0}

    def update(finished: int, failed: int, running: int) -> None:
        rate = (finished - done) / max(time.monotonic() - started, 1e-9)
        left = (total - finished) / rate if rate > 0 else None
        facts.update(done=finished, failed=failed, running=running, rows_per_s=round(rate, 3))
        facts["eta_s"] = None if left is None else round(left, 1)

    def note() -> None:
        log.info("progress", extra=facts)
        if not quiet and not console.is_terminal:
            left = facts["eta_s"]
            eta = "" if left is None or left < 1 else f", {left:,.0f} s left"
            line = f"{title}: {facts['done']:,} of {total:,} {of}, {facts['rows_per_s']:,.4g} {of}/s{eta}"
            print(line, file=sys.stderr, flush=True)

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        Remaining(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal) as bars:
        bar = bars.add_task(title, total=total, completed=done, note="", of=of)

        def report(finished: int, failed: int, running: int) -> None:
            nonlocal shown, told
            now = time.monotonic()
            update(finished, failed, running)
            bars.update(bar, completed=finished, note=f"[red]{failed} failed" if failed else "")
            if now - told >= TELL_EVERY_S:
                told = now
                _tell(folder, facts)
            if now - shown >= SHOW_EVERY_S:
                shown = now
                note()

        try:
            yield report
        finally:
            update(facts["done"], facts["failed"], 0)
            with suppress(OSError):  # whatever ended the work has been told of already
                _tell(folder, facts)
            note()


def _tell(folder: Path, facts: dict[str, Any]) -> None:
    temporary = folder / f".{PROGRESS}.{os.getpid()}"
    temporary.write_text(json.dumps({**facts, "time": round(time.time(), 1)}) + "\n", "utf-8")
    os.replace(temporary, folder / PROGRESS)


def read_progress(folder: Path) -> dict[str, Any] | None:
    """What was last told about a result folder: rows done, failed and running, rate, and seconds left; or None."""
    try:
        facts = json.loads((folder / PROGRESS).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return facts if isinstance(facts, dict) and _usable(facts) else None


def _usable(facts: dict[str, Any]) -> bool:
    """Whether the file says what :func:`_tell` writes: a title, and numbers that can be shown."""
    numbers = [facts.get(name) for name in ("done", "total", "time")]
    numbers += [facts.get(name, 0) for name in ("failed", "running", "rows_per_s")]
    numbers += [] if facts.get("eta_s") is None else [facts["eta_s"]]
    usable = all(isinstance(n, int | float) and -1e15 < n < 1e15 for n in numbers)
    return usable and isinstance(facts.get("title"), str)
