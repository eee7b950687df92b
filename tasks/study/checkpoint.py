"""Checkpoints: expensive decisions, kept beside the store, so that an interrupted run need not repeat them."""

import json
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.files import NotReadable, read_regular
from sinew.tasks.simulate import Array

MAX_BYTES = 2**28


class Checkpoint:
    """Arrays of numbers by position, one line of JSON each, that belong to one set of ``inputs``.

    A file of other inputs is begun anew. A line that was cut short is ignored, and so are all lines after it.
    """

    def __init__(self, path: Path, inputs: str) -> None:
        self.path = path
        self.kept: list[Array] = []
        lines = _content(path).splitlines(keepends=True)
        head = json.dumps({"inputs": inputs}).encode() + b"\n"
        whole = head
        if lines and lines[0] == head:
            for line in lines[1:]:
                numbers = _numbers(line)
                if numbers is None:
                    break
                self.kept.append(numbers)
                whole += line
        if b"".join(lines) != whole:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(whole)

    def __len__(self) -> int:
        return len(self.kept)

    def append(self, numbers: Array) -> None:
        """Write ``numbers`` ``[n]`` at the next position."""
        self.kept.append(numbers)
        with self.path.open("ab") as file:
            file.write(json.dumps(numbers.tolist()).encode() + b"\n")


def _content(path: Path) -> bytes:
    try:
        return read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        return b""
    except NotReadable as problem:
        raise BadInput(path, str(problem), "a checkpoint; delete it, and it is made again") from None


def _numbers(line: bytes) -> Array | None:
    try:
        numbers = np.array(json.loads(line), dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
    return numbers if line.endswith(b"\n") and numbers.ndim == 1 and np.isfinite(numbers).all() else None
