"""What a person sees while evaluations run: a bar on a terminal, a line now and then elsewhere."""

import logging
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn
from rich.progress import TimeRemainingColumn as Remaining
from rich.text import Text

log = logging.getLogger("sinew")


#: Called with the number of rows that are finished now, and how many of them failed.
Report = Callable[[int, int], None]


class _Rate(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:,.0f} rows/s" if task.speed else "")


@contextmanager
def progress(title: str, total: int, *, done: int = 0, quiet: bool = False, every_s: float = 10.0) -> Iterator[Report]:
    """Show how ``total`` rows come along, with rate and time left; ``done`` of them are there from before."""
    started = last = time.monotonic()
    state = (done, 0)

    def note(now: float) -> None:
        rate = (state[0] - done) / max(now - started, 1e-9)
        left = (total - state[0]) / rate if rate > 0 else None
        log.info(
            "progress",
            extra={
                "title": title,
                "done": state[0],
                "total": total,
                "failed": state[1],
                "rows_per_s": round(rate, 2),
                "eta_s": None if left is None else round(left, 1),
            },
        )
        if not quiet and not console.is_terminal:
            eta = "" if left is None or left < 1 else f", {left:,.0f} s left"
            print(f"{title}: {state[0]:,} of {total:,} rows, {rate:,.0f} rows/s{eta}", file=sys.stderr, flush=True)

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
        bar = bars.add_task(title, total=total, completed=done, note="")

        def report(finished: int, failed: int) -> None:
            nonlocal last, state
            state = (finished, failed)
            bars.update(bar, completed=finished, note=f"[red]{failed} failed" if failed else "")
            if time.monotonic() - last >= every_s:
                last = time.monotonic()
                note(last)

        yield report
        note(time.monotonic())
