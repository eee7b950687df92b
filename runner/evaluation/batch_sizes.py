"""How many rows the next batch holds, from the run times measured so far."""

import math
import statistics
from collections import deque
from dataclasses import dataclass, field

from sinew.runner.cluster import drain

BATCHES_PER_S = 30  # takes a fifth of a scheduler's time
AWAITED_PER_S = 120  # at most, of batches that an adaptive run waits for; otherwise batches get longer
SHORTEST_S = 0.05  # unless an adaptive run waits: ever smaller parts of the last rows would cost more than they gain
AWAITED_S = 0.1  # duration of a batch that an adaptive run waits for: its results come all at once, at the end


@dataclass
class BatchSizes:
    """Run times of one table's rows, and the size of the next batch. Times in seconds."""

    multiple: int
    largest: int = 0
    seconds_per_row: deque[float] = field(default_factory=lambda: deque(maxlen=9))
    slowest: deque[float] = field(default_factory=lambda: deque(maxlen=200))

    def measured(self, seconds: float) -> None:
        """Note the mean run time of a batch's rows; NaN is ignored."""
        if math.isfinite(seconds):
            self.seconds_per_row.append(seconds)
            self.slowest.append(seconds)

    def expected_s(self, rows: int) -> float:
        """How long ``rows`` rows may take; 0 before anything was measured."""
        return drain.SAFETY * max(self.slowest) * rows if self.slowest else 0.0

    def next(self, slots: int, aim_s: float, left: int, running: int, limit: int, awaited: int | None) -> int:
        """Rows of the next batch for ``slots`` workers.

        ``left``, ``running``: rows of all tables that wait and that workers have; ``limit``: rows of a chunk;
        ``awaited``: rows that adaptive runs wait for, None where there are none.
        """
        size = self.largest = max(self.largest, self.multiple)
        if self.seconds_per_row:
            each = max(statistics.median(self.seconds_per_row), 1e-9)
            least, most = (aim_s, BATCHES_PER_S) if awaited is None else (min(aim_s, AWAITED_S), AWAITED_PER_S)
            size = int(max(least, slots / most) / each)
            size = min(size, 8 * self.largest)  # the first batches also load code
            queued = (awaited or 0) // (2 * slots)  # in a long queue, a longer batch delays no result
            size = max(size, min(queued, int(aim_s / each)))  # but its rows may be lost together
        fair = math.ceil((left if awaited is None else (left + running) / 2) / slots)
        if awaited is None and self.seconds_per_row:
            fair = max(fair, int(SHORTEST_S / each))
        size = min(size, limit, fair)  # all workers end at about the same time
        size = max(self.multiple, -(-size // self.multiple) * self.multiple)
        self.largest = max(self.largest, size)
        return size
