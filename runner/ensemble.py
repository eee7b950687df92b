"""Evaluate many rows of parameters: bounded window, batches, retries, failures as data, commits."""

import errno
import functools
import hashlib
import math
import os
import queue
import secrets
import socket
import statistics
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import dask
import numpy as np
from distributed import CancelledError, Client, KilledWorker, WorkerPlugin, as_completed
from distributed.comm.core import CommClosedError

from runner import drain, external, isolation, slurm
from runner.cluster import ask_for, wait_for_workers
from runner.errors import ClusterError, StoreError, WalltimeReached
from runner.progress import Report
from runner.store import STATUSES, Array, Segment, Table, is_whole

RECOUNT_S = 2.0
RETRIED = ("crashed", "out_of_memory", "bad_output")
BATCHES_PER_S = 125  # what a scheduler does with a fifth of its time
ONE_AHEAD_S = 1.0  # a worker gets its next batch early, unless batches take longer than this
STOPPING_S = 10.0  # to close the cluster in, before the deadline of the process that leads it
TRIES_APART = 3
STOPPED_SOLVERS = 5


@dataclass(frozen=True)
class Outcome:
    """What became of ``n`` rows: ``values[field]`` is ``[n, ...]`` float64 (NaN where a row failed).

    ``status`` ``[n]`` holds positions in :data:`runner.store.STATUSES`; ``messages`` has ``n`` texts, or none when no
    row failed.
    """

    values: Mapping[str, Array]
    status: Array
    messages: tuple[str, ...] = ()


class Evaluation(Protocol):
    """Something that can be pickled, sent to every worker, and asked for the outcome of rows of parameters."""

    def __call__(self, parameters: Array) -> Outcome:
        """The outcome of ``parameters`` ``[n, d]``. It must not depend on which rows are asked for together."""
        ...


@dataclass(frozen=True)
class Policy:
    """How rows are cut into batches and what happens to those that fail.

    ``batch_s``: aimed-at duration of a batch; ``multiple``: batches hold a multiple of this many rows;
    ``retries``: how often a row with a status in :data:`RETRIED` is tried again.
    """

    batch_s: float = 0.5
    multiple: int = 1
    retries: int = 1
    batches_per_worker: int = 2


def evaluate(
    client: Callable[[], Client | None],
    table: Table,
    evaluation: Evaluation,
    rows: Array,
    report: Report | None = None,
    policy: Policy = Policy(),
) -> None:
    """Make sure that ``rows`` ``[n]``, as :meth:`runner.store.Table.plan` numbers them, have committed outcomes.

    Known rows cost a look-up: ``client`` is called only when something is left to do; when it gives None, the work is
    done in this process. Interrupt it, kill it or its workers: what was committed stays, and the same call goes on
    from there. Raises ``StoreError`` when results cannot be written, ``ClusterError`` when the cluster is lost, and
    ``WalltimeReached`` when this process's own job must end; then, too, what is finished is committed.
    """
    table.fold(table.segments())
    asked = np.unique(rows)
    total, failed = int(asked.size), int((table.status[asked] > 0).sum())
    pending = table.pending(asked)
    del asked
    if pending.size:
        table.journal.mkdir(parents=True, exist_ok=True)
        _Run(client(), table, evaluation, pending, total, report, policy, failed).work()
        if (left := table.pending(rows).size) > 0:
            raise StoreError(f"{table.journal}: {left} rows have no outcome although their batches ended; run again")


class _Batch:
    """What a worker needs to evaluate some rows; small, because the evaluation itself waits on the workers."""

    def __init__(self, key: str, rows: Array, parameters: Array, journal: Path, retries: int, apart: int = 0) -> None:
        self.key = key
        self.rows = rows
        self.parameters = parameters
        self.retries = retries
        self.apart = apart  # how often it has been tried in a process of its own
        self.expected_s = 0.0
        content = hashlib.blake2b(rows.tobytes(), digest_size=6).hexdigest()
        self.segment = journal / f"rows-{rows[0]:09d}-{content}-{rows.size:05d}.safetensors"

    def rows_apart(self) -> "list[_Batch]":
        """Each row as a batch that is evaluated in a process of its own."""
        journal = self.segment.parent
        return [
            _Batch(self.key, self.rows[i : i + 1], self.parameters[i : i + 1], journal, self.retries, self.apart + 1)
            for i in range(self.rows.size)
        ]


