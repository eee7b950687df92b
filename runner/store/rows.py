"""Rows of parameters: their hashes, their grouping by chunk, and the index that finds a known row by its content."""

from collections.abc import Iterable, Iterator

import numpy as np
import pandas as pd

from sinew.runner.store.schema import Array


class RowIndex:
    """Finds rows by the hash of their parameters."""

    def __init__(self, hashes: Array, rows: Array) -> None:
        order = np.argsort(hashes, kind="stable")
        self._hashes, self._rows = hashes[order], rows[order]

    def find(self, hashes: Array) -> Array:
        """The row of each hash ``[n]``, -1 where there is none."""
        rows = np.full(len(hashes), -1, dtype=np.int64)
        if self._hashes.size == 0:
            return rows
        place = np.minimum(np.searchsorted(self._hashes, hashes), self._hashes.size - 1)
        known = self._hashes[place] == hashes
        rows[known] = self._rows[place[known]]
        return rows

    def add(self, hashes: Array, rows: Array) -> None:
        """Add new rows with their hashes."""
        order = np.argsort(hashes, kind="stable")
        place = np.searchsorted(self._hashes, hashes[order])
        self._hashes = np.insert(self._hashes, place, hashes[order])
        self._rows = np.insert(self._rows, place, rows[order])


def hash_rows(parameters: Array, block_rows: int) -> Array:
    """A hash ``[n]`` for each row of ``parameters`` ``[n, d]``; blocks of rows keep the memory flat."""
    hashes = np.empty(len(parameters), dtype=np.uint64)
    for block in slices(len(parameters), block_rows):
        numbers = np.asarray(parameters[block], dtype=np.float64) + 0.0  # -0.0 and 0.0 are the same number
        hashes[block] = pd.util.hash_pandas_object(pd.DataFrame(numbers), index=False).to_numpy()
    return hashes


def slices(count: int, size: int) -> Iterator[slice]:
    """Consecutive slices of ``size`` that cover ``count`` rows."""
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def by_chunk(rows: Array, chunk_rows: int) -> Iterator[Array]:
    """Positions in ``rows``, grouped by chunk."""
    if rows.size:
        order = np.argsort(rows // chunk_rows, kind="stable")
        cuts = np.flatnonzero(np.diff(rows[order] // chunk_rows)) + 1
        yield from np.split(order, cuts)


def spans(numbers: Iterable[int], most: int) -> list[tuple[int, int]]:
    """First and last of the runs of consecutive ``numbers``, which are sorted; a run has at most ``most``."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and number == found[-1][1] + 1 and number - found[-1][0] < most:
            found[-1] = (found[-1][0], number)
        else:
            found.append((number, number))
    return found
