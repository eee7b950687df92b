"""Evaluate many rows of parameters: bounded window, batches, retries, failures as data, commits."""

import errno
import hashlib
import math
import os
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

from runner.errors import ClusterError, StoreError
from runner.progress import Report
from runner.store import STATUSES, Array, Segment, Table, is_whole

WAIT_FOR_WORKERS_S = 120
RECOUNT_S = 2.0
RETRIED = ("crashed", "out_of_memory", "bad_output")


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
    done in this process. Interrupt it, kill it or its
    workers: what was committed stays, and the same call goes on from there. Raises ``StoreError`` when results cannot
    be written and ``ClusterError`` when the cluster is lost.
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

    def __init__(self, key: str, rows: Array, parameters: Array, journal: Path, retries: int) -> None:
        self.key = key
        self.rows = rows
        self.parameters = parameters
        self.retries = retries
        content = hashlib.blake2b(rows.tobytes(), digest_size=6).hexdigest()
        self.segment = journal / f"rows-{rows[0]:09d}-{content}-{rows.size:05d}.safetensors"

    def single_rows(self) -> "list[_Batch]":
        journal = self.segment.parent
        return [
            _Batch(self.key, self.rows[i : i + 1], self.parameters[i : i + 1], journal, self.retries)
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
    suspects: list[_Batch] = field(default_factory=list)
    alone: bool = False
    seconds_per_row: deque[float] = field(default_factory=lambda: deque(maxlen=9))
    left_in_chunk: dict[int, int] = field(default_factory=dict)
    finished: dict[int, list[Path]] = field(default_factory=dict)

    def work(self) -> None:
        chunks, counts = np.unique(self.pending // self.table.chunk_rows, return_counts=True)
        self.left_in_chunk = dict(zip(chunks.tolist(), counts.tolist(), strict=True))
        self.largest = self.policy.multiple * 4
        if self.client is None:
            self._work_here()
        else:
            self._work_on(self.client)

    def _work_here(self) -> None:
        _evaluations[self.table.key] = self.evaluation
        try:
            while self.next < self.pending.size:
                batch = self._next_batch(1, self.table.key)
                try:
                    self._note(batch, _run_batch(batch))
                except OSError as error:
                    raise _named(error, batch) from error
        finally:
            del _evaluations[self.table.key]

    def _work_on(self, client: Client) -> None:
        key = f"{self.table.key}-{secrets.token_hex(4)}"  # another run of this study may share the scheduler
        plugin = _Carrier(key, self.evaluation)
        try:
            client.wait_for_workers(1, timeout=WAIT_FOR_WORKERS_S)
        except TimeoutError as error:
            raise ClusterError(f"the cluster has no worker after {WAIT_FOR_WORKERS_S} s; start some") from error
        _register(client, plugin)
        running: dict[Any, _Batch] = {}
        completed = as_completed(loop=client.loop)

        def submit(batch: _Batch) -> None:
            future = client.submit(_run_batch, batch, pure=False)
            running[future] = batch
            completed.add(future)

        slots, counted = 1, -math.inf
        try:
            while self.next < self.pending.size or running:
                if time.monotonic() - counted > RECOUNT_S:  # workers come and go
                    slots, counted = max(1, sum(client.nthreads().values())), time.monotonic()
                while len(running) < slots * self.policy.batches_per_worker and self.next < self.pending.size:
                    submit(self._next_batch(slots, key))
                future = next(completed)
                self._collect(future, running.pop(future), submit)
                future.release()
            while self.suspects:  # one at a time: if workers die now, it is this row that kills them
                self.alone = True
                batch = self.suspects.pop()
                submit(batch)
                self._collect(next(completed), batch, submit)
                running.clear()
        finally:
            with suppress(OSError, ValueError, CommClosedError, CancelledError):  # the cluster itself may be gone
                client.cancel(list(running))
                client.unregister_worker_plugin(plugin.name)

    def _next_batch(self, slots: int, key: str) -> _Batch:
        rows = self.pending[self.next : self.next + self._batch_size(slots)]
        rows = rows[
            rows // self.table.chunk_rows == rows[0] // self.table.chunk_rows
        ]  # so that a chunk knows when it is complete
        self.next += rows.size
        return _Batch(key, rows, self.table.parameters(rows), self.table.journal, self.policy.retries)

    def _batch_size(self, slots: int) -> int:
        left = self.pending.size - self.next
        size = self.largest
        if self.seconds_per_row:
            size = int(self.policy.batch_s / max(statistics.median(self.seconds_per_row), 1e-9))
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
            elif batch.rows.size > 1:  # one of the rows kills its worker, the others are innocent
                for row in batch.single_rows():
                    submit(row)
            elif not self.alone:  # perhaps it only waited on a worker that another row killed
                self.suspects.append(batch)
            else:
                deaths = int(dask.config.get("distributed.scheduler.allowed-failures")) + 1
                _write_failure(batch, "crashed", f"its worker died {deaths} times while it evaluated this row", deaths)
                self._note(batch, _Done(None, 1))
        except (CancelledError, CommClosedError) as error:
            lost = "the cluster was lost; run the same command again, finished rows are kept"
            raise ClusterError(lost) from error
        except OSError as error:
            raise _named(error, batch) from error

    def _note(self, batch: _Batch, done: "_Done") -> None:
        """A batch is in the journal: count it, and commit its chunk once that is complete."""
        if done.seconds is not None:
            self.seconds_per_row.append(done.seconds / batch.rows.size)
        self.done += batch.rows.size
        self.failed += done.failed
        chunk = int(batch.rows[0]) // self.table.chunk_rows
        self.finished.setdefault(chunk, []).append(batch.segment)
        self.left_in_chunk[chunk] -= batch.rows.size
        if self.left_in_chunk[chunk] == 0:  # each chunk is written once
            self.table.fold(self.finished.pop(chunk))
        if self.report is not None:
            self.report(self.total - self.pending.size + self.done, self.already_failed + self.failed)


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


def _register(client: Client, plugin: _Carrier) -> None:
    """Bring the evaluation to the workers. One that dies meanwhile gets it when it is back; ask again."""
    for attempt in range(5):
        try:
            client.register_plugin(plugin, name=plugin.name)
            return
        except OSError as error:
            if attempt == 4:
                raise ClusterError("the cluster's workers do not answer; run the same command again") from error
            time.sleep(1.0)


def _run_batch(batch: _Batch) -> _Done:
    """On a worker: evaluate a batch and put its outcome into the journal."""
    if is_whole(batch.segment):  # a worker died after it had finished, before it could say so
        return _Done(None, 0)
    started = time.perf_counter()
    outcome, attempts, seconds = _attempt(_evaluations[batch.key], batch.parameters, batch.retries)
    segment = Segment(batch.rows, outcome.status, attempts, seconds, outcome.values, outcome.messages, _worker_name())
    segment.write(batch.segment)
    return _Done(time.perf_counter() - started, int((outcome.status > 0).sum()))


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


def _write_failure(batch: _Batch, status: str, message: str, attempts: int) -> None:
    count = batch.rows.size
    Segment(
        batch.rows,
        np.full(count, STATUSES.index(status), dtype=np.int8),
        np.full(count, attempts, dtype=np.int16),
        np.full(count, np.nan),
        {},
        (message,) * count,
        _worker_name(),
    ).write(batch.segment)


def _worker_name() -> str:
    job = os.environ.get("SLURM_JOB_ID")
    return f"{socket.gethostname()}:{os.getpid()}" + (f" job {job}" if job else "")


def failures(table: Table, rows: Iterable[int]) -> dict[str, int]:
    """How many of ``rows`` failed, by status."""
    status = table.status[np.fromiter(rows, dtype=np.int64)]
    return {name: int((status == i).sum()) for i, name in enumerate(STATUSES) if i and (status == i).any()}
