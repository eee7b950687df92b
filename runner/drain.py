"""Leave before the walltime: start nothing that cannot finish, finish what runs, hand back the rest.

A worker knows its deadline from its job (``SINEW_DEADLINE``, seconds since 1970). A batch that would not end before it,
by the run times measured so far, is handed back to the scheduler untouched. The worker then takes no more, waits until
nothing executes, and closes in the way in which the scheduler moves everything else to other workers. Dask's own
``--lifetime`` does neither: it runs again elsewhere what still runs here.
"""

import asyncio
import math
import os
import time
from typing import Any

from distributed import Reschedule, WorkerPlugin, get_worker
from distributed.core import Status

DEADLINE, WALLTIME = "SINEW_DEADLINE", "SINEW_WALLTIME"
CLOSING_S = 4.0
SAFETY = 1.25  # of the longest run time seen, when a batch must end before a deadline
CHECK_S = 0.5
TOO_SHORT = "sinew-walltime-too-short"


def job_script_lines(walltime_s: float) -> tuple[str, ...]:
    """The first lines of a job script: they tell what runs in the job when it must have ended.

    A shell that dies of SIGTERM would leave its children behind, so it lets them end first.
    """
    seconds = f"{walltime_s:.0f}"
    return ("trap : TERM", f"export {WALLTIME}={seconds}", f"export {DEADLINE}=$(( $(date +%s) + {seconds} ))")


def seconds_left() -> float:
    """Seconds until this process's job must have ended; infinite when nothing ends it."""
    return _from_environment(DEADLINE) - time.time()


def walltime_s() -> float:
    """What this process's job was given in all (s)."""
    return _from_environment(WALLTIME)


def _from_environment(name: str) -> float:
    try:
        return float(os.environ[name])
    except (KeyError, ValueError):
        return math.inf


class Leave(WorkerPlugin):
    """On each worker: leave when the deadline comes near."""

    name = "sinew-drain"

    def __init__(self) -> None:
        self.leaving = False
        self.began = math.inf
        self.first = math.inf

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
        """Take nothing more, let finish what runs, close. Comes back at once; the closing goes on by itself."""
        if self.leaving:
            return
        self.leaving = True
        if self.worker.status == Status.running:
            self.worker.status = Status.paused
        self.closing = asyncio.ensure_future(self._close())

    async def _close(self) -> None:
        while self.worker.state.executing_count and seconds_left() > CLOSING_S / 2:
            await asyncio.sleep(0.05)
        if self.worker.state.executing_count:  # it took longer than the run times measured before
            self.tell_if_too_short(time.time() - self.began)
            await asyncio.sleep(0.2)
        if self.worker.status == Status.paused:  # else it is closing anyway
            await self.worker.close_gracefully(reason="the walltime")

    def tell_if_too_short(self, needed_s: float) -> None:
        """Tell the client if a batch that needs at least ``needed_s`` would not end in any job of this walltime."""
        given_s = walltime_s()
        start_s = self.first - (time.time() + seconds_left() - given_s)  # a job also has to start its workers
        start_s = max(start_s, min(60.0, 0.2 * given_s))
        if start_s + needed_s + CLOSING_S > given_s:
            self.worker.log_event(TOO_SHORT, {"needed_s": needed_s, "walltime_s": given_s})


def enter(expected_s: float) -> None:
    """On a worker, before a batch: hand it back unless it can end in time. Raises ``distributed.Reschedule``.

    ``expected_s``: how long the batch is expected to take (s).
    """
    if math.isinf(seconds_left()):
        return
    worker: Any = get_worker()
    plugin: Any = worker.plugins[Leave.name]
    plugin.began = time.time()
    plugin.first = min(plugin.first, plugin.began)
    if seconds_left() >= expected_s + CLOSING_S:
        return
    plugin.tell_if_too_short(expected_s)
    asyncio.run_coroutine_threadsafe(plugin.leave(), worker.loop.asyncio_loop).result(10)
    raise Reschedule
