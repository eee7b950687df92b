"""Evaluate a batch in its own process, to find out whether a row kills the process that evaluates it.

A worker may die because of its row, or because of a preemption, a full node or a person. When several workers died with
a batch, each of its rows is tried again in a child process of a worker. If the child dies while the worker lives, the
row is to blame.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cloudpickle

from sinew.runner.evaluation import external
from sinew.runner.temporary import temporary_folder

_NO_LIMIT_S = 10.0 * 365 * 86_400


def run_apart(work: Callable[[], Any]) -> str | None:
    """Call ``work`` in a new process; returns how that process died, or None if it ended normally.

    ``work`` must write its results to files; its return value is lost. Raises the ``OSError`` that ``work`` raised.
    """
    with temporary_folder() as folder:
        # pickled for the child, in a folder that nobody else can enter
        (folder / "work").write_bytes(cloudpickle.dumps(work))
        paths = os.pathsep.join(path for path in sys.path if path)
        finished = external.run(
            [sys.executable, "-m", "sinew.runner.evaluation.isolation", "work", "error"],
            folder,
            timeout_s=_NO_LIMIT_S,
            environment={"PYTHONPATH": paths},
        )
        error = folder / "error"
        if error.exists():
            number, text, name = json.loads(error.read_text("utf-8"))
            raise OSError(number, text, name)
    if finished.returncode == 0:
        return None
    how = finished.killed_by or f"exit code {finished.returncode}"
    words = finished.output.strip().splitlines()
    return f"{how}{f': {words[-1][:200]}' if words else ''}"


def _main(work: str, error: str) -> None:
    try:
        cloudpickle.loads(Path(work).read_bytes())()
    except OSError as raised:
        facts = (raised.errno, raised.strerror, str(raised.filename) if raised.filename else None)
        Path(error).write_text(json.dumps(facts), "utf-8")


if __name__ == "__main__":
    _main(*sys.argv[1:])
