"""Places in which studies may start. Starting takes processor time; most of what follows is waiting.

Tests in many processes of pytest wait side by side. If all of their studies started at once, they would spend a
walltime of one minute on imports.
"""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

PLACES = 2
FOLDER = "SINEW_TESTS_PLACES"  # the variable that names a folder which all processes of pytest share


@contextmanager
def a_place() -> Iterator[None]:
    """Hold one of the places; waits until one is free."""
    folder = Path(os.environ[FOLDER])
    with ExitStack() as stack:
        files = [stack.enter_context(open(folder / f"place-{number}", "w")) for number in range(PLACES)]
        while not any(_locked(file) for file in files):
            time.sleep(0.1)
        yield


def _locked(file: object) -> bool:
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
