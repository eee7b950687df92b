"""Evaluate many rows of parameters: bounded window, batches, retries, failures as data, commits.

:func:`evaluate` is for rows that are known beforehand. :func:`converse` is for those who decide what to ask next when
they have heard what became of what they asked before: several of them talk to one cluster at the same time, so that it
has work while one of them thinks.
"""

import contextvars
import functools
import math
import queue
import secrets
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dask
import numpy as np
from distributed import CancelledError, Client, KilledWorker, as_completed
from distributed.comm.core import CommClosedError
from threadpoolctl import threadpool_limits

from runner import drain
from runner.batch import Batch, Carrier, Evaluation, evaluations, run_batch, run_in_time
from runner.cluster import ask_for, wait_for_workers
from runner.errors import ClusterError, StoreError, WalltimeReached, of_the_system
from runner.progress import Report
from runner.store import PENDING, STATUSES, Array, Segment, Table, is_whole

RECOUNT_S = 2.0
BATCHES_PER_S = 30  # what a scheduler does with a fifth of its time
AWAITED_PER_S = 120  # of batches of rows that somebody waits for, at the most; else batches get longer
ONE_AHEAD_S = 5.0  # a worker gets its next batch early, unless batches take longer than this
ASK_AGAIN_S = 1.0
LOST = (OSError, ValueError)  # a message to a process that dies: a handshake over TLS tells it as the second
IN_A_MESSAGE = 64  # batches: a few megabytes of parameters at the most
AWAITED_S = 0.1  # a batch of rows that somebody waits for: one after the other in a long one, they would be heard late
STOPPING_S = 10.0  # to close the cluster in, before the deadline of the process that leads it
TRIES_APART = 3
SEGMENTS_KEPT = 256  # of a table whose rows come one after the other, before they are folded into their chunk


