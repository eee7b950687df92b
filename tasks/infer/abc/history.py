"""pyABC's history of an inference: in memory while it grows, in a file once it is complete.

On disk, pyABC opens its database anew for each of some twenty queries at the end of a generation and waits for the
disk, while no proposal can be drawn. An interrupted run begins its history anew, so nothing is lost.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

import pyabc
import pyabc.storage.history

IN_MEMORY = "sqlite://"

# pyABC asks Git for the commit of the current folder, and the settings of a repository there may name programs
pyabc.storage.history.git_hash = str

#: What pyABC notes of the run, not of its outcome: when and how long.
TIMELESS = """
    UPDATE abc_smc SET start_time = '1970-01-01 00:00:00.000000', end_time = '1970-01-01 00:00:00.000000';
    UPDATE populations SET population_end_time = '1970-01-01 00:00:00.000000', wall_time = NULL;
    VACUUM;
"""


def keep(history: pyabc.History, path: Path) -> None:
    """Write a history in memory to the file ``path``, whole or not at all; equal histories give equal bytes."""
    partial = path.with_name(f".{path.name}.partial")
    partial.unlink(missing_ok=True)
    with closing(sqlite3.connect(partial)) as file:
        history._engine.raw_connection().driver_connection.backup(file)
        file.executescript(TIMELESS)
    partial.replace(path)


def close(history: pyabc.History) -> None:
    """Discard a history in memory; call it in the thread that made the history."""
    history._session.close()
    history._engine.dispose()
