"""What a person sees while evaluations run: a bar on a terminal, a line now and then elsewhere, a file for others."""

import json
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import psutil
from rich.console import Console, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.text import Text

from runner.errors import WalltimeReached
from runner.periodic import every

log = logging.getLogger("sinew")


PROGRESS = "progress.json"
TELL_EVERY_S, SHOW_EVERY_S, BEAT_S = 2.0, 10.0, 10.0
RUNNING, FINISHED, FAILED, INTERRUPTED = "running", "finished", "failed", "interrupted"

#: Called with the number of rows that are finished now, how many of them failed, and how many batches are running.
Report = Callable[[int, int, int], None]

#: Who looks on: a person (bars on a terminal, else a line now and then), a program (JSON lines), or nobody.
Show = Literal["words", "json", "nothing"]


class Board:
    """What a command tells of its work in ``folder/progress.json``, see :func:`read_progress`. Threads may share it.

    The file is replaced as a whole, every few seconds at the most. Use :func:`open_board`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.latest = ""  # what was noted last, in words
        self._facts: dict[str, Any] = {"title": "starting", "of": "rows", "done": 0, "total": 0, "failed": 0}
        self._facts |= {"running": 0, "state": RUNNING, "process": _this_process(), "notes": {}}
        self._lock = threading.Lock()
        self._written = -TELL_EVERY_S

    def put(self, **facts: Any) -> None:
        """Take note of facts; the file says so soon."""
        with self._lock:
            self._facts |= facts
        self.write(every_s=TELL_EVERY_S)

    def note(self, part: str, name: str, words: str, **numbers: float | int | str | None) -> None:
        """How far a part of the work has come, such as the best that a search has found: in words and in numbers.

        It costs no file: the next one that is written says so.
        """
        with self._lock:
            self._facts["notes"].setdefault(part, {})[name] = {"words": words, **numbers}
            self.latest = f"{name}: {words}"

    def write(self, *, every_s: float = 0.0) -> None:
        """Write the file, unless it was written less than ``every_s`` ago."""
        with self._lock:
            if time.monotonic() - self._written >= every_s:
                temporary = self.folder / f".{PROGRESS}.{os.getpid()}"
                temporary.write_text(json.dumps({**self._facts, "time": round(time.time(), 1)}) + "\n", "utf-8")
                os.replace(temporary, self.folder / PROGRESS)
                self._written = time.monotonic()

    def beat(self) -> None:
        """A sign of life while nothing is counted."""
        with suppress(OSError):  # if the disk is full, those who write results will say so
            self.write(every_s=BEAT_S / 2)


@contextmanager
def open_board(folder: Path) -> Iterator[Board]:
    """A board for as long as a command works; in the end it says how that ended."""
    board = Board(folder)
    board.write()
    state, words = FINISHED, ""
    try:
        with every(BEAT_S, board.beat, "sinew-board"):
            yield board
    except (KeyboardInterrupt, SystemExit, WalltimeReached) as error:
        state, words = INTERRUPTED, str(error) if isinstance(error, WalltimeReached) else ""
        raise
    except BaseException as error:
        state, words = FAILED, str(error) or type(error).__name__
        raise
    finally:
        with suppress(OSError):  # whatever ended the work has been told of already
            board.put(state=state, error=words[:2000], running=0, dashboard=None)
            board.write()


def _this_process() -> dict[str, Any]:
    return {"host": socket.gethostname(), "pid": os.getpid(), "since": round(psutil.Process().create_time(), 2)}


def is_here(process: Any) -> bool | None:
    """Whether the process that a board names is alive; None where that cannot be known: it is on another machine."""
    if not isinstance(process, dict) or process.get("host") != socket.gethostname():
        return None
    pid, since = process.get("pid"), process.get("since")
    if not isinstance(pid, int) or not isinstance(since, int | float) or not 0 < pid < 2**31:
        return None
    with suppress(psutil.Error):
        return abs(psutil.Process(pid).create_time() - since) < 2.0
    return False


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:,.3g} {task.fields['of']}/s" if task.speed else "")


class _Bars(Progress):
    """Bars, and below them what was noted last."""

    def __init__(self, board: Board, *columns: ProgressColumn, **options: Any) -> None:
        self.board = board
        super().__init__(*columns, **options)

    def get_renderables(self) -> Iterable[RenderableType]:
        yield from super().get_renderables()
        if self.board.latest:
            yield Text(f"  {self.board.latest}", style="dim", no_wrap=True, overflow="ellipsis")


@contextmanager
def progress(
    title: str, total: int, board: Board, *, of: str = "rows", done: int = 0, show: Show = "words"
) -> Iterator[Report]:
    """Show how ``total`` rows, or whatever is counted, come along: rate and time left. ``done`` are there from before.

    The board says the same to whoever asks from elsewhere.
    """
    started = time.monotonic()
    shown = started
    facts: dict[str, Any] = {"title": title, "of": of, "done": done, "total": total, "failed": 0, "running": 0}
    facts |= {"rows_per_s": 0.0, "eta_s": None}
    board.latest = ""
    board.put(**facts)

    def update(finished: int, failed: int, running: int) -> None:
        rate = (finished - done) / max(time.monotonic() - started, 1e-9)
        expected = max(total, finished)  # where nobody knows how many it takes, there may be more
        left = (expected - finished) / rate if rate > 0 else None
        facts.update(done=finished, total=expected, failed=failed, running=running, rows_per_s=round(rate, 3))
        facts["eta_s"] = None if left is None else round(left, 1)

    def note() -> None:
        log.info("progress", extra=facts)
        if show == "json":
            print(json.dumps({"event": "progress", **facts, "latest": board.latest}), flush=True)
        elif show == "words" and not bars_shown:
            left = facts["eta_s"]
            eta = "" if left is None or left < 1 else f", {left:,.0f} s left"
            line = f"{title}: {facts['done']:,} of {facts['total']:,} {of}, {facts['rows_per_s']:,.4g} {of}/s{eta}"
            print(f"{line}; {board.latest}" if board.latest else line, file=sys.stderr, flush=True)

    console = Console(stderr=True)
    bars_shown = show == "words" and console.is_terminal and not console.is_dumb_terminal
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        Remaining(),
        TextColumn("{task.fields[note]}"),
    )
    with _Bars(board, *columns, console=console, disable=not bars_shown) as bars:
        bar = bars.add_task(title, total=total, completed=done, note="", of=of)

        def report(finished: int, failed: int, running: int) -> None:
            nonlocal shown
            now = time.monotonic()
            update(finished, failed, running)
            bars.update(bar, total=facts["total"], completed=finished, note=f"[red]{failed} failed" if failed else "")
            board.put(**facts)
            if now - shown >= SHOW_EVERY_S:
                shown = now
                note()

        try:
            yield report
        finally:
            update(facts["done"], facts["failed"], 0)
            with suppress(OSError):  # whatever ended the work has been told of already
                board.put(**facts)
            note()


def read_progress(folder: Path) -> dict[str, Any] | None:
    """What was last told about a result folder, or None: what runs, rows done, failed and running, rate, seconds left.

    ``state`` (how the command ended, or that it runs), ``process``, ``tasks``, ``notes``, ``dashboard`` and ``cluster``
    are there if they were told. Files are from anywhere: what has another form is left out.
    """
    try:
        facts = json.loads((folder / PROGRESS).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    if not isinstance(facts, dict) or not _usable(facts):
        return None
    forms = {"state": str, "error": str, "of": str, "process": dict, "tasks": dict, "notes": dict, "dashboard": dict}
    return {n: fact for n, fact in facts.items() if fact is None or isinstance(fact, forms.get(n, object))}


def _usable(facts: dict[str, Any]) -> bool:
    """Whether the file says what a :class:`Board` writes: a title, and numbers that can be shown."""
    numbers = [facts.get(name) for name in ("done", "total", "time")]
    numbers += [facts.get(name, 0) for name in ("failed", "running", "rows_per_s")]
    numbers += [] if facts.get("eta_s") is None else [facts["eta_s"]]
    usable = all(isinstance(n, int | float) and -1e15 < n < 1e15 for n in numbers)
    return usable and isinstance(facts.get("title"), str)
