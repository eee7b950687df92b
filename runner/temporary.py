"""Temporary folders that do not stay behind: those of a process that was killed are removed by the next one."""

import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PREFIX = "sinew-temporary-"


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A new folder that only this user can enter, removed at the end. Raises ``OSError``.

    It is locked as long as this process lives, so that others can tell whether it was left behind.
    """
    _remove_abandoned()
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX))
        if (lock := _lock(folder)) is not None:
            break
    try:
        yield folder
    finally:
        shutil.rmtree(folder)
        os.close(lock)


def _remove_abandoned() -> None:
    """Remove this user's folders that nobody has locked."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with suppress(OSError):  # it is gone, or somebody else's
            seen = folder.lstat()
            if stat.S_ISDIR(seen.st_mode) and seen.st_uid == os.geteuid() and (lock := _lock(folder)) is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _lock(folder: Path) -> int | None:
    """The descriptor of a folder that is locked from now on; None if somebody else has locked or removed it."""
    try:
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(lock).st_nlink:  # it was not removed between both calls
            return lock
    except BlockingIOError:
        pass
    os.close(lock)
    return None
