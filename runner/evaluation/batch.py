"""A batch of rows: what a worker receives, how it evaluates it, and what it writes into the journal."""

import functools
import hashlib
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from distributed import WorkerPlugin

from sinew.runner.cluster import drain
from sinew.runner.cluster.batch_systems import current_job, this_node
from sinew.runner.evaluation import external, isolation
from sinew.runner.evaluation.interim import kept_count, kept_until_written
from sinew.runner.store.schema import STATUSES, Array
from sinew.runner.store.segment import Segment, is_whole

T = TypeVar("T")
RETRIED = ("crashed", "out_of_memory", "bad_output")
STOPPED_SOLVERS, AGAIN_S = 5, 2.0  # processes that are stopped from outside, and the pause before the next one


@dataclass(frozen=True)
class Outcome:
    """The outcomes of ``n`` rows: ``values[field]`` is ``[n, ...]`` float64 (NaN where a row failed).

    ``status`` ``[n]`` indexes :data:`sinew.runner.store.schema.STATUSES`; ``messages`` has ``n`` texts, or none if no
    row failed.
    """

    values: Mapping[str, Array]
    status: Array
    messages: tuple[str, ...] = ()


class Evaluation(Protocol):
    """A callable that is pickled, sent to every worker, and evaluates rows of parameters.

    One with an attribute ``restarts`` that is true goes on where it was interrupted: its batches need not end before a
    walltime does.
    """

    def __call__(self, parameters: Array) -> Outcome:
        """The outcomes of ``parameters`` ``[n, d]``; each must depend on its own row only."""
        ...


class Batch:
    """What a worker needs to evaluate some rows. It is small, because the workers have the evaluation already."""

    def __init__(
        self,
        key: str,
        rows: Array,
        parameters: Array,
        journal: Path,
        retries: int,
        apart: int = 0,
        *,
        restarts: bool = False,
    ) -> None:
        self.key = key
        self.rows = rows
        self.parameters = parameters
        self.retries = retries
        self.apart = apart  # how often it was tried in its own process
        self.restarts = restarts
        self.expected_s = 0.0
        content = hashlib.blake2b(rows.tobytes(), digest_size=6).hexdigest()
        self.segment = journal / f"rows-{rows[0]:09d}-{content}-{rows.size:05d}.safetensors"

    def rows_apart(self) -> "list[Batch]":
        """Each row as a batch that is evaluated in its own process."""
        journal = self.segment.parent
        return [
            Batch(
                self.key,
                self.rows[i : i + 1],
                self.parameters[i : i + 1],
                journal,
                self.retries,
                self.apart + 1,
                restarts=self.restarts,
            )
            for i in range(self.rows.size)
        ]


class Carrier(WorkerPlugin):
    """A plugin that brings evaluations to every worker, also to those that join or restart later."""

    def __init__(self, name: str, carried: Mapping[str, Evaluation]) -> None:
        self.name = f"sinew-evaluations-{name}"
        self.carried = carried

    def setup(self, worker: Any) -> None:
        evaluations.update(self.carried)

    def teardown(self, worker: Any) -> None:
        for key in self.carried:
            evaluations.pop(key, None)


evaluations: dict[str, Evaluation] = {}


def run_in_time(batch: Batch) -> None:
    """As :func:`run_batch`, but raise ``distributed.Reschedule`` if the batch cannot end before the walltime."""
    if not is_whole(batch.segment):
        drain.enter(batch.expected_s, kept=kept_count if batch.restarts else None)
        _run(batch)


def run_batch(batch: Batch) -> None:
    """Evaluate a batch and write its outcomes into the journal; nothing is returned."""
    if not is_whole(batch.segment):  # otherwise a worker had finished it and died before it could report
        _run(batch)


def _run(batch: Batch) -> None:
    if not batch.apart:
        _evaluate_and_write(batch, evaluations[batch.key])
        return
    work = functools.partial(_evaluate_and_write, batch, evaluations[batch.key])
    try:
        death = _undisturbed(lambda: isolation.run_apart(work))
    except external.Stopped as stopped:
        death = f"stopped {STOPPED_SOLVERS} times from outside: {stopped}"
    if death is not None or not is_whole(batch.segment):
        _write_failure(batch, "crashed", f"its process died while it evaluated this row alone ({death})")


def _undisturbed(work: Callable[[], T]) -> T:
    """What ``work`` returns. It is tried again when it is stopped from outside: then this worker is probably next.

    Raises the last ``Stopped`` when that happens every time.
    """
    for _ in range(STOPPED_SOLVERS):
        try:
            return work()
        except external.Stopped as stopped:
            last = stopped
            time.sleep(AGAIN_S)
    raise last


def _evaluate_and_write(batch: Batch, evaluation: Evaluation) -> None:
    with kept_until_written():
        outcome, attempts, seconds = _outcome(evaluation, batch)
        written = Segment(
            batch.rows, outcome.status, attempts, seconds, outcome.values, outcome.messages, _worker_name()
        )
        written.write(batch.segment)


def _outcome(evaluation: Evaluation, batch: Batch) -> tuple[Outcome, Array, Array]:
    """As :func:`_attempt`; every row has crashed where the solver was stopped from outside every time."""
    try:
        return _undisturbed(lambda: _attempt(evaluation, batch.parameters, batch.retries))
    except external.Stopped as stopped:
        words = f"the solver was stopped {STOPPED_SOLVERS} times from outside ({stopped})"
    count = len(batch.parameters)
    status = np.full(count, STATUSES.index("crashed"), dtype=np.int8)
    return Outcome({}, status, (words,) * count), np.full(count, STOPPED_SOLVERS, np.int16), np.full(count, np.nan)


def _attempt(evaluation: Evaluation, parameters: Array, retries: int) -> tuple[Outcome, Array, Array]:
    """Evaluate, and retry rows whose failure may be accidental. Returns outcome, attempts ``[n]``, seconds ``[n]``."""
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
    """Evaluate; an exception fails its row, not the batch. Raises ``OSError``: errors of the system fail no row."""
    try:
        outcome = evaluation(parameters)
    except OSError:  # a full disk, a lost mount, a missing program
        raise
    except Exception as error:  # noqa: BLE001 - any exception of a model is a failed row
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
        array[status > 0] = np.nan  # a failed row has no numbers at all
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


def _write_failure(batch: Batch, status: str, message: str) -> None:
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
    job = current_job()
    return f"{this_node()}:{os.getpid()}" + (f" job {job}" if job else "")
