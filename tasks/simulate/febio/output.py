"""What the solver logs: which quantities, and reading them from its log files."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from sinew.runner.files import NotReadable, read_regular
from sinew.tasks.simulate import Array, Output
from sinew.tasks.simulate.row_by_row import Failed

Reduce = Literal["single", "sum", "mean", "max", "min"]
_REDUCE: dict[str, Callable[..., Array]] = {
    "single": np.sum,
    "sum": np.sum,
    "mean": np.mean,
    "max": np.max,
    "min": np.min,
}


@dataclass(frozen=True)
class Logged(Output):
    """An output of the solver's log: ``item`` of ``data`` for some ``ids`` or a named ``set``, reduced to one number.

    The number is multiplied by ``scale``. ``at_rest`` is its value at time 0, which the solver does not log.
    """

    data: Literal["node_data", "element_data", "rigid_body_data"] = "node_data"
    item: str = ""
    ids: tuple[int, ...] = ()
    set: str | None = None
    reduce: Reduce = "single"
    scale: float = 1.0
    at_rest: float = 0.0


def what_of(output: Logged) -> str:
    """What an output is, whatever it is called: equal texts are equal numbers of the same run."""
    numbers = [output.data, output.item, output.ids, output.set, output.reduce, output.scale, output.at_rest]
    return json.dumps(numbers)


def slack(end_s: float) -> float:
    """The largest difference between two times that count as equal (s): FEBio logs at most nine digits."""
    return 1e-7 * max(1.0, end_s)


def read_output(path: Path, output: Logged, max_bytes: int, end_s: float) -> tuple[Array, Array]:
    """Times ``[t]`` (s, increasing, up to ``end_s``) and values ``[t]`` of an output that sinew added to the log.

    The solver may have stopped at other times than it was asked to. Raises :class:`Failed` unless the file is complete.
    """
    found, table = _records(path, output, max_bytes)
    if table.shape[1] != 2:
        raise Failed("bad_output", f"{output.name}: {found.size} steps of {table.shape[1]} numbers a line, not 2")
    if not (np.isfinite(found).all() and (np.diff(found) > 0).all() and found[0] >= 0):
        raise Failed("bad_output", f"{output.name}: times do not increase")
    if found[-1] < end_s - slack(end_s):
        raise Failed("bad_output", f"{output.name} ends at {found[-1]:g} s, the protocol at {end_s:g} s")
    ids = table[:, 0].reshape(found.size, -1)
    once = np.unique(ids[0])
    if once.size != ids.shape[1]:
        raise Failed("bad_output", f"{output.name}: {ids.shape[1]} lines a step, of {once.size} ids")
    if not (ids == ids[0]).all() or (output.ids and set(once) != set(output.ids)):
        raise Failed("bad_output", f"{output.name}: logged for other ids than asked")
    return found, _reduced(output, found, table)


def read_output_at(path: Path, output: Logged, max_bytes: int, times: Array) -> Array:
    """Values ``[t]`` of an output that the template itself logs, at exactly the asked ``times`` ``[t]`` (s).

    The last number of each line counts. Raises :class:`Failed` unless every step is there, at its time.
    """
    found, table = _records(path, output, max_bytes)
    if found.size != times.size:
        raise Failed("bad_output", f"{output.name}: {path.name} holds {found.size} of {times.size} steps")
    late = np.flatnonzero(~(np.abs(found - times) <= slack(float(times[-1]))))
    if late.size:
        i = int(late[0])
        raise Failed("bad_output", f"{output.name}: step {i + 1} is at {found[i]:g} s, not at {times[i]:g} s")
    return _reduced(output, found, table)


def _reduced(output: Logged, times: Array, table: Array) -> Array:
    return reduced(output.name, output.reduce, output.scale, times, table[:, -1].reshape(times.size, -1))


def reduced(name: str, how: Reduce, scale: float, times: Array, values: Array) -> Array:
    """``scale`` times the ``values`` ``[t, n]`` of the output ``name``, reduced to ``[t]``.

    Raises :class:`Failed` for what is not finite, and for several values where there is to be a single one.
    """
    if how == "single" and values.shape[1] != 1:
        raise Failed("bad_output", f"{name}: {values.shape[1]} values a step in place of a single one")
    with np.errstate(over="ignore", invalid="ignore"):
        total = scale * _REDUCE[how](values, axis=1)
    if not np.isfinite(total).all():
        at = times[np.flatnonzero(~np.isfinite(total))[0]]
        raise Failed("bad_output", f"{name} is not finite at {at:g} s")
    return np.asarray(total)


def _records(path: Path, output: Logged, max_bytes: int) -> tuple[Array, Array]:
    """Times ``[t]`` (s) and all lines of numbers ``[lines, columns]``, equally many for each time."""
    try:
        times, table, even = read_records(path, max_bytes)
    except Failed as failed:
        raise Failed(failed.status, f"{output.name}: {failed.words}") from None
    if not times.size or not even or not len(table) or len(table) % times.size:
        raise Failed("bad_output", f"{output.name}: {path.name} holds {times.size} steps and {len(table)} lines")
    return times, table


def read_records(path: Path, max_bytes: int) -> tuple[Array, Array, bool]:
    """What the solver logged: times ``[t]`` (s), all lines of numbers ``[lines, columns]``, and whether every step has
    equally many lines. Raises :class:`Failed`.
    """
    try:
        content = read_regular(path, min(max_bytes, MAX_TEXT_BYTES))
    except FileNotFoundError:
        raise Failed("bad_output", f"the solver wrote no {path.name}") from None
    except NotReadable as odd:
        raise Failed("bad_output", f"{path.name} is {odd}") from None
    except OSError as error:
        raise Failed("bad_output", f"{path.name} cannot be read ({error.strerror})") from None
    if not content.isascii():
        raise Failed("bad_output", f"{path.name} is not text")
    content = content.replace(b"\r\n", b"\n") if b"\r" in content else content
    if content and not content.endswith(b"\n"):
        raise Failed("bad_output", f"{path.name} ends in the middle of a line")
    _check_size(path, content)
    # whole-text operations: a loop over the lines of a long run takes as long as some solver runs
    letters, starts = _lines(content)
    ends = np.append(starts[1:], letters.size) - 1
    if letters.size and np.isin(letters[ends - 1], _ENDS_BLANK).any():
        content = _BLANK.sub(b"", content)
        letters, starts = _lines(content)
    comments = letters[starts] == _STAR
    if np.count_nonzero(letters == _STAR) != comments.sum() and _LATE_COMMENT.search(content):
        raise Failed("bad_output", f"{path.name} holds something else than numbers ('*' behind a number)")
    records = _numbers_of_steps(content, starts, comments)
    try:
        found = np.array([float(stamp) for stamp in _STAMP.findall(content)])
        table = pd.read_csv(BytesIO(content), comment="*", header=None, dtype=np.float64).to_numpy()
    except pd.errors.EmptyDataError:
        table = np.zeros((0, 1))
    except ValueError as error:
        raise Failed("bad_output", f"{path.name} holds something else than numbers ({error})") from None
    even = records.size == found.size > 0 and np.ptp(records) == 0 and records.sum() == len(table)
    return found, table, bool(even)


def _lines(content: bytes) -> tuple[Array, Array]:
    """The letters of a text whose last line ends, and where each of its lines starts."""
    letters = np.frombuffer(content, dtype=np.uint8)
    starts = np.append(0, np.flatnonzero(letters == _NEWLINE)[:-1] + 1) if content else np.empty(0, dtype=int)
    return letters, starts


def _numbers_of_steps(content: bytes, starts: Array, comments: Array) -> Array:
    """How many lines of numbers each step has ``[t]``, of lines that start at ``starts`` and may be ``comments``."""
    numbers = np.append(0, np.cumsum(~comments))
    steps = [match.start() for match in re.finditer(rb"\*Step", content)]
    ends = numbers[np.searchsorted(starts, [*steps[1:], len(content)])]
    return np.asarray(ends - numbers[np.searchsorted(starts, steps)])


def _check_size(path: Path, content: bytes) -> None:
    """Refuse what would fill the memory: pandas makes as many columns as the first line has. Raises :class:`Failed`."""
    if b"\r" in content or b'"' in content:
        raise Failed("bad_output", f"{path.name} holds a quotation mark, or half a line end")
    first = _NUMBERS.search(content)
    start, end = first.span() if first is not None else (0, 0)
    columns, steps = content.count(b",", start, end) + 1, max(content.count(b"*Step"), content.count(b"*Time"))
    if end - start > LONGEST_LINE or columns * content.count(b"\n") > MAX_NUMBERS or steps > MAX_STEPS:
        raise Failed("bad_output", f"{path.name} holds too many numbers")


MAX_TEXT_BYTES = 2**28  # of numbers that are logged; plot files may be larger
LONGEST_LINE, MAX_NUMBERS, MAX_STEPS = 10_000, 2**25, 10**6
_NEWLINE, _STAR, _ENDS_BLANK = ord("\n"), ord("*"), tuple(b"\n \t")
_NUMBERS = re.compile(rb"^[ \t]*+[^*\s][^\n]*+$", re.MULTILINE)  # a line that is neither blank nor a comment
_LATE_COMMENT = re.compile(rb"^[ \t]*+[^*\s][^\n*]*+\*", re.MULTILINE)  # pandas would leave out what follows
_BLANK = re.compile(rb"^[ \t]*+\n", re.MULTILINE)
_STAMP = re.compile(rb"^\*Time\s*=\s*(\S+)$", re.MULTILINE)
