"""Who writes on the terminal: the main process alone. What workers print at their end would hide what the run says."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sinew.runner.files import append_file


@contextmanager
def children_write_to(path: Path) -> Iterator[None]:
    """Processes started in this block write their errors to a file; this one goes on with the terminal.

    A child that has just begun when this process is killed would print a traceback, and so would the process of
    Python's own that keeps count of semaphores. Both inherit the second file descriptor, so this one takes another.
    """
    sys.stderr.flush()
    terminal = os.dup(2)
    before = sys.stderr
    try:
        with append_file(path) as file:
            os.dup2(file.fileno(), 2)
        if _is_second(before):
            kind = before.encoding, before.errors
            sys.stderr = os.fdopen(os.dup(terminal), "w", 1, *kind)
        yield
    finally:
        if sys.stderr is not before and _is_second(before):
            sys.stderr.close()
            sys.stderr = before
        os.dup2(terminal, 2)
        os.close(terminal)


def _is_second(stream: object) -> bool:
    """Whether a stream writes to the second descriptor; those of notebooks and tests may not."""
    try:
        return stream.fileno() == 2  # type: ignore[attr-defined]
    except (AttributeError, OSError, ValueError):
        return False
