"""Progress of a command: bars on a terminal, lines elsewhere, and the file ``progress.json`` for other processes."""

import json
import logging
import os
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import psutil
from rich.console import RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.text import Text

from sinew.runner.console import Console
from sinew.runner.errors import WalltimeReached
from sinew.runner.files import NotReadable, parse_json, read_regular, write_whole
from sinew.runner.periodic import every
from sinew.runner.printing import put

log = logging.getLogger("sinew")


LATEST_S = 1e11  # since 1970, of the start of a process
PROGRESS, MAX_BYTES = "progress.json", 2**24
TELL_EVERY_S, SHOW_EVERY_S, BEAT_S = 2.0, 10.0, 10.0
RUNNING, FINISHED, FAILED, INTERRUPTED = "running", "finished", "failed", "interrupted"

#: Called with the numbers of rows that are finished, that failed, and that workers have.
Report = Callable[[int, int, int], None]

#: For a person (bars on a terminal, lines elsewhere), for a program (JSON lines), or for nobody.
Show = Literal["words", "json", "nothing"]


class Board:
    """Writes ``folder/progress.json`` for a command, see :func:`read_progress`. Threads may share it.

    The file is replaced atomically, at most every few seconds. Use :func:`open_board`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.latest = ""  # the text of the latest note
        self._facts: dict[str, Any] = {"title": "starting", "of": "rows", "done": 0, "total": 0, "failed": 0}
        self._facts |= {"running": 0, "state": RUNNING, "process": _this_process(), "notes": {}}
        self._lock = threading.Lock()
        self._written = -TELL_EVERY_S

    def put(self, **facts: Any) -> None:
        """Set facts; they enter the file within seconds."""
        with self._lock:
            self._facts |= facts
        self.write(every_s=TELL_EVERY_S)

    def note(self, part: str, name: str, words: str, **numbers: float | int | str | None) -> None:
        """Set the progress of a part of the work, such as the best fit so far, as text and numbers.

        Nothing is written now; it enters the file the next time.
        """
        with self._lock:
            self._facts["notes"].setdefault(part, {})[name] = {"words": words, **numbers}
            self.latest = f"{name}: {words}"

    def write(self, *, every_s: float = 0.0) -> None:
        """Write the file, unless it was written less than ``every_s`` ago."""
        with self._lock:
            if time.monotonic() - self._written >= every_s:
                facts = json.dumps({**self._facts, "time": round(time.time(), 1)})
                write_whole(self.folder / PROGRESS, facts.encode() + b"\n")
                self._written = time.monotonic()

    def beat(self) -> None:
        """Write the file as a sign of life while nothing is counted."""
        with suppress(OSError):  # if the disk is full, writing results reports it
            self.write(every_s=BEAT_S / 2)


@contextmanager
def open_board(folder: Path) -> Iterator[Board]:
    """A board for the time of a command; at the end, it writes how the command ended."""
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
        with suppress(OSError):  # the error that ended the work is raised already
            board.put(state=state, error=words[:2000], running=0, dashboard=None)
            board.write()


def _this_process() -> dict[str, Any]:
    return {"host": socket.gethostname(), "pid": os.getpid(), "since": round(psutil.Process().create_time(), 2)}


def is_here(process: Any) -> bool | None:
    """Whether the process that a board names is alive; None if it is on another machine."""
    if not isinstance(process, dict) or process.get("host") != socket.gethostname():
        return None
    pid, since = process.get("pid"), process.get("since")
    if not isinstance(pid, int) or not isinstance(since, int | float):
        return None
    if not (0 < pid < 2**31 and 0 <= since < LATEST_S):
        return None
    with suppress(psutil.Error):
        return abs(psutil.Process(pid).create_time() - since) < 2.0
    return False


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:,.3g} {task.fields['of']}/s" if task.speed else "")


class _Bars(Progress):
    """Bars, and the latest note below them."""

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
    """Show the progress of ``total`` rows, or of other things, with rate and time left; ``done`` were finished before.

    The board gets the same facts.
    """
    shown = started = time.monotonic()
    facts: dict[str, Any] = {"title": title, "of": of, "done": done, "total": total, "failed": 0, "running": 0}
    facts |= {"rows_per_s": 0.0, "eta_s": None}
    board.latest = ""
    board.put(**facts)

    def update(finished: int, failed: int, running: int) -> None:
        rate = (finished - done) / max(time.monotonic() - started, 1e-9)
        expected = max(total, finished)  # where the total is a guess, there may be more
        left = (expected - finished) / rate if rate > 0 else None
        facts.update(done=finished, total=expected, failed=failed, running=running, rows_per_s=round(rate, 3))
        facts["eta_s"] = None if left is None else round(left, 1)

    def note() -> None:
        log.info("progress", extra=facts)
        if show == "json":
            put(json.dumps({"event": "progress", **facts, "latest": board.latest}))
        elif show == "words" and not bars_shown:
            left = facts["eta_s"]
            eta = "" if left is None or left < 1 else f", {left:,.0f} s left"
            line = f"{title}: {facts['done']:,} of {facts['total']:,} {of}, {facts['rows_per_s']:,.4g} {of}/s{eta}"
            put(f"{line}; {board.latest}" if board.latest else line, error=True)

    console = Console(stderr=True)
    bars_shown = show == "words" and console.is_terminal and not console.is_dumb_terminal
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        _Rate(),
        Remaining(),
        TextColumn("{task.fields[note]}", style="red", markup=False),
    )
    with _Bars(board, *columns, console=console, disable=not bars_shown) as bars:
        bar = bars.add_task(title, total=total, completed=done, note="", of=of)

        def report(finished: int, failed: int, running: int) -> None:
            nonlocal shown
            now = time.monotonic()
            update(finished, failed, running)
            bars.update(bar, total=facts["total"], completed=finished, note=f"{failed} failed" if failed else "")
            board.put(**facts)
            if now - shown >= SHOW_EVERY_S:
                shown = now
                note()

        try:
            yield report
        finally:
            update(facts["done"], facts["failed"], 0)
            with suppress(OSError):  # the error that ended the work is raised already
                board.put(**facts)
            note()


def read_progress(folder: Path) -> dict[str, Any] | None:
    """The progress of a result folder, or None: what runs, rows done, failed and running, rate, seconds left.

    ``state`` (how the command ended, or that it runs), ``process``, ``tasks``, ``notes``, ``dashboard`` and ``cluster``
    are there if they were written. Files may come from anywhere: values of another form are left out.
    """
    try:
        facts = parse_json(read_regular(folder / PROGRESS, MAX_BYTES))
    except (OSError, NotReadable, ValueError, RecursionError):
        return None
    if not isinstance(facts, dict) or not _usable(facts):
        return None
    forms = {"state": str, "error": str, "of": str, "process": dict, "tasks": dict, "notes": dict, "dashboard": dict,
             "task": str}  # fmt: skip
    return {n: fact for n, fact in facts.items() if fact is None or isinstance(fact, forms.get(n, object))}


def _usable(facts: dict[str, Any]) -> bool:
    """Whether the facts are those of a :class:`Board`: a title, and numbers that can be shown."""
    counts = [facts.get("done"), facts.get("total"), facts.get("failed", 0), facts.get("running", 0)]
    numbers = [*counts, facts.get("time"), facts.get("rows_per_s", 0)]
    numbers += [] if facts.get("eta_s") is None else [facts["eta_s"]]
    usable = all(isinstance(n, int | float) and -1e15 < n < 1e15 for n in numbers) and all(n >= 0 for n in counts)
    return usable and isinstance(facts.get("title"), str)