@dataclass(frozen=True)
class Policy:
    """How rows are cut into batches and what happens to those that fail.

    ``batch_s``: aimed-at duration of a batch; ``multiple``: batches hold a multiple of this many rows;
    ``retries``: how often a row with a status in :data:`runner.batch.RETRIED` is tried again.
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
        run = _Run(client(), policy, report, total, failed)
        run.add(table, evaluation).put(pending)
        run.work()
        if (left := table.pending(rows).size) > 0:
            raise StoreError(f"{table.journal}: {left} rows have no outcome although their batches ended; run again")


@dataclass(frozen=True)
class Told:
    """What became of one row: ``values[field]`` is ``[...]``, NaN when it failed; ``status`` as in ``STATUSES``."""

    status: int
    values: Mapping[str, Array]


@dataclass(frozen=True)
class Talk:
    """Somebody who asks for rows step by step: ``rows`` of them at the most, of any number of ``tables``.

    ``work`` runs in a thread of its own. All that it does must follow from what its desk tells it.
    """

    tables: Sequence[tuple[Table, Evaluation]]
    rows: int
    work: "Callable[[Desk], Any]"


_computing = threading.Lock()


class Desk:
    """Where the ``work`` of a :class:`Talk` asks for evaluations. It hears of them in the order in which it asked."""

    def __init__(self, send: "Callable[[_Message], None]", *, here: bool) -> None:
        self._send = send
        self._here = here
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def ask(self, parameters: Array, table: int = 0) -> None:
        """Ask for ``parameters`` ``[n, d]`` of one of the tables and go on."""
        self._send(_Message(self, parameters=np.array(parameters, dtype=np.float64), table=table))

    def next(self) -> Told:
        """What became of the next row that was asked for; waits for it."""
        answer = self._answers.get()
        if isinstance(answer, BaseException):
            raise answer
        assert isinstance(answer, Told)
        return answer

    def all_of(self, parameters: Array) -> list[Told]:
        """Ask for ``parameters`` ``[n, d]`` and wait for all of them."""
        self.ask(parameters)
        return [self.next() for _ in parameters]

    def compute(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """The value of ``function(*arguments)``, found on a worker; waits for it."""
        if self._here:
            with _computing:  # libraries that think of themselves as alone in a process
                return function(*arguments)
        answer: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._send(_Message(self, computation=(function, arguments), answer=answer))
        value = answer.get()
        if isinstance(value, BaseException):
            raise value
        return value

    def hear(self, answer: Any) -> None:
        """Called by the runner."""
        self._answers.put(answer)


def converse(
    client: Callable[[], Client | None],
    talks: Sequence[Talk],
    report: Report | None = None,
    policy: Policy = Policy(),
) -> list[Any]:
    """Let several talks share a cluster; returns what their work returned. Raises what :func:`evaluate` raises.

    Every row asked for is planned in its table, in the order of asking, and committed. A talk whose rows are all known
    costs look-ups. What a worker computes and what a talk does has one thread for linear algebra, so that its numbers
    do not depend on the machine's cores.
    """
    if not talks:
        return []
    for talk in talks:
        for table, _ in talk.tables:
            table.fold(table.segments())
    with threadpool_limits(1):
        run = _Run(client(), policy, report, sum(talk.rows for talk in talks), 0)
        return run.converse(talks)


class _Closed(Exception):
    """What a desk says to those who still wait when a run ends early."""


@dataclass(frozen=True)
class _Message:
    """From a desk to the run: rows, a computation, or the end."""

    desk: Desk
    parameters: Array | None = None
    table: int = 0
    computation: tuple[Callable[..., Any], tuple[Any, ...]] | None = None
    answer: "queue.SimpleQueue[Any] | None" = None
    result: Any = None
    error: BaseException | None = None


@dataclass(eq=False)
class _Source:
    """Rows of one table on their way through a run, and how long such rows take."""

    table: Table
    evaluation: Evaluation
    key: str
    multiple: int
    largest: int = 0
    open: bool = False  # more may be asked for
    pending: Array = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    first: int = 0
    seconds_per_row: deque[float] = field(default_factory=lambda: deque(maxlen=9))
    slowest: deque[float] = field(default_factory=lambda: deque(maxlen=200))
    left_in_chunk: dict[int, int] = field(default_factory=dict)
    finished: dict[int, dict[Path, Segment]] = field(default_factory=dict)
    waiting: set[int] = field(default_factory=set)  # rows that a desk has asked for and nobody knows yet
    heard: dict[int, Told] = field(default_factory=dict)
    known: dict[int, tuple[Array, dict[str, Array]]] = field(default_factory=dict)  # chunks read back
    fresh: dict[int, Path] = field(default_factory=dict)  # finished rows and their segments

    def put(self, rows: Array) -> None:
        """More rows without an outcome."""
        self.pending = np.concatenate([self.pending[self.first :], rows])
        self.first = 0
        chunks, counts = np.unique(rows // self.table.chunk_rows, return_counts=True)
        for chunk, count in zip(chunks.tolist(), counts.tolist(), strict=True):
            self.left_in_chunk[chunk] = self.left_in_chunk.get(chunk, 0) + count

    @property
    def left(self) -> int:
        return self.pending.size - self.first

    def expected_s(self, rows: int) -> float:
        return drain.SAFETY * max(self.slowest) * rows if self.slowest else 0.0

    def batch_size(self, slots: int, aim_s: float, left: int, running: int) -> int:
        """``left``, ``running``: rows of all tables that wait, and that workers have."""
        size = self.largest = max(self.largest, self.multiple)
        if self.seconds_per_row:
            each = max(statistics.median(self.seconds_per_row), 1e-9)
            least, most = (min(aim_s, AWAITED_S), AWAITED_PER_S) if self.open else (aim_s, BATCHES_PER_S)
            size = int(max(least, slots / most) / each)
            size = min(size, 8 * self.largest)  # the first batches also load code
            queued = len(self.waiting) // (2 * slots)  # in a long queue, rows of a batch are heard no later
            size = max(size, min(queued, int(aim_s / each)))  # but may be lost together
        fair = math.ceil((left + running) / (2 * slots)) if self.open else math.ceil(left / slots)
        size = min(size, self.table.chunk_rows, fair)  # all workers end at about the same time
        size = max(self.multiple, -(-size // self.multiple) * self.multiple)
        self.largest = max(self.largest, size)
        return size

    def take(self, size: int, retries: int) -> Batch:
        """The next batch of at most ``size`` rows."""
        rows = self.pending[self.first : self.first + size]
        chunk = rows // self.table.chunk_rows
        rows = rows[chunk == chunk[0]]  # so that a chunk knows when it is complete
        self.first += rows.size
        batch = Batch(self.key, rows, self.table.parameters(rows), self.table.journal, retries)
        batch.expected_s = self.expected_s(rows.size)
        return batch

    def note(self, batch: Batch) -> int:
        """A batch is in the journal; commit its chunk once that is complete. Returns how many of its rows failed."""
        segment = Segment.read(batch.segment, whole=self.open)
        if math.isfinite(seconds := float(segment.wall_seconds.mean())):
            self.seconds_per_row.append(seconds)
            self.slowest.append(seconds)
        chunk = int(batch.rows[0]) // self.table.chunk_rows
        self.finished.setdefault(chunk, {})[batch.segment] = segment
        self.left_in_chunk[chunk] -= batch.rows.size
        if self.open:
            self._hear_of(segment, batch.segment)
        complete = self.left_in_chunk[chunk] == 0
        if self.open:  # more rows of this chunk may come
            complete = len(self.finished[chunk]) >= SEGMENTS_KEPT
        if complete:  # each chunk is written once, or now and then
            self._fold(chunk)
        return int((segment.status > 0).sum())

    def close(self) -> None:
        """Nothing more will be asked for."""
        self.open = False
        for chunk in list(self.finished):
            if self.left_in_chunk[chunk] == 0:
                self._fold(chunk)

    def _fold(self, chunk: int) -> None:
        self.table.fold(self.finished.pop(chunk))
        self.fresh = {row: path for row, path in self.fresh.items() if row // self.table.chunk_rows != chunk}

    # ---- for desks

    def ask(self, parameters: Array) -> list[int]:
        """Plan rows for a desk and look up those that are known; returns their numbers."""
        rows: list[int] = self.table.plan(parameters, settle=False).tolist()
        new = [row for row in dict.fromkeys(rows) if row not in self.waiting and not self._look_up(row)]
        if new:
            self.waiting.update(new)
            self.put(np.array(new, dtype=np.int64))
        return rows

    def _look_up(self, row: int) -> bool:
        if row in self.heard:
            return True
        if row in self.fresh:
            self._hear_of(Segment.read(self.fresh[row], whole=True), self.fresh[row], only=row)
            return True
        if self.table.status[row] == PENDING:
            return False
        chunk = row // self.table.chunk_rows
        if chunk not in self.known or self.known[chunk][0].size <= row % self.table.chunk_rows:
            self._read_back(chunk)
        if self.known[chunk][0][row % self.table.chunk_rows] == PENDING:
            self._read_back(chunk)
        status, values = self.known[chunk]
        place = row % self.table.chunk_rows
        self.heard[row] = Told(int(status[place]), {name: array[place] for name, array in values.items()})
        return True

    def _read_back(self, chunk: int) -> None:
        rows = np.arange(chunk * self.table.chunk_rows, min((chunk + 1) * self.table.chunk_rows, self.table.settled))
        values = {name: self.table.read(name, rows) for name in self.table.fields}
        self.known = {chunk: (self.table.status[rows].copy(), values)}

    def _hear_of(self, segment: Segment, path: Path, only: int | None = None) -> None:
        values = segment.values
        self.waiting.difference_update(segment.rows.tolist())
        for place, row in enumerate(segment.rows.tolist()):
            self.fresh[row] = path
            if only is None or row == only:
                status = int(segment.status[place])
                told = {n: values[n][place] if n in values else self.table.nothing(n) for n in self.table.fields}
                self.heard[row] = Told(status, told)


@dataclass(eq=False)
class _Conversation:
    """A talk while it lasts: its desk, its tables, and what it still waits to hear of."""

    desk: Desk
    sources: list[_Source]
    asked: deque[tuple[_Source, int]] = field(default_factory=deque)
    open: bool = True
    result: Any = None

    def ask(self, message: _Message) -> None:
        source = self.sources[message.table]
        assert message.parameters is not None
        self.asked.extend((source, row) for row in source.ask(message.parameters))

    def answers(self) -> Iterable[Told]:
        """Those that are due, in the order of asking."""
        while self.asked and self.asked[0][1] in self.asked[0][0].heard:
            source, row = self.asked.popleft()
            yield source.heard[row] if (source, row) in self.asked else source.heard.pop(row)

    def close(self, result: Any) -> None:
        self.result, self.open = result, False
        for source in self.sources:
            source.close()


@dataclass
class _Run:
    """One call of :func:`evaluate` or :func:`converse` while it lasts."""

    client: Client | None
    policy: Policy
    report: Report | None
    total: int
    failed: int
    sources: list[_Source] = field(default_factory=list)
    name: str = field(default_factory=lambda: secrets.token_hex(4))  # another run may share the scheduler
    done: int = 0  # rows finished before this call, and by it
    rows_running: int = 0
    had_workers: bool = True
    came: float = field(default_factory=time.monotonic)
    given_up: list[Batch] = field(default_factory=list)
    too_short: "queue.SimpleQueue[Mapping[str, float]]" = field(default_factory=queue.SimpleQueue)
    inbox: "queue.SimpleQueue[_Message]" = field(default_factory=queue.SimpleQueue)
    bell: threading.Condition = field(default_factory=threading.Condition)
    conversations: dict[Desk, _Conversation] = field(default_factory=dict)
    turn: int = 0

    def add(self, table: Table, evaluation: Evaluation) -> _Source:
        source = _Source(table, evaluation, f"{table.key}-{self.name}", self.policy.multiple)
        table.journal.mkdir(parents=True, exist_ok=True)
        self.sources.append(source)
        return source

    @property
    def left(self) -> int:
        """Rows that wait for a worker."""
        return sum(source.left for source in self.sources)

    def work(self) -> None:
        self.done = self.total - self.left if not self.conversations else 0
        try:
            if self.client is None:
                self._work_here()
            else:
                self._work_on(self.client)
        except WalltimeReached:  # a deadline's alarm comes anywhere, and does not know whether workers came in time
            raise self._walltime() from None

    # ---- talks

    def converse(self, talks: Sequence[Talk]) -> list[Any]:
        threads = []
        for talk in talks:
            desk = Desk(self._receive, here=self.client is None)
            sources = [self.add(table, evaluation) for table, evaluation in talk.tables]
            for source in sources:
                source.open = True
            self.conversations[desk] = _Conversation(desk, sources)
            run = functools.partial(contextvars.copy_context().run, self._talk, desk, talk.work)
            threads.append(threading.Thread(target=run, name="sinew-talk", daemon=True))
        try:
            for thread in threads:
                thread.start()
            self.work()
        finally:
            for desk in self.conversations:
                desk.hear(_Closed())
            for thread in threads:
                while thread.is_alive():
                    self._refuse_messages()
                    thread.join(0.05)
        return [conversation.result for conversation in self.conversations.values()]

    def _talk(self, desk: Desk, work: Callable[[Desk], Any]) -> None:
        """In a thread of its own."""
        try:
            self._receive(_Message(desk, result=work(desk)))
        except _Closed:
            return
        except BaseException as error:  # noqa: BLE001 - the thread that leads the run raises it
            self._receive(_Message(desk, error=error))

    def _receive(self, message: _Message) -> None:
        self.inbox.put(message)
        with self.bell:
            self.bell.notify_all()

    def _refuse_messages(self) -> None:
        with suppress(queue.Empty):
            while True:
                message = self.inbox.get_nowait()
                if message.answer is not None:
                    message.answer.put(_Closed())

    def _listen(self, compute: Callable[[_Message], None] | None, *, wait: bool = False) -> None:
        """Attend to what desks said; with ``wait``, to at least one of them."""
        with suppress(queue.Empty):
            while True:
                message = self.inbox.get(block=wait, timeout=0.2 if wait else None)
                wait = False
                conversation = self.conversations[message.desk]
                if message.error is not None:
                    raise message.error
                if message.parameters is not None:
                    conversation.ask(message)
                    self._answer(conversation)
                elif message.computation is not None and compute is not None:
                    compute(message)
                else:
                    conversation.close(message.result)

    def _answer(self, conversation: _Conversation) -> None:
        for told in conversation.answers():
            self.done += 1
            self.failed += told.status > 0
            conversation.desk.hear(told)
        self._tell()

    @property
    def _talking(self) -> bool:
        return any(conversation.open for conversation in self.conversations.values())

    # ---- in this process

    def _work_here(self) -> None:
        evaluations.update({source.key: source.evaluation for source in self.sources})
        try:
            while self.left or self._talking:
                self._listen(None, wait=not self.left)
                if not self.left:
                    continue
                source, batch = self._next_batch(1, 0)
                if not self._in_time(batch):
                    raise self._walltime()
                try:
                    run_batch(batch)
                    self._note(source, batch)
                except OSError as error:
                    raise _named(error, batch) from error
        finally:
            for source in self.sources:
                del evaluations[source.key]

    # ---- on a cluster

    def _work_on(self, client: Client) -> None:
        carrier = Carrier(self.name, {source.key: source.evaluation for source in self.sources})
        self.had_workers = False  # their jobs may wait in the queue for longer than this process may
        ask_for(client, self._wanted(0))
        wait_for_workers(client, functools.partial(self._check, client))
        self.had_workers, self.came = True, time.monotonic()
        _register(client, drain.Leave())
        _register(client, carrier)
        client.subscribe_topic(drain.TOO_SHORT, lambda event: self.too_short.put(event[1]))
        running: dict[Any, tuple[_Source, Batch]] = {}
        computing: dict[Any, _Message] = {}
        completed = as_completed(loop=client.loop)
        self.bell = completed.thread_condition  # rings for what is finished and for what is asked

        def submit(batches: list[tuple[_Source, Batch]]) -> None:
            """Many in one message: most of its cost does not depend on how many there are."""
            for first in range(0, len(batches), IN_A_MESSAGE):
                group = batches[first : first + IN_A_MESSAGE]
                futures = client.map(run_in_time, [batch for _, batch in group], pure=False)
                running.update(zip(futures, group, strict=True))
                completed.update(futures)

        def compute(message: _Message) -> None:
            assert message.computation is not None
            function, arguments = message.computation
            future = client.submit(function, *arguments, pure=False, priority=1)  # somebody waits for it
            computing[future] = message
            completed.add(future)

        slots, counted = 1, -math.inf
        ending = False
        batches: list[tuple[_Source, Batch]]
        try:
            while running or computing or ((self.left or self._talking) and not ending):
                self._listen(compute)
                if time.monotonic() - counted > RECOUNT_S:  # workers come and go
                    slots, counted = max(1, sum(client.nthreads().values())), time.monotonic()
                batches = []
                under_way = sum(batch.rows.size for _, batch in running.values()) if self.conversations else 0
                while not ending and len(running) + len(batches) < slots * self._ahead() and self.left:
                    source, batch = self._next_batch(slots, under_way)
                    if ending := not self._in_time(batch):
                        break
                    batches.append((source, batch))
                    under_way += batch.rows.size
                if batches:
                    submit(batches)
                while not completed.has_ready() and (running or computing or (self._talking and not ending)):
                    if not self.inbox.empty() and not ending:
                        break
                    self.rows_running = sum(batch.rows.size for _, batch in running.values())
                    self._tell()
                    self._check(client, len(running) + len(computing))
                    with completed.thread_condition:
                        if self.inbox.empty() or ending:
                            completed.thread_condition.wait(0.2)
                while completed.has_ready():
                    future = next(completed)
                    if future in running:
                        batches = self._collect(future, *running.pop(future))
                        if batches:
                            submit(batches)
                    else:
                        _hand_back(future, computing.pop(future))
                    future.release()
        finally:
            with suppress(*LOST, CancelledError):  # the cluster itself may be gone
                client.cancel([*running, *computing])
                client.unsubscribe_topic(drain.TOO_SHORT)
                with dask.config.set({"distributed.comm.timeouts.connect": "5 s"}):  # a worker may have just died
                    client.unregister_worker_plugin(carrier.name)
            for message in computing.values():
                assert message.answer is not None
                message.answer.put(_Closed())
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

    def _wanted(self, running: int) -> int:
        """How many workers would have something to do."""
        talking = sum(conversation.open for conversation in self.conversations.values())
        return max(math.ceil(self.left / self.policy.multiple) + running, talking)

    def _check(self, client: Client, running: int = 0) -> None:
        """Raise whatever makes it useless to wait any longer."""
        ask_for(client, self._wanted(running))
        if drain.seconds_left() < STOPPING_S:
            raise self._walltime()
        with suppress(queue.Empty):
            told = self.too_short.get_nowait()
            raise ClusterError(
                f"the workers' walltime of {told['walltime_s']:.0f} s is too short: one evaluation takes at least "
                f"{told['needed_s'] / self.policy.multiple:.0f} s; ask for more time, finished rows are kept"
            )

    def _ahead(self) -> int:
        """How many batches a worker may have: what waits on one cannot go to another that becomes free."""
        short = all(not source.slowest or source.expected_s(source.largest) < ONE_AHEAD_S for source in self.sources)
        return self.policy.batches_per_worker if short else 1

    def _in_time(self, batch: Batch) -> bool:
        """Whether a batch would end before this process must, even if it has to wait for the one before it."""
        return drain.seconds_left() > self._ahead() * batch.expected_s + STOPPING_S

    def _walltime(self) -> WalltimeReached:
        done = f"{self.done:,} of {'at most ' if self.conversations else ''}{self.total:,}"
        return WalltimeReached(
            f"the walltime is near: {done} rows are finished and kept; run the same command again to go on",
            worked=self.had_workers and time.monotonic() - self.came > drain.walltime_s() / 4,
        )

    def _next_batch(self, slots: int, running: int) -> tuple[_Source, Batch]:
        """From the tables in turn."""
        while not self.sources[self.turn % len(self.sources)].left:
            self.turn += 1
        source = self.sources[self.turn % len(self.sources)]
        self.turn += 1
        size = source.batch_size(slots, self.policy.batch_s, self.left, running)
        return source, source.take(size, self.policy.retries)

    def _collect(self, future: Any, source: _Source, batch: Batch) -> list[tuple[_Source, Batch]]:
        """Take note of a finished batch; returns what must be tried again because workers died of it, or with it."""
        try:
            if future.status != "finished":  # to ask a worker for nothing would cost more than all else here
                future.result()
            self._note(source, batch)
        except KilledWorker:
            if is_whole(batch.segment):
                self._note(source, batch)
            elif batch.apart < TRIES_APART:
                apart = batch.rows_apart()
                for row in apart:
                    row.expected_s = source.expected_s(1)
                return [(source, row) for row in apart]
            elif source.open:
                raise ClusterError(
                    f"row {batch.rows[0]} has no outcome: every worker that took it was killed, though the row did not "
                    "kill its own process; do workers have enough memory? Run again, all other rows are kept"
                ) from None
            else:
                self.given_up.append(batch)
        except (CancelledError, CommClosedError) as error:
            lost = "the cluster was lost; run the same command again, finished rows are kept"
            raise ClusterError(lost) from error
        except OSError as error:
            raise _named(error, batch) from error
        return []

    def _note(self, source: _Source, batch: Batch) -> None:
        failed = source.note(batch)
        if not self.conversations:
            self.done += batch.rows.size
            self.failed += failed
            self._tell()
        for conversation in self.conversations.values():
            if source in conversation.sources:
                self._answer(conversation)

    def _tell(self) -> None:
        if self.report is not None:
            self.report(self.done, self.failed, self.rows_running)


def _hand_back(future: Any, message: _Message) -> None:
    """The result of a computation, to the desk that waits for it."""
    assert message.answer is not None
    try:
        message.answer.put(future.result())
    except (CancelledError, CommClosedError) as error:
        raise ClusterError("the cluster was lost; run the same command again, finished rows are kept") from error
    except Exception as error:  # noqa: BLE001 - whatever it is, the talk that asked for it has to hear it
        message.answer.put(error)


def _named(error: OSError, batch: Batch) -> StoreError:
    """What the disk did to a batch, in words for a person."""
    return StoreError(f"{error.filename or batch.segment.parent}: {of_the_system(error)}")


def _register(client: Client, plugin: Any) -> None:
    """Bring a plugin to the workers. One that dies meanwhile gets it when it is back; ask again."""
    for attempt in range(5):
        try:
            client.register_plugin(plugin, name=plugin.name)
            return
        except LOST as error:
            if attempt == 4:
                words = f"the cluster's workers do not answer ({error}); run the same command again"
                raise ClusterError(words) from error
            time.sleep(ASK_AGAIN_S)


def failures(table: Table, rows: Iterable[int]) -> dict[str, int]:
    """How many of ``rows`` failed, by status."""
    status = table.status[np.fromiter(rows, dtype=np.int64)]
    return {name: int((status == i).sum()) for i, name in enumerate(STATUSES) if i and (status == i).any()}
