"""Workers leave before their walltime: they finish what runs, and start nothing that cannot finish.

A worker reads its deadline from its job's environment (``SINEW_DEADLINE``, seconds since 1970). A batch that would not
end before the deadline, by the run times measured so far, goes back to the scheduler. The worker then takes no more
batches, waits until nothing executes, and closes gracefully, so that the scheduler moves its other batches to other
workers. Dask's own ``--lifetime`` does not wait: it runs again elsewhere what still runs here.
"""

import asyncio
import math
import os
import time
from collections.abc import Callable
from typing import Any

from distributed import Reschedule, WorkerPlugin, get_worker
from distributed.core import Status

DEADLINE, WALLTIME = "SINEW_DEADLINE", "SINEW_WALLTIME"
CLOSING_S = 4.0
SAFETY = 1.25  # of the longest run time seen, when a batch must end before a deadline
CHECK_S = 0.5
TOO_SHORT = "sinew-walltime-too-short"


def job_script_lines(walltime_s: float) -> tuple[str, ...]:
    """The first lines of a job script: they export the job's walltime and deadline.

    A shell that dies of SIGTERM would leave its children behind, so it ignores the signal and lets them end first.
    """
    seconds = f"{walltime_s:.0f}"
    return ("trap : TERM", f"export {WALLTIME}={seconds}", f"export {DEADLINE}=$(( $(date +%s) + {seconds} ))")


def seconds_left() -> float:
    """Seconds until the deadline of this process's job; infinite without a deadline."""
    return _from_environment(DEADLINE) - time.time()


def walltime_s() -> float:
    """The walltime of this process's job (s); infinite outside of one."""
    return _from_environment(WALLTIME)


def _from_environment(name: str) -> float:
    try:
        return float(os.environ[name])
    except (KeyError, ValueError):
        return math.inf


class Leave(WorkerPlugin):
    """A plugin of each worker: leave when the deadline is near."""

    name = "sinew-drain"

    def __init__(self) -> None:
        self.leaving = False
        self.began = math.inf
        self.first = math.inf
        self.kept: Callable[[], int] | None = None
        self.kept_before = 0

    def setup(self, worker: Any) -> None:
        self.worker = worker
        if math.isfinite(seconds_left()):
            self.watch = asyncio.ensure_future(self._watch())

    def teardown(self, worker: Any) -> None:
        if not self.leaving and hasattr(self, "watch"):
            self.watch.cancel()

    async def _watch(self) -> None:
        while not self.leaving and seconds_left() > CLOSING_S:
            await asyncio.sleep(CHECK_S)
        await self.leave()

    async def leave(self) -> None:
        """Take no more batches, finish what runs, and close. Returns at once; a task does the rest."""
        if self.leaving:
            return
        self.leaving = True
        if self.worker.status == Status.running:
            self.worker.status = Status.paused
        self.closing = asyncio.ensure_future(self._close())

    async def _close(self) -> None:
        while self.worker.state.executing_count and seconds_left() > CLOSING_S / 2:
            await asyncio.sleep(0.05)
        if self.worker.state.executing_count:  # longer than all run times measured before
            self.tell_if_too_short(time.time() - self.began)
            await asyncio.sleep(0.2)
        if self.worker.status == Status.paused:  # otherwise it is closing already
            await self.worker.close_gracefully(reason="the walltime")

    def tell_if_too_short(self, needed_s: float) -> None:
        """Tell the client if a batch of at least ``needed_s`` seconds cannot end in any job of this walltime.

        One that goes on where it was interrupted ends in a later job, if it has kept a state in this one.
        """
        if self.kept is not None and self.kept() > self.kept_before:
            return
        given_s = walltime_s()
        start_s = self.first - (time.time() + seconds_left() - given_s)  # a job also starts its workers
        start_s = max(start_s, min(60.0, 0.2 * given_s))
        if start_s + needed_s + CLOSING_S > given_s:
            self.worker.log_event(TOO_SHORT, {"needed_s": needed_s, "walltime_s": given_s})


def enter(expected_s: float, *, kept: Callable[[], int] | None = None) -> None:
    """Called on a worker before a batch: raise ``distributed.Reschedule`` if it cannot end in time.

    ``expected_s``: how long the batch is expected to take (s). ``kept``: how many states this process has kept, if the
    batch goes on where it was interrupted.
    """
    if math.isinf(seconds_left()):
        return
    worker: Any = get_worker()
    plugin: Any = worker.plugins[Leave.name]
    plugin.began = time.time()
    plugin.kept, plugin.kept_before = kept, kept() if kept is not None else 0
    plugin.first = min(plugin.first, plugin.began)
    if seconds_left() >= expected_s + CLOSING_S:
        return
    plugin.tell_if_too_short(expected_s)
    asyncio.run_coroutine_threadsafe(plugin.leave(), worker.loop.asyncio_loop).result(10)
    raise Reschedule
