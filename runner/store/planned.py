"""The journal of planned rows: rows that are not in the arrays yet survive a crash there."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sinew.runner.errors import StoreError
from sinew.runner.files import NotReadable, append_file, read_regular
from sinew.runner.store.damage import store_errors
from sinew.runner.store.durable import sync_file
from sinew.runner.store.schema import Array

CHECK_BYTES = 8
MAX_BYTES = 2**26


class PlannedRows:
    """A file with one record for each row: its number, its parameters, and a checksum of both."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def append(self, first: int, parameters: Array) -> None:
        """Add rows ``first``, ``first + 1``, ... with ``parameters`` ``[n, d]``."""
        with store_errors(self.path), self._opened() as file:
            for row, values in enumerate(parameters, first):
                record = np.int64(row).tobytes() + np.ascontiguousarray(values, dtype=np.float64).tobytes()
                file.write(record + _checksum(record))

    def _opened(self) -> BinaryIO:
        """The file, to append to it; its folder is made where it is not there yet."""
        try:
            return append_file(self.path)
        except FileNotFoundError:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            return append_file(self.path)

    def read(self, width: int) -> Iterator[tuple[int, Array]]:
        """The whole records: row numbers and parameters ``[width]``. Stops at the first damaged record."""
        content = self._content()
        size = 8 * (width + 1) + CHECK_BYTES
        for start in range(0, len(content) - size + 1, size):
            whole = content[start : start + size]
            record = whole[:-CHECK_BYTES]
            if _checksum(record) != whole[-CHECK_BYTES:]:
                return
            yield int(np.frombuffer(record[:8], dtype=np.int64)[0]), np.frombuffer(record[8:], dtype=np.float64)

    def _content(self) -> bytes:
        try:
            return read_regular(self.path, MAX_BYTES)
        except FileNotFoundError:
            return b""
        except NotReadable as problem:
            raise StoreError(f"{self.path}: {problem}; delete it, its rows are planned again") from None

    def sync(self) -> None:
        """Bring the records to the disk."""
        sync_file(self.path)

    def remove(self) -> None:
        self.path.unlink(missing_ok=True)


def _checksum(record: bytes) -> bytes:
    return hashlib.blake2b(record, digest_size=CHECK_BYTES).digest()
