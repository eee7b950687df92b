"""Evaluate a batch in a process of its own, so that its death convicts the batch and not the worker's machine.

A worker that dies may have been killed by its row, or by a preemption, a full node, a person. When a batch was on
several workers that died, its rows are tried again in a child of a worker: if the child dies while the worker lives,
it was the row.
"""

import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cloudpickle

from runner import external

_NO_LIMIT_S = 10.0 * 365 * 86_400


def run_apart(work: Callable[[], Any]) -> str | None:
    """Call ``work`` in a process of its own; returns how that process died, or None when it came to its end.

    What it returns is lost: ``work`` leaves its results in files. Raises the ``OSError`` that ``work`` raised.
    """
    with tempfile.TemporaryDirectory(prefix="sinew-") as folder:
        # from this process to its child, through a folder that nobody else can enter
        (Path(folder) / "work").write_bytes(cloudpickle.dumps(work))
        paths = os.pathsep.join(path for path in sys.path if path)
        finished = external.run(
            [sys.executable, "-m", "runner.isolation", "work", "error"],
            Path(folder),
            timeout_s=_NO_LIMIT_S,
            environment={"PYTHONPATH": paths},
        )
        error = Path(folder) / "error"
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
        told = (raised.errno, raised.strerror, str(raised.filename) if raised.filename else None)
        Path(error).write_text(json.dumps(told), "utf-8")


if __name__ == "__main__":
    _main(*sys.argv[1:])
