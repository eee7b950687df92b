"""Checkpoints: expensive decisions, kept beside the store, so that an interrupted run need not repeat them."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.files import NotReadable, append_file, parse_json, read_regular, write_whole
from sinew.tasks.simulate import Array

MAX_BYTES = 2**26
MAX_LINES = 100_000
MOST = 1e15  # of a number: points are at most 1, losses are far below
ROUNDING = 1e-9


Possible = Callable[[Array], bool]  # of the numbers of a line


def in_unit_cube(points: Array) -> bool:
    """Whether numbers are on the unit cube, but for rounding."""
    return bool(((points >= -ROUNDING) & (points <= 1.0 + ROUNDING)).all())


def is_count(numbers: Array, most: int) -> bool:
    """Whether the first of ``numbers`` is a whole number from 0 to ``most``."""
    return bool(0 <= numbers[0] <= most and float(numbers[0]).is_integer())


class Checkpoint:
    """Arrays of numbers by position, one line of JSON each, that belong to one set of ``inputs``.

    A file of other inputs is begun anew. A line that was cut short, that has not ``width`` numbers (None: any), one
    that is huge, or numbers that are not ``possible``, is ignored, and so are all lines after it.
    """

    def __init__(self, path: Path, inputs: str, width: int | None = None, possible: Possible | None = None) -> None:
        self.path = path
        self.width = width
        self.kept: list[Array] = []
        head = json.dumps({"inputs": inputs}).encode() + b"\n"
        content = _content(path)
        begun = content.startswith(head)
        end = len(head) if begun else 0
        while begun and len(self.kept) < MAX_LINES and (after := content.find(b"\n", end) + 1):
            numbers = _numbers(content[end:after], width)
            if numbers is None or (possible is not None and not possible(numbers)):
                break
            self.kept.append(numbers)
            end = after
        if not begun or end < len(content):
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, head + content[len(head) : end])

    def __len__(self) -> int:
        return len(self.kept)

    def append(self, numbers: Array) -> None:
        """Write ``numbers`` ``[n]`` at the next position."""
        assert self.width in (None, numbers.size), "it would not be read again"
        self.kept.append(numbers)
        with append_file(self.path) as file:
            file.write(json.dumps(numbers.tolist()).encode() + b"\n")


def _content(path: Path) -> bytes:
    try:
        return read_regular(path, MAX_BYTES)
    except FileNotFoundError:
        return b""
    except NotReadable as problem:
        raise BadInput(path, str(problem), "a checkpoint; delete it, and it is made again") from None


def _numbers(line: bytes, width: int | None) -> Array | None:
    try:
        numbers = np.array(parse_json(line), dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None
    right = numbers.ndim == 1 and numbers.size > 0 and width in (None, numbers.size)
    return numbers if right and (np.abs(numbers) < MOST).all() else None
