"""Errors of Zarr and of the system as one line that names the file."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sinew.runner.errors import StoreError, of_the_system

MAX_WORDS = 120
SHORTAGES = ("thread", "memory", "alloc")  # what libraries say when memory or threads are short


@contextmanager
def store_errors(path: Path) -> Iterator[None]:
    """Raise errors of Zarr and of the system as a ``StoreError`` that names ``path`` and says what to do."""
    with _errors(path, f"`sinew repair {_result_folder(path)}` makes its rows pending, all others stay"):
        yield


@contextmanager
def result_errors(path: Path) -> Iterator[None]:
    """As :func:`store_errors`, for the arrays of a task's result."""
    with _errors(path, "remove the .json of its task and run the study again, which makes it anew"):
        yield


@contextmanager
def _errors(path: Path, what_to_do: str) -> Iterator[None]:
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        inside = isinstance(error.filename, str) and Path(error.filename).is_relative_to(path)
        raise StoreError(f"{error.filename if inside else path}: {of_the_system(error)}") from error
    except Exception as error:  # what Zarr and its codecs raise for damaged files is no closed list
        if is_shortage(error):
            raise StoreError(f"{path}: cannot be read now, memory or threads are short ({words(error)})") from error
        raise StoreError(f"{path}: damaged ({words(error)}); {what_to_do}") from error


def is_shortage(error: Exception) -> bool:
    """Whether an error says that the system is short of something, not that a file is damaged."""
    if isinstance(error, OSError):
        return error.errno in (errno.ENOMEM, errno.EAGAIN, errno.EMFILE, errno.ENFILE)
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and any(word in str(error).lower() for word in SHORTAGES)
    )


def words(error: Exception) -> str:
    """What an error says, in one short line."""
    return (str(error).splitlines() or [type(error).__name__])[0][:MAX_WORDS]


def _result_folder(path: Path) -> Path:
    for parent in (path, *path.parents):
        if parent.name in ("store.zarr", "journal"):
            return parent.parent
    return path
