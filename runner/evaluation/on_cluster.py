"""A run on a Dask cluster: a bounded number of batches on the workers, and what to do when workers die."""

import functools
import math
import queue
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any

import dask
from distributed import CancelledError, Client, KilledWorker, as_completed
from distributed.comm.core import CommClosedError

from sinew.runner.cluster import drain
from sinew.runner.cluster.client import ask_for, wait_for_workers
from sinew.runner.cluster.keeper import Growing
from sinew.runner.errors import ClusterError
from sinew.runner.evaluation.adaptive import Message, RunClosed
from sinew.runner.evaluation.batch import Batch, Carrier, run_in_time
from sinew.runner.evaluation.run import STOPPING_S, Run, store_error
from sinew.runner.evaluation.source import Source
from sinew.runner.store.segment import is_whole

RECOUNT_S = 2.0
ASK_AGAIN_S = 1.0
LOST = (OSError, ValueError)  # a message to a dying process; a TLS handshake raises the second
IN_A_MESSAGE = 64  # batches: a few megabytes of parameters at most
TRIES_APART = 3
CLUSTER_LOST = "the cluster was lost; run the same command again, finished rows are kept"

Batches = list[tuple[Source, Batch]]


class WorkOnCluster:
    """The batches and computations of a run that workers have.

    ``running``, ``computing``: futures and what they stand for; ``ending``: the walltime is near, nothing new starts.
    """

    def __init__(self, run: Run, client: Client) -> None:
        self.run, self.client = run, client
        self.sessions = run.sessions
        self.carrier = Carrier(run.name, {source.key: source.evaluation for source in run.sources})
        self.running: dict[Any, tuple[Source, Batch]] = {}
        self.computing: dict[Any, Message] = {}
        self.given_up: list[Batch] = []
        self.too_short: queue.SimpleQueue[Mapping[str, float]] = queue.SimpleQueue()
        self.slots, self.counted = 1, -math.inf
        self.ending = False

    def work(self) -> None:
        """Evaluate all rows. Raises ``StoreError``, ``ClusterError`` and ``WalltimeReached``."""
        self._meet_workers()
        self.completed = as_completed(loop=self.client.loop)
        self.sessions.bell = self.completed.thread_condition  # notified of finished futures and of messages
        stopped = True  # by a signal, by the alarm of the walltime, or by its end
        try:
            while self._busy or ((self.run.left or self.sessions.open) and not self.ending):
                self.sessions.listen(self._compute)
                self._submit(self._new_batches())
                self.run.commit_many()  # while workers are busy
                self._wait()
                self._collect_ready()
            stopped = self.ending
        except Exception:
            stopped = False
            raise
        finally:
            self._clean_up(stopped=stopped)
        if self.ending:
            raise self.run.walltime_reached()
        ask_for(self.client, 0)
        self.run.commit()
        self._raise_for_given_up()

    @property
    def _busy(self) -> int:
        """The number of batches and computations that workers have."""
        return len(self.running) + len(self.computing)

    @property
    def _rows_running(self) -> int:
        return sum(batch.rows.size for _, batch in self.running.values())

    def _meet_workers(self) -> None:
        """Wait for the first worker and bring the evaluations to all workers."""
        self.run.had_workers = False  # jobs may wait in the queue for longer than this process may
        ask_for(self.client, self._wanted(0))
        wait_for_workers(self.client, functools.partial(self._check, 0))
        self.run.had_workers, self.run.began = True, time.monotonic()
        register(self.client, drain.Leave())
        register(self.client, self.carrier)
        self.client.subscribe_topic(drain.TOO_SHORT, lambda event: self.too_short.put(event[1]))

    def _new_batches(self) -> Batches:
        """Batches for workers that have too few of them."""
        if time.monotonic() - self.counted > RECOUNT_S:  # workers come and go
            self.slots, self.counted = max(1, sum(self.client.nthreads().values())), time.monotonic()
        batches: Batches = []
        under_way = self._rows_running if self.sessions else 0
        while not self.ending and len(self.running) + len(batches) < self.slots * self.run.ahead() and self.run.left:
            source, batch = self.run.next_batch(self.slots, under_way)
            if not self.run.in_time(batch):
                self.ending = True
                break
            batches.append((source, batch))
            under_way += batch.rows.size
        return batches

    def _submit(self, batches: Batches) -> None:
        """Send batches, many in one message: most of its cost does not depend on their number."""
        for first in range(0, len(batches), IN_A_MESSAGE):
            group = batches[first : first + IN_A_MESSAGE]
            futures = self.client.map(run_in_time, [batch for _, batch in group], pure=False)
            self.running.update(zip(futures, group, strict=True))
            self.completed.update(futures)

    def _compute(self, message: Message) -> None:
        """Send a computation; an adaptive run waits for it, so it goes first."""
        assert message.computation is not None
        function, arguments = message.computation
        future = self.client.submit(function, *arguments, pure=False, priority=1)
        self.computing[future] = message
        self.completed.add(future)

    def _wait(self) -> None:
        """Wait until a future is finished or a session has sent a message."""
        while not self.completed.has_ready() and (self._busy or (self.sessions.open and not self.ending)):
            if not self.sessions.inbox.empty() and not self.ending:
                return
            self.run.counts.running = self._rows_running
            self.run.counts.show()
            self._check(self._busy)
            with self.completed.thread_condition:
                if self.sessions.inbox.empty() or self.ending:
                    self.completed.thread_condition.wait(0.2)

    def _collect_ready(self) -> None:
        while self.completed.has_ready():
            future = next(self.completed)
            if future in self.running:
                self._submit(self._collect(future, *self.running.pop(future)))
            else:
                self._collect_computation(future, self.computing.pop(future))
            future.release()

    def _collect_computation(self, future: Any, message: Message) -> None:
        """Hand a computation's result to its session, or try again when every worker that took it was killed."""
        try:
            _hand_back(future, message)
        except KilledWorker:
            if message.tries >= TRIES_APART:
                assert message.answer is not None
                message.answer.put(RunClosed())  # its thread waits
                raise ClusterError(
                    "a computation has no result: every worker that took it was killed; do workers have enough "
                    "memory? Run again to try once more, all rows are kept"
                ) from None
            self._compute(replace(message, tries=message.tries + 1))

    def _collect(self, future: Any, source: Source, batch: Batch) -> Batches:
        """Take in a finished batch; returns the batches to try again because workers died with it, or from it."""
        try:
            if future.status != "finished":  # asking a worker for an empty result would cost more than all the rest
                future.result()
            self.run.note(source, batch)
        except KilledWorker:
            return self._killed(source, batch)
        except (CancelledError, CommClosedError) as error:
            raise ClusterError(CLUSTER_LOST) from error
        except OSError as error:
            raise store_error(error, batch) from error
        return []

    def _killed(self, source: Source, batch: Batch) -> Batches:
        """Every worker that took this batch died: try its rows apart, and give up after ``TRIES_APART`` times."""
        if is_whole(batch.segment):
            self.run.note(source, batch)
            return []
        if batch.apart < TRIES_APART:
            apart = batch.rows_apart()
            for row in apart:
                row.expected_s = 0.0 if row.restarts else source.sizes.expected_s(1)
            return [(source, row) for row in apart]
        if source.open:
            raise ClusterError(
                f"row {batch.rows[0]} has no outcome: every worker that took it was killed, though the row did not "
                "kill its own process; do workers have enough memory? Run again, all other rows are kept"
            ) from None
        self.given_up.append(batch)
        return []

    def _raise_for_given_up(self) -> None:
        if self.given_up:
            rows = ", ".join(str(batch.rows[0]) for batch in self.given_up[:5])
            raise ClusterError(
                f"{len(self.given_up)} rows have no outcome (row {rows}{', ...' if len(self.given_up) > 5 else ''}): "
                "every worker that took one was killed, though the row did not kill its own process; do workers have "
                "enough memory? Run again to try once more, all other rows are kept"
            )

    def _wanted(self, running: int) -> int:
        """How many workers would have something to do."""
        return max(math.ceil(self.run.left / self.run.policy.multiple) + running, self.sessions.open)

    def _check(self, running: int) -> None:
        """Raise the error that makes further waiting useless, if there is one."""
        ask_for(self.client, self._wanted(running))
        if drain.seconds_left() < STOPPING_S:
            raise self.run.walltime_reached()
        with suppress(queue.Empty):
            short = self.too_short.get_nowait()
            raise ClusterError(
                f"the workers' walltime of {short['walltime_s']:.0f} s is too short: one evaluation takes at least "
                f"{short['needed_s'] / self.run.policy.multiple:.0f} s; ask for more time, finished rows are kept"
            )

    def _clean_up(self, *, stopped: bool) -> None:
        """Leave nothing on the cluster that works on. ``stopped``: the process ends, and may be killed if it waits."""
        for message in self.computing.values():
            assert message.answer is not None
            message.answer.put(RunClosed())
        with suppress(ClusterError):  # the error that is on its way says more
            ask_for(self.client, 0)  # jobs that end now are not replaced
        if stopped and isinstance(self.client.cluster, Growing):
            return  # the worker jobs end with this process: to ask each of them would wait for those that are dying
        # the cluster itself may be gone; the key error is of a worker that is closing, which drops its plugins itself
        with suppress(*LOST, CancelledError, KeyError):
            self.client.cancel([*self.running, *self.computing])
            self.client.unsubscribe_topic(drain.TOO_SHORT)
            with dask.config.set({"distributed.comm.timeouts.connect": "5 s"}):  # a worker may have just died
                self.client.unregister_worker_plugin(self.carrier.name)


def _hand_back(future: Any, message: Message) -> None:
    """Give the result of a computation to the session that waits for it."""
    assert message.answer is not None
    try:
        message.answer.put(future.result())
    except (CancelledError, CommClosedError) as error:
        message.answer.put(RunClosed())  # otherwise its thread would wait, and the run for its thread
        raise ClusterError(CLUSTER_LOST) from error
    except KilledWorker:  # this says nothing about the computation
        raise
    except Exception as error:  # noqa: BLE001 - the session that asked for it raises it
        message.answer.put(error)


def register(client: Client, plugin: Any) -> None:
    """Register a plugin on all workers; tries again when a worker dies meanwhile. Raises ``ClusterError``."""
    for attempt in range(5):
        try:
            client.register_plugin(plugin, name=plugin.name)
            return
        except LOST as error:
            if attempt == 4:
                words = f"the cluster's workers do not answer ({error}); run the same command again"
                raise ClusterError(words) from error
            time.sleep(ASK_AGAIN_S)
