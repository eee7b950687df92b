"""The lock of a result folder: one process at a time may write."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sinew.runner.cluster.batch_systems import this_process
from sinew.runner.errors import StoreError


@contextmanager
def lock(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; the system releases it when the process ends, however it ends. Raises ``StoreError``."""
    try:
        descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except PermissionError:
        raise StoreError(f"{folder}: cannot be written to; expected a folder of yours") from None
    except OSError as error:
        raise StoreError(f"{folder / 'lock'}: {error.strerror}; it must be a regular file") from None
    with open(descriptor, "r+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise StoreError(
                f"{folder}: in use by {file.read().strip() or 'another process'}; wait or stop it"
            ) from None
        file.seek(0)
        file.truncate()
        file.write(f"{this_process()}\n")
        file.flush()
        yield
