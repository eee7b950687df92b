"""PyABC's history of an inference, in memory while it grows and in a file once it is whole.

On a disk, pyABC opens its database anew for each of some twenty questions at the end of a generation, and waits for the
disk, while no proposal can be drawn. A run that is interrupted starts its history anew, so none of it is missed.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

import pyabc

IN_MEMORY = "sqlite://"


def keep(history: pyabc.History, path: Path) -> None:
    """Write a history that is in memory into the file ``path``, complete or not at all."""
    partial = path.with_name(f".{path.name}.partial")
    partial.unlink(missing_ok=True)
    with closing(sqlite3.connect(partial)) as file:
        history._engine.raw_connection().driver_connection.backup(file)
    partial.replace(path)


def close(history: pyabc.History) -> None:
    """Forget a history that is in memory; to be called in the thread that made it."""
    history._session.close()
    history._engine.dispose()
