"""Processes that look at a file which nobody has checked: how they are started, and their limits."""

import resource
import sys
from pathlib import Path

import sinew
from sinew.runner.confine import confine

# it imports nothing from the current folder; where sinew is not installed, it is found by its place, the last; threads
# of linear algebra, one for each core of a node, would reserve the memory that the process may have
START = (
    "import os, sys; os.environ['OPENBLAS_NUM_THREADS'] = '1'; "
    "sys.path.append(sys.argv.pop(1)); from {} import main; main()"
)


def command(module: str, *arguments: str) -> list[str]:
    """The command of a process of Python that calls ``main`` of a module of sinew, which reads ``arguments``."""
    place = Path(sinew.__file__).resolve().parents[1]
    return [sys.executable, "-I", "-c", START.format(module), str(place), *arguments]


def limit(memory_bytes: int, seconds: int) -> None:
    """Limit the memory and the processor time of this process, and let it leave no core and write no file.

    Threads that were started before can still write.
    """
    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, memory_bytes), (resource.RLIMIT_CPU, seconds)):
        hard = resource.getrlimit(kind)[1]
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)  # a limit of the shell may be lower
        resource.setrlimit(kind, (most, most))
    confine(())
