"""A stand-in for a Dask client: its batches are done at once, in this process, or end as a test says."""

import threading
from collections import deque
from typing import Any

import dask
from distributed import KilledWorker

from sinew.runner.cluster.keeper import Growing
from sinew.runner.evaluation.batch import run_in_time


class Future:
    """What became of a call."""

    def __init__(self, value: Any = None, error: BaseException | None = None) -> None:
        self.value, self.error, self.released = value, error, False
        self.status = "finished" if error is None else "error"

    def result(self) -> Any:
        if self.error is not None:
            raise self.error
        return self.value

    def release(self) -> None:
        self.released = True


class Completed:
    """Futures in the order in which they were sent; all of them are ready."""

    def __init__(self, loop: object = None) -> None:
        self.ready: deque[Future] = deque()
        self.thread_condition = threading.Condition()

    def add(self, future: Future) -> None:
        self.ready.append(future)

    def update(self, futures: list[Future]) -> None:
        self.ready.extend(futures)

    def has_ready(self) -> bool:
        return bool(self.ready)

    def __next__(self) -> Future:
        return self.ready.popleft()


class Cluster(Growing):
    """A cluster that notes how many workers are wanted."""

    def __init__(self) -> None:
        self.wanted: list[int] = []
        self.failure = None

    @property
    def wanted_slots(self) -> int:
        return self.wanted[-1]

    @wanted_slots.setter
    def wanted_slots(self, slots: int) -> None:
        self.wanted.append(slots)


class StandIn:
    """The part of a client that a run uses.

    ``kills``: how often the workers that take a row die, by its number; ``dying``: errors that batches end with;
    ``meeting``: errors at the first plugins. What was asked of it is noted.
    """

    loop = None
    patience: str | None = None

    def __init__(self, slots: int = 2) -> None:
        self.slots = slots
        self.cluster = Cluster()
        self.kills: dict[int, int] = {}
        self.dying: list[BaseException] = []
        self.meeting: list[BaseException] = []
        self.plugins: dict[str, Any] = {}
        self.messages: list[list[list[int]]] = []
        self.apart: list[tuple[int, int, float]] = []
        self.priorities: list[int] = []
        self.cancelled: list[Future] = []
        self.topics: dict[str, Any] = {}
        self.futures: list[Future] = []

    def wait_for_workers(self, n_workers: int, timeout: float) -> None:
        """They are there."""

    def register_plugin(self, plugin: Any, name: str) -> None:
        if self.meeting:
            raise self.meeting.pop(0)
        self.plugins[name] = plugin
        if hasattr(plugin, "carried"):
            plugin.setup(None)

    def unregister_worker_plugin(self, name: str) -> None:
        self.patience = dask.config.get("distributed.comm.timeouts.connect")
        self.plugins.pop(name).teardown(None)

    def subscribe_topic(self, topic: str, handler: Any) -> None:
        self.topics[topic] = handler

    def unsubscribe_topic(self, topic: str) -> None:
        del self.topics[topic]

    def nthreads(self) -> dict[str, int]:
        return {"one": self.slots - 1, "two": 1} if self.slots else {}

    def cancel(self, futures: list[Future]) -> None:
        self.cancelled += futures

    def map(self, function: Any, batches: list[Any], *, pure: bool) -> list[Future]:
        assert function is run_in_time
        assert pure is False
        self.messages.append([batch.rows.tolist() for batch in batches])
        return [self._sent(batch) for batch in batches]

    def _sent(self, batch: Any) -> Future:
        if batch.apart:
            self.apart.append((int(batch.rows[0]), batch.apart, batch.expected_s))
        deadly = [row for row in batch.rows.tolist() if self.kills.get(row, 0) > 0]
        if deadly or self.dying:
            for row in deadly:
                self.kills[row] -= 1
            future = Future(error=self.dying.pop(0) if self.dying else KilledWorker("task", None, 3))
        else:
            batch.apart = 0  # no other process is needed here
            run_in_time(batch)
            future = Future()
        self.futures.append(future)
        return future

    def submit(self, function: Any, *arguments: Any, pure: bool, priority: int) -> Future:
        assert pure is False
        self.priorities.append(priority)
        try:
            future = Future(function(*arguments))
        except Exception as error:  # as a worker does
            future = Future(error=error)
        self.futures.append(future)
        return future