@dataclass
class _Run:
    """One call of :func:`evaluate` while it lasts."""

    client: Client | None
    table: Table
    evaluation: Evaluation
    pending: Array
    total: int
    report: Report | None
    policy: Policy
    already_failed: int
    next: int = 0
    done: int = 0
    failed: int = 0
    largest: int = 0
    rows_running: int = 0
    had_workers: bool = True
    came: float = field(default_factory=time.monotonic)
    given_up: list[_Batch] = field(default_factory=list)
    seconds_per_row: deque[float] = field(default_factory=lambda: deque(maxlen=9))
    slowest: deque[float] = field(default_factory=lambda: deque(maxlen=200))
    too_short: "queue.SimpleQueue[Mapping[str, float]]" = field(default_factory=queue.SimpleQueue)
    left_in_chunk: dict[int, int] = field(default_factory=dict)
    finished: dict[int, list[Path]] = field(default_factory=dict)

    def work(self) -> None:
        chunks, counts = np.unique(self.pending // self.table.chunk_rows, return_counts=True)
        self.left_in_chunk = dict(zip(chunks.tolist(), counts.tolist(), strict=True))
        self.largest = self.policy.multiple
        if self.client is None:
            self._work_here()
        else:
            self._work_on(self.client)

    def _work_here(self) -> None:
        _evaluations[self.table.key] = self.evaluation
        try:
            while self.next < self.pending.size:
                batch = self._next_batch(1, self.table.key)
                if not self._in_time(batch):
                    raise self._walltime()
                try:
                    self._note(batch, _run_batch(batch))
                except OSError as error:
                    raise _named(error, batch) from error
        finally:
            del _evaluations[self.table.key]

    def _work_on(self, client: Client) -> None:
        key = f"{self.table.key}-{secrets.token_hex(4)}"  # another run of this study may share the scheduler
        plugin = _Carrier(key, self.evaluation)
        ask_for(client, self.pending.size // self.policy.multiple)
        self.had_workers = False  # their jobs may wait in the queue for longer than this process may
        wait_for_workers(client, functools.partial(self._check, client))
        self.had_workers, self.came = True, time.monotonic()
        _register(client, drain.Leave())
        _register(client, plugin)
        client.subscribe_topic(drain.TOO_SHORT, lambda event: self.too_short.put(event[1]))
        running: dict[Any, _Batch] = {}
        completed = as_completed(loop=client.loop)

        def submit(batch: _Batch) -> None:
            future = client.submit(_run_in_time, batch, pure=False)
            running[future] = batch
            completed.add(future)

        slots, counted = 1, -math.inf
        ending = False
        try:
            while running or (self.next < self.pending.size and not ending):
                if time.monotonic() - counted > RECOUNT_S:  # workers come and go
                    slots, counted = max(1, sum(client.nthreads().values())), time.monotonic()
                while not ending and len(running) < self._window(slots) and self.next < self.pending.size:
                    batch = self._next_batch(slots, key)
                    if ending := not self._in_time(batch):
                        break
                    submit(batch)
                while running and not completed.has_ready():
                    self.rows_running = sum(batch.rows.size for batch in running.values())
                    self._tell()
                    self._check(client, len(running))
                    with completed.thread_condition:
                        completed.thread_condition.wait(0.2)
                if running:
                    future = next(completed)
                    self._collect(future, running.pop(future), submit)
                    future.release()
        finally:
            with suppress(OSError, ValueError, CommClosedError, CancelledError):  # the cluster itself may be gone
                client.cancel(list(running))
                client.unsubscribe_topic(drain.TOO_SHORT)
                with dask.config.set({"distributed.comm.timeouts.connect": "5 s"}):  # a worker may have just died
                    client.unregister_worker_plugin(plugin.name)
        if ending:
            raise self._walltime()
        ask_for(client, 0)
        if self.given_up:
            rows = ", ".join(str(batch.rows[0]) for batch in self.given_up[:5])
            raise ClusterError(
                f"{len(self.given_up)} rows have no outcome (row {rows}{', ...' if len(self.given_up) > 5 else ''}): "
                "every worker that took one was killed, though the row did not kill its own process; do workers have "
                "enough memory? Run again to try once more, all other rows are kept"
            )

    def _check(self, client: Client, running: int = 0) -> None:
        """Raise whatever makes it useless to wait any longer."""
        ask_for(client, math.ceil((self.pending.size - self.next) / self.policy.multiple) + running)
        if drain.seconds_left() < STOPPING_S:
            raise self._walltime()
        with suppress(queue.Empty):
            told = self.too_short.get_nowait()
            raise ClusterError(
                f"the workers' walltime of {told['walltime_s']:.0f} s is too short: one evaluation takes at least "
                f"{told['needed_s'] / self.policy.multiple:.0f} s; ask for more time, finished rows are kept"
            )

    def _window(self, slots: int) -> int:
        """How many batches may be with the workers: what waits on a worker cannot go to one that becomes free."""
        short = not self.slowest or self._expected_s(self.largest) < ONE_AHEAD_S
        return slots * self.policy.batches_per_worker if short else slots

    def _expected_s(self, rows: int) -> float:
        return drain.SAFETY * max(self.slowest) * rows if self.slowest else 0.0

    def _in_time(self, batch: _Batch) -> bool:
        """Whether a batch would end before this process must."""
        return drain.seconds_left() > batch.expected_s + STOPPING_S

    def _walltime(self) -> WalltimeReached:
        return WalltimeReached(
            f"the walltime is near: {self.total - self.pending.size + self.done:,} of {self.total:,} rows are "
            "finished and kept; run the same command again to go on",
            worked=self.had_workers and time.monotonic() - self.came > drain.walltime_s() / 4,
        )

    def _next_batch(self, slots: int, key: str) -> _Batch:
        rows = self.pending[self.next : self.next + self._batch_size(slots)]
        rows = rows[
            rows // self.table.chunk_rows == rows[0] // self.table.chunk_rows
        ]  # so that a chunk knows when it is complete
        self.next += rows.size
        batch = _Batch(key, rows, self.table.parameters(rows), self.table.journal, self.policy.retries)
        batch.expected_s = self._expected_s(rows.size)
        return batch

    def _batch_size(self, slots: int) -> int:
        left = self.pending.size - self.next
        size = self.largest
        if self.seconds_per_row:
            seconds = max(self.policy.batch_s, slots / BATCHES_PER_S)
            size = int(seconds / max(statistics.median(self.seconds_per_row), 1e-9))
            size = min(size, 8 * self.largest)  # the first batches also load code
        size = min(size, self.table.chunk_rows, math.ceil(left / slots))  # all workers end at about the same time
        multiple = self.policy.multiple
        size = max(multiple, -(-size // multiple) * multiple)
        self.largest = max(self.largest, size)
        return size

    def _collect(self, future: Any, batch: _Batch, submit: Callable[[_Batch], None]) -> None:
        try:
            self._note(batch, future.result())
        except KilledWorker:
            if is_whole(batch.segment):
                self._note(batch, _Done(None, 0))
            elif batch.apart < TRIES_APART:
                for row in batch.rows_apart():
                    row.expected_s = self._expected_s(1)
                    submit(row)
            else:
                self.given_up.append(batch)
        except (CancelledError, CommClosedError) as error:
            lost = "the cluster was lost; run the same command again, finished rows are kept"
            raise ClusterError(lost) from error
        except OSError as error:
            raise _named(error, batch) from error

    def _note(self, batch: _Batch, done: "_Done") -> None:
        """A batch is in the journal: count it, and commit its chunk once that is complete."""
        if done.seconds is not None:
            self.seconds_per_row.append(done.seconds / batch.rows.size)
            self.slowest.append(done.seconds / batch.rows.size)
        self.done += batch.rows.size
        self.failed += done.failed
        chunk = int(batch.rows[0]) // self.table.chunk_rows
        self.finished.setdefault(chunk, []).append(batch.segment)
        self.left_in_chunk[chunk] -= batch.rows.size
        if self.left_in_chunk[chunk] == 0:  # each chunk is written once
            self.table.fold(self.finished.pop(chunk))
        self._tell()

    def _tell(self) -> None:
        if self.report is not None:
            finished = self.total - self.pending.size + self.done
            self.report(finished, self.already_failed + self.failed, self.rows_running)


def _named(error: OSError, batch: _Batch) -> StoreError:
    """What the disk did to a batch, in words for a person."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return StoreError(
            f"{error.filename or batch.segment.parent}: no space left on the disk; free some and run the same command "
            "again, nothing is lost"
        )
    return StoreError(f"{error.filename or batch.segment.parent}: {error.strerror or error}")


@dataclass(frozen=True)
class _Done:
    seconds: float | None
    failed: int


class _Carrier(WorkerPlugin):
    """Brings an evaluation to every worker, also to those that join or restart later."""

    def __init__(self, key: str, evaluation: Evaluation) -> None:
        self.key = key
        self.name = f"sinew-evaluation-{key}"
        self.evaluation = evaluation

    def setup(self, worker: Any) -> None:
        _evaluations[self.key] = self.evaluation

    def teardown(self, worker: Any) -> None:
        _evaluations.pop(self.key, None)


_evaluations: dict[str, Evaluation] = {}


def _register(client: Client, plugin: Any) -> None:
    """Bring a plugin to the workers. One that dies meanwhile gets it when it is back; ask again."""
    for attempt in range(5):
        try:
            client.register_plugin(plugin, name=plugin.name)
            return
        except OSError as error:
            if attempt == 4:
                raise ClusterError("the cluster's workers do not answer; run the same command again") from error
            time.sleep(1.0)


def _run_in_time(batch: _Batch) -> _Done:
    """On a worker: as below, or hand the batch back because the worker has to leave."""
    if not is_whole(batch.segment):
        drain.enter(batch.expected_s)
    return _run_batch(batch)


def _run_batch(batch: _Batch) -> _Done:
    """Evaluate a batch and put its outcome into the journal."""
    if is_whole(batch.segment):  # a worker died after it had finished, before it could say so
        return _Done(None, 0)
    started = time.perf_counter()
    if not batch.apart:
        failed = _evaluate_and_write(batch, _evaluations[batch.key])
        return _Done(time.perf_counter() - started, failed)
    death = isolation.run_apart(functools.partial(_evaluate_and_write, batch, _evaluations[batch.key]))
    if death is None and is_whole(batch.segment):
        failed = int((Segment.read(batch.segment).status > 0).sum())
    else:
        _write_failure(batch, "crashed", f"its process died while it evaluated this row alone ({death})")
        failed = batch.rows.size
    return _Done(time.perf_counter() - started, failed)


def _evaluate_and_write(batch: _Batch, evaluation: Evaluation) -> int:
    """Returns how many rows failed."""
    outcome, attempts, seconds = _undisturbed(evaluation, batch)
    segment = Segment(batch.rows, outcome.status, attempts, seconds, outcome.values, outcome.messages, _worker_name())
    segment.write(batch.segment)
    return int((outcome.status > 0).sum())


def _undisturbed(evaluation: Evaluation, batch: _Batch) -> tuple[Outcome, Array, Array]:
    """Evaluate; when somebody stops a solver, most likely this worker is next, and the row is not to blame."""
    for _ in range(STOPPED_SOLVERS):
        try:
            return _attempt(evaluation, batch.parameters, batch.retries)
        except external.Stopped as stopped:
            reason = str(stopped)
            time.sleep(2.0)
    count = len(batch.parameters)
    status = np.full(count, STATUSES.index("crashed"), dtype=np.int8)
    words = f"the solver was stopped {STOPPED_SOLVERS} times from outside ({reason})"
    return Outcome({}, status, (words,) * count), np.full(count, STOPPED_SOLVERS, np.int16), np.full(count, np.nan)


def _attempt(evaluation: Evaluation, parameters: Array, retries: int) -> tuple[Outcome, Array, Array]:
    """Evaluate, then try again what may have failed by bad luck. Returns outcome, attempts ``[n]``, seconds ``[n]``."""
    started = time.perf_counter()
    outcome = _contained(evaluation, parameters)
    count = len(parameters)
    seconds = np.full(count, (time.perf_counter() - started) / count)
    attempts = np.ones(count, dtype=np.int16)
    retried = [STATUSES.index(name) for name in RETRIED]
    for _ in range(retries):
        again = np.flatnonzero(np.isin(outcome.status, retried))
        if not again.size:
            break
        started = time.perf_counter()
        outcome = _replaced(outcome, again, _contained(evaluation, parameters[again]))
        seconds[again] += (time.perf_counter() - started) / again.size
        attempts[again] += 1
    return outcome, attempts, seconds


def _contained(evaluation: Evaluation, parameters: Array) -> Outcome:
    """Evaluate; a row whose evaluation raises is a failed row, not a failed batch; an error of the system is none."""
    try:
        outcome = evaluation(parameters)
    except OSError:  # a disk, a mount, a program that is gone
        raise
    except Exception as error:  # noqa: BLE001 - whatever a model raises is that row's failure
        if len(parameters) > 1:
            return _joined([_contained(evaluation, row[np.newaxis]) for row in parameters])
        reason = STATUSES.index("out_of_memory" if isinstance(error, MemoryError) else "crashed")
        return Outcome({}, np.array([reason], dtype=np.int8), (f"{type(error).__name__}: {error}",))
    broken = np.zeros(len(parameters), dtype=bool)
    for array in outcome.values.values():
        broken |= ~np.isfinite(array.reshape(len(parameters), -1)).all(axis=1)
    broken &= outcome.status == 0
    status = np.where(broken, STATUSES.index("bad_output"), outcome.status).astype(np.int8)
    if not status.any():
        return outcome
    messages = list(outcome.messages or [""] * len(parameters))
    for i in np.flatnonzero(broken):
        messages[i] = "the outcome holds numbers that are not finite"
    values = {name: array.copy() for name, array in outcome.values.items()}
    for array in values.values():
        array[status > 0] = np.nan  # a failed row has no numbers, not half of them
    return Outcome(values, status, tuple(messages))


def _joined(outcomes: list[Outcome]) -> Outcome:
    shapes = next((o.values for o in outcomes if o.values), {})
    values = {
        name: np.concatenate([o.values.get(name, np.full((1, *like.shape[1:]), np.nan)) for o in outcomes])
        for name, like in shapes.items()
    }
    messages = tuple(o.messages[0] if o.messages else "" for o in outcomes)
    return Outcome(values, np.concatenate([o.status for o in outcomes]), messages)


def _replaced(outcome: Outcome, at: Array, by: Outcome) -> Outcome:
    values = {name: array.copy() for name, array in (outcome.values or by.values).items()}
    for name, array in values.items():
        array[at] = by.values.get(name, np.nan)
    status = outcome.status.copy()
    status[at] = by.status
    messages = list(outcome.messages or [""] * len(status))
    for place, i in enumerate(at):
        messages[i] = by.messages[place] if by.messages else ""
    return Outcome(values, status, tuple(messages))


def _write_failure(batch: _Batch, status: str, message: str) -> None:
    count = batch.rows.size
    Segment(
        batch.rows,
        np.full(count, STATUSES.index(status), dtype=np.int8),
        np.full(count, batch.apart, dtype=np.int16),
        np.full(count, np.nan),
        {},
        (message,) * count,
        _worker_name(),
    ).write(batch.segment)


def _worker_name() -> str:
    job = slurm.job()
    return f"{slurm.node() or socket.gethostname()}:{os.getpid()}" + (f" job {job}" if job else "")


def failures(table: Table, rows: Iterable[int]) -> dict[str, int]:
    """How many of ``rows`` failed, by status."""
    status = table.status[np.fromiter(rows, dtype=np.int64)]
    return {name: int((status == i).sum()) for i, name in enumerate(STATUSES) if i and (status == i).any()}
