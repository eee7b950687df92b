"""What no input may do: end in a traceback, take more than 10 s or 1 GB, or say more than one short line."""

import contextlib
import io
import os
import resource
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sinew.runner.errors import LONGEST, SinewError, brief
from sinew.tasks.simulate.febio.attempt import Failed
from sinew.tasks.simulate.febio.rendering import Wrong
from tests.fuzz.targets import Target

SECONDS, BYTES = 10, 2**30
SLOWER = 3  # a busy machine gives a process a third of a core
MENDABLE = (SinewError, Failed, Wrong, OSError)  # what the command turns into one line, or a failed row


class Broken(AssertionError):
    """An input did what none may do."""


def attempt(target: Target, name: str, content: bytes) -> None:
    """Read the files of a target with one of them damaged. Raises :class:`Broken`."""
    with tempfile.TemporaryDirectory() as folder:
        for other, valid in target.files.items():
            path = Path(folder, other)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content if other == name else valid)
        try:
            with _bounds(), contextlib.redirect_stdout(io.StringIO()):
                target.read(Path(folder), Path(folder, name))
        except ExceptionGroup as group:
            for error in group.exceptions:
                _check(error)
        except Exception as error:
            _check(error)


def _check(error: BaseException) -> None:
    if not isinstance(error, MENDABLE):
        raise Broken(f"a traceback: {error!r}"[:500]) from error
    line = brief(f"sinew: {' '.join(map(str, error.args)) or error}")
    if len(line) > LONGEST or not line.isprintable():
        raise Broken(f"no short line: {line!r}")


@contextlib.contextmanager
def _bounds() -> Iterator[None]:
    """Time and memory for what is done inside."""

    def hangs(*_: Any) -> None:
        raise Broken(f"longer than {SECONDS} s")

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGALRM, hangs)
    resource.setrlimit(resource.RLIMIT_AS, (_in_use() + BYTES, hard))
    signal.setitimer(signal.ITIMER_REAL, SECONDS * SLOWER)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, handler)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _in_use() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
