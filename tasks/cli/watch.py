"""A live view of a result folder: a picture that is drawn anew, or lines."""

import json
import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from rich.console import Group
from rich.live import Live
from rich.text import Text

from sinew.runner.console import Console
from sinew.runner.errors import BadInput
from sinew.runner.printing import put
from sinew.runner.progress import FAILED, FINISHED, INTERRUPTED
from sinew.tasks.cli.watch_screen import line, picture
from sinew.tasks.cli.watch_state import Rows, look

LINE_EVERY_S = 10.0
OVER = (FINISHED, FAILED, INTERRUPTED)


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
            put(json.dumps(found))
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
            put(json.dumps(found) if form == "json" else line(found))
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
