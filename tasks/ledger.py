"""What was expensive to decide, kept beside the store, so that a run that starts anew need not decide it again."""

import json
from pathlib import Path

import numpy as np

from tasks.simulate import Array


class Ledger:
    """Arrays of numbers by position, one line of JSON each, for one set of inputs.

    A file for other inputs is begun anew; a line that was cut short, and all that follow it, do not count.
    """

    def __init__(self, path: Path, inputs: str) -> None:
        self.path = path
        self.kept: list[Array] = []
        lines = path.read_bytes().splitlines(keepends=True) if path.is_file() else []
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
        """Keep ``numbers`` ``[n]`` at the next position."""
        self.kept.append(numbers)
        with self.path.open("ab") as file:
            file.write(json.dumps(numbers.tolist()).encode() + b"\n")


def _numbers(line: bytes) -> Array | None:
    try:
        numbers = np.array(json.loads(line), dtype=np.float64)
    except (ValueError, TypeError, RecursionError):
        return None
    return numbers if line.endswith(b"\n") and numbers.ndim == 1 and np.isfinite(numbers).all() else None
