"""What no input may do: a traceback, more than 10 s of a processor, more than 1 GB, or more than one short line."""

import contextlib
import io
import os
import resource
import signal
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sinew.runner.errors import LONGEST, SinewError, brief
from sinew.tasks.simulate.febio.rendering.wrong import Wrong
from sinew.tasks.simulate.row_by_row import Failed
from tests.fuzz.targets import Target

SECONDS, BYTES = 10.0, 2**30  # of a processor: a busy machine takes longer by the clock
WALL_S = 120.0  # by the clock, for what waits instead of working
MENDABLE = (SinewError, Failed, Wrong, OSError)  # what the command turns into one line, or a failed row


class Broken(AssertionError):
    """An input did what none may do."""


class _Hangs(BaseException):
    """Raised where an input takes too long; nothing that is read takes it for an error of its own."""


def attempt(target: Target, name: str, content: bytes) -> None:
    """Read the files of a target with one of them damaged. Raises :class:`Broken`."""
    with written(target.files | {name: content}) as folder:
        try:
            with _bounds(), contextlib.redirect_stdout(io.StringIO()):
                target.read(folder, folder / name)
        except ExceptionGroup as group:
            for error in group.exceptions:
                _check(error)
        except _Hangs as hangs:
            raise Broken(str(hangs)) from hangs
        except Exception as error:
            _check(error)


@contextlib.contextmanager
def written(files: Mapping[str, bytes]) -> Iterator[Path]:
    """A folder with these files."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        yield Path(folder)


def _check(error: BaseException) -> None:
    if not isinstance(error, MENDABLE):
        raise Broken(f"a traceback: {error!r}"[:500]) from error
    line = brief(f"sinew: {' '.join(map(str, error.args)) or error}")
    if len(line) > LONGEST or not line.isprintable():
        raise Broken(f"no short line: {line!r}")


@contextlib.contextmanager
def _bounds() -> Iterator[None]:
    """Time and memory for what is done inside."""

    def hangs(number: int, _: Any) -> None:
        raise _Hangs(f"longer than {f'{WALL_S:g} s' if number == signal.SIGALRM else f'{SECONDS:g} s of a processor'}")

    timers = ((signal.SIGPROF, signal.ITIMER_PROF, SECONDS), (signal.SIGALRM, signal.ITIMER_REAL, WALL_S))
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    handlers = [signal.signal(number, hangs) for number, _, _ in timers]
    resource.setrlimit(resource.RLIMIT_AS, (_in_use() + BYTES, hard))
    before = [signal.setitimer(timer, seconds, 1.0) for _, timer, seconds in timers]
    try:
        yield
    finally:
        for (number, timer, _), handler, left in zip(timers, handlers, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)
            signal.setitimer(timer, *left)  # a test has a limit of its own
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _in_use() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
