"""One call of :func:`evaluate` or :func:`run_adaptive` in progress: its tables, its sessions and its next batch."""

import logging
import secrets
import time
from dataclasses import dataclass, field

from sinew.runner.cluster import drain
from sinew.runner.errors import StoreError, WalltimeReached, of_the_system
from sinew.runner.evaluation.batch import Batch, Evaluation
from sinew.runner.evaluation.batch_sizes import BatchSizes
from sinew.runner.evaluation.counts import Counts
from sinew.runner.evaluation.policy import Policy
from sinew.runner.evaluation.sessions import Sessions
from sinew.runner.evaluation.source import Source
from sinew.runner.store.table import Table

log = logging.getLogger("sinew")

ONE_AHEAD_S = 5.0  # a worker gets its next batch early, unless batches take longer than this
STOPPING_S = 10.0  # for closing the cluster before the deadline of the process that leads it


@dataclass
class Run:
    """The state of a run, whether it works in this process or on a cluster."""

    policy: Policy
    counts: Counts
    sessions: Sessions
    sources: list[Source] = field(default_factory=list)
    name: str = field(default_factory=lambda: secrets.token_hex(4))  # another run may share the scheduler
    had_workers: bool = True
    began: float = field(default_factory=time.monotonic)
    turn: int = 0

    def add(self, table: Table, evaluation: Evaluation) -> Source:
        """Add a table whose rows are evaluated by ``evaluation``."""
        source = Source(table, evaluation, f"{table.key}-{self.name}", BatchSizes(self.policy.multiple))
        table.journal.mkdir(parents=True, exist_ok=True)
        self.sources.append(source)
        return source

    @property
    def left(self) -> int:
        """The number of rows that are in no batch yet."""
        return sum(source.left for source in self.sources)

    def next_batch(self, slots: int, running: int) -> tuple[Source, Batch]:
        """The next batch; tables take turns."""
        while not self.sources[self.turn % len(self.sources)].left:
            self.turn += 1
        source = self.sources[self.turn % len(self.sources)]
        self.turn += 1
        size = source.batch_size(slots, self.policy.batch_s, self.left, running)
        return source, source.take(size, self.policy.retries)

    def note(self, source: Source, batch: Batch) -> None:
        """Take in a finished batch."""
        failed = source.note(batch)
        if self.sessions:
            self.sessions.tell_of(source)
        else:
            self.counts.done += batch.rows.size
            self.counts.failed += failed
            self.counts.show()

    def commit(self) -> None:
        """Commit what is complete: no batch is left."""
        for source in self.sources:
            source.commit()

    def commit_many(self) -> None:
        """Commit what is complete of tables that have so much that writing it together pays."""
        for source in self.sources:
            if not source.open:
                source.commit(source.table.fold_chunks)

    def sync(self) -> None:
        """Bring finished rows to the disk, in a thread of its own. A disk that cannot is noticed by who writes."""
        for source in list(self.sources):
            try:
                source.table.sync()
            except StoreError as error:
                log.warning("sync", extra={"error": str(error)})

    def ahead(self) -> int:
        """How many batches a worker may have: a batch that waits on one cannot go to another that becomes free."""
        sizes = [source.sizes for source in self.sources]
        short = all(not each.slowest or each.expected_s(each.largest) < ONE_AHEAD_S for each in sizes)
        return self.policy.batches_per_worker if short else 1

    def in_time(self, batch: Batch) -> bool:
        """Whether a batch ends before this process must, even if it has to wait for another one."""
        return drain.seconds_left() > self.ahead() * batch.expected_s + STOPPING_S

    def walltime_reached(self) -> WalltimeReached:
        """The error for a walltime that is near."""
        done = f"{self.counts.done:,} of {'at most ' if self.sessions else ''}{self.counts.total:,}"
        return WalltimeReached(
            f"the walltime is near: {done} rows are finished and kept; run the same command again to go on",
            worked=self.had_workers and time.monotonic() - self.began > drain.walltime_s() / 4,
        )


def store_error(error: OSError, batch: Batch) -> StoreError:
    """An error of the disk while a batch was written, in one line."""
    return StoreError(f"{error.filename or batch.segment.parent}: {of_the_system(error)}")
