"""The rows of one table on their way through a run: pending, in batches, finished, committed, and known results."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinew.runner.evaluation.adaptive import RowResult
from sinew.runner.evaluation.batch import Batch, Evaluation
from sinew.runner.evaluation.batch_sizes import BatchSizes
from sinew.runner.store.schema import PENDING, Array
from sinew.runner.store.segment import Segment
from sinew.runner.store.table import Table

SEGMENTS_KEPT = 256  # of a chunk that adaptive runs still add rows to, before they are folded in


@dataclass(eq=False)
class Source:
    """One table in a run. ``open``: adaptive runs may ask for more of its rows."""

    table: Table
    evaluation: Evaluation
    key: str
    sizes: BatchSizes
    open: bool = False
    pending: Array = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    first: int = 0
    left_in_chunk: dict[int, int] = field(default_factory=dict)
    finished: dict[int, dict[Path, Segment]] = field(default_factory=dict)
    waiting: set[int] = field(default_factory=set)  # rows that a session has asked for and that have no outcome yet
    results: dict[int, RowResult] = field(default_factory=dict)
    known: dict[int, tuple[Array, dict[str, Array]]] = field(default_factory=dict)  # chunks read back
    fresh: dict[int, Path] = field(default_factory=dict)  # finished rows and their segments

    def put(self, rows: Array) -> None:
        """Add rows without an outcome."""
        self.pending = np.concatenate([self.pending[self.first :], rows])
        self.first = 0
        chunks, counts = np.unique(rows // self.table.chunk_rows, return_counts=True)
        for chunk, count in zip(chunks.tolist(), counts.tolist(), strict=True):
            self.left_in_chunk[chunk] = self.left_in_chunk.get(chunk, 0) + count

    @property
    def left(self) -> int:
        """The number of rows that are in no batch yet."""
        return self.pending.size - self.first

    def batch_size(self, slots: int, aim_s: float, left: int, running: int) -> int:
        """Rows of the next batch; ``left``, ``running``: rows of all tables that wait, and that workers have."""
        awaited = len(self.waiting) if self.open else None
        return self.sizes.next(slots, aim_s, left, running, self.table.chunk_rows, awaited)

    def take(self, size: int, retries: int) -> Batch:
        """The next batch: at most ``size`` rows, all of one chunk."""
        rows = self.pending[self.first : self.first + size]
        other = np.flatnonzero(rows // self.table.chunk_rows != rows[0] // self.table.chunk_rows)
        rows = rows[: other[0]] if other.size else rows  # so that it is known when a chunk is complete
        self.first += rows.size
        restarts = getattr(self.evaluation, "restarts", False)
        batch = Batch(self.key, rows, self.table.parameters(rows), self.table.journal, retries, restarts=restarts)
        batch.expected_s = 0.0 if restarts else self.sizes.expected_s(rows.size)
        return batch

    def note(self, batch: Batch) -> int:
        """Take in a batch whose segment is in the journal; returns how many of its rows failed."""
        segment = Segment.read(batch.segment, whole=self.open)
        self.sizes.measured(float(segment.wall_seconds.mean()))
        chunk = int(batch.rows[0]) // self.table.chunk_rows
        self.finished.setdefault(chunk, {})[batch.segment] = segment
        self.left_in_chunk[chunk] -= batch.rows.size
        if self.open:  # more rows of this chunk may come: it is written now and then
            self._take_results(segment, batch.segment)
            if len(self.finished[chunk]) >= SEGMENTS_KEPT:
                self._fold([chunk])
        return int((segment.status > 0).sum())

    def close(self) -> None:
        """Commit what is complete; no session will ask for more rows."""
        self.open = False
        self.commit()

    def commit(self, at_least: int = 1) -> None:
        """Commit the chunks that are complete, if there are ``at_least`` so many: each is written once."""
        if len(complete := self._complete()) >= at_least:
            self._fold(complete)

    def _complete(self) -> list[int]:
        """The chunks with all their rows finished and not committed yet."""
        return [chunk for chunk in self.finished if self.left_in_chunk[chunk] == 0]

    def _fold(self, chunks: list[int]) -> None:
        self.table.fold({path: segment for chunk in chunks for path, segment in self.finished.pop(chunk).items()})
        self.fresh = {row: path for row, path in self.fresh.items() if row // self.table.chunk_rows not in chunks}

    # ---- results for sessions

    def ask(self, parameters: Array) -> list[int]:
        """Plan rows for a session and look up those that are known; returns their numbers."""
        rows: list[int] = self.table.plan(parameters, settle=False).tolist()
        new = [row for row in dict.fromkeys(rows) if row not in self.waiting and not self._look_up(row)]
        if new:
            self.waiting.update(new)
            self.put(np.array(new, dtype=np.int64))
        return rows

    def _look_up(self, row: int) -> bool:
        """Whether the result of a row is known, and now in ``results``."""
        if row in self.results:
            return True
        if row in self.fresh:
            self._take_results(Segment.read(self.fresh[row], whole=True), self.fresh[row], only=row)
            return True
        if self.table.status[row] == PENDING:
            return False
        chunk, place = divmod(row, self.table.chunk_rows)
        if chunk not in self.known or self.known[chunk][0].size <= place:
            self._read_back(chunk)
        if self.known[chunk][0][place] == PENDING:
            self._read_back(chunk)
        status, values = self.known[chunk]
        self.results[row] = RowResult(int(status[place]), {name: array[place] for name, array in values.items()})
        return True

    def _read_back(self, chunk: int) -> None:
        rows = np.arange(chunk * self.table.chunk_rows, min((chunk + 1) * self.table.chunk_rows, self.table.settled))
        values = {name: self.table.read(name, rows) for name in self.table.fields}
        self.known = {chunk: (self.table.status[rows].copy(), values)}

    def _take_results(self, segment: Segment, path: Path, only: int | None = None) -> None:
        values = segment.values
        self.waiting.difference_update(segment.rows.tolist())
        for place, row in enumerate(segment.rows.tolist()):
            self.fresh[row] = path
            if only is None or row == only:
                status = int(segment.status[place])
                result = {n: values[n][place] if n in values else self.table.nothing(n) for n in self.table.fields}
                self.results[row] = RowResult(status, result)
