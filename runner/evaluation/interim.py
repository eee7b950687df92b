"""Files that a batch keeps for the case of an interruption, until its outcomes are written."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

STATES = "states"  # the folder of solvers' states, in that of their runs

_count = 0
_kept: ContextVar[set[Path] | None] = ContextVar("kept", default=None)


@contextmanager
def kept_until_written() -> Iterator[None]:
    """A batch is evaluated and written inside; what it kept is removed at the end, unless it is interrupted."""
    files: set[Path] = set()
    token = _kept.set(files)
    try:
        yield
    finally:
        _kept.reset(token)
    for file in files:
        file.unlink(missing_ok=True)


def keep_until_written(file: Path) -> bool:
    """Have a file removed when the outcomes of this batch are written; False where there is no batch."""
    files = _kept.get()
    if files is None:
        return False
    files.add(file)
    return True


def note_kept() -> None:
    """Count that a state was kept, from which what is interrupted goes on."""
    global _count
    _count += 1


def kept_count() -> int:
    """How many states this process has kept."""
    return _count
