"""A long run of the solver goes on where it was interrupted.

The solver dumps its state after a step that it has solved (``-dump=1``), each time into the same file: after every step
until it is known how long one takes, then less often (``-dump_stride``). Now and then this file is taken away, with
what was logged by then, and kept as a state of :mod:`sinew.tasks.simulate.febio.states`. A later run of the same input
by the same solver starts from there (``-r``), logs the steps that are missing, and both logs are joined. Steps that
both have must agree: a solver that does not go on as it would have gone is not believed, and its run starts over.
"""

import hashlib
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinew.runner.evaluation.interim import keep_until_written
from sinew.runner.files import NotReadable, read_regular
from sinew.runner.secret import secret
from sinew.tasks.simulate.febio.output import MAX_TEXT_BYTES
from sinew.tasks.simulate.febio.states import State, read_state, write_state

DUMP, TAKEN, FROM, PLOT = "state.dmp", "taken.dmp", "from.dmp", "model.xplt"
GO_ON = ("-r", FROM, "-noappend", "-p", PLOT)  # in place of its input
WORTH = 20.0  # times as long as it took to keep a state: the least time until the next
OFTEN = 2.0  # dumps in the time after which a state is due: the one before the last is kept
SAME = 1e-6  # of the largest number of a step: what two runs of the same input may differ by
_STEP = re.compile(rb"^(?=\*Step\b)", re.MULTILINE)
_STEPS = re.compile(r"Number of time steps completed \.* : (\d+)")
_TIME = re.compile(rb"^\*Time\s*=\s*(\S+)$", re.MULTILINE)


_seconds_per_step: dict[Path, float] = {}  # the longest of this process's runs, by the folder of their states


class NotTheSame(Exception):
    """A run that was taken up again does not go on as it did before it was interrupted."""


@dataclass
class Interim:
    """What is kept of one run in ``directory``, of whose files ``logs`` are read: in ``file``, every ``every_s``.

    ``before``: the state from which the run goes on, if it was interrupted.
    """

    directory: Path
    file: Path
    every_s: float
    logs: Sequence[str]
    secret: bytes
    before: State | None
    began: float = field(default_factory=time.monotonic)
    due: float = 0.0
    taken: bool = False

    def __post_init__(self) -> None:
        self.due = self.began + self.every_s

    @property
    def seconds(self) -> float:
        """How long the solver has run, before an interruption as well."""
        return (0.0 if self.before is None else self.before.seconds) + time.monotonic() - self.began

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the solver that make it dump its state."""
        stride = int(self.every_s / OFTEN / max(_seconds_per_step.get(self.file.parent, self.every_s), 1e-3))
        return ("-dump=1", DUMP, *((f"-dump_stride={stride}",) if stride > 1 else ()))

    def look(self) -> None:
        """Called while the solver runs: keep its state if one is due.

        A dump that is taken away is whole as soon as the solver has begun the next one. Raises :class:`NotTheSame`, and
        ``OSError``.
        """
        dump, taken = self.directory / DUMP, self.directory / TAKEN
        if not self.taken and time.monotonic() >= self.due and dump.exists():
            dump.rename(taken)
            self.taken = True
        elif self.taken and dump.exists():
            begun = time.monotonic()
            logs = {name: self._joined(name, whole_steps(self._logged(name))) for name in self.logs}
            write_state(self.file, self.secret, State(self.seconds, logs, ended=False), taken)
            ended = time.monotonic()
            self.due, self.taken = ended + max(self.every_s, WORTH * (ended - begun)), False

    def join(self, said: str) -> None:
        """Put the whole logs into the directory of a run that has ended, and keep them if it took long.

        ``said``: the end of what the solver says of itself, with the number of steps. Raises :class:`NotTheSame`, and
        ``OSError``.
        """
        logs = {name: self._joined(name, self._logged(name)) for name in self.logs}
        if self.before is not None:
            for name, content in logs.items():
                (self.directory / name).unlink(missing_ok=True)
                (self.directory / name).write_bytes(content)
        elif steps := _STEPS.findall(said):
            pace = (time.monotonic() - self.began) / max(int(steps[-1]), 1)
            _seconds_per_step[self.file.parent] = max(pace, _seconds_per_step.get(self.file.parent, 0.0))
        if self.seconds >= self.every_s:
            write_state(self.file, self.secret, State(self.seconds, logs, ended=True), None)

    def restore(self) -> bool:
        """Whether the run had ended before; its logs are in the directory then."""
        if self.before is None or not self.before.ended:
            return False
        for name in self.logs:
            (self.directory / name).write_bytes(self.before.logs[name])
        return True

    def _logged(self, name: str) -> bytes:
        try:
            return read_regular(self.directory / name, MAX_TEXT_BYTES)
        except (FileNotFoundError, NotReadable) as kind:
            if self.before is None or isinstance(kind, FileNotFoundError):  # whoever reads it says what is wrong
                return b""
            raise NotTheSame(f"{name} is {kind}") from None

    def _joined(self, name: str, later: bytes) -> bytes:
        return later if self.before is None else joined(self.before.logs[name], later)


def begun(
    folder: Path,
    every_s: float,
    max_bytes: int,
    directory: Path,
    logs: Sequence[str],
    input_text: bytes,
    solver: Mapping[str, str],
) -> Interim | None:
    """What to keep of the run of an input in ``directory``, and from where it goes on; None outside of a batch.

    ``folder`` holds the states of all runs, with dumps of at most ``max_bytes``; ``solver``: what makes it another one.
    Raises ``OSError``.
    """
    of = repr(sorted(solver.items())).encode() + b"\0" + input_text
    file = folder / f"{hashlib.blake2b(of, digest_size=16).hexdigest()}.state"
    if not keep_until_written(file):
        return None
    folder.mkdir(parents=True, exist_ok=True)
    mine = secret()
    before = read_state(file, mine, directory / FROM, max_bytes + MAX_TEXT_BYTES)
    if before is not None and set(before.logs) != set(logs):
        before = None
    return Interim(directory, file, every_s, logs, mine, before)


def whole_steps(content: bytes) -> bytes:
    """What a solver has logged, without a last step that it is still writing."""
    steps = _STEP.split(content)
    if len(steps) > 1 and (not content.endswith(b"\n") or steps[-1].count(b"\n") < steps[1].count(b"\n")):
        steps.pop()
    return b"".join(steps)


def joined(earlier: bytes, later: bytes) -> bytes:
    """The log of a run that went on: steps from the first of ``later`` on are its.

    Raises :class:`NotTheSame` where both have a step and differ in it, and for what is no log.
    """
    there, new = _by_time(earlier), _by_time(later)
    if not new:
        return earlier
    first = min(new)
    for at, step in there.items():
        if at >= first and at in new and not _alike(step, new[at]):
            raise NotTheSame(f"other numbers at {at:g} s")
    return b"".join(step for at, step in there.items() if at < first) + later


def _by_time(content: bytes) -> dict[float, bytes]:
    found = {}
    for step in _STEP.split(content):
        if step:
            stamp = _TIME.search(step)
            try:
                found[float(stamp[1])] = step  # type: ignore[index]
            except (TypeError, ValueError):
                raise NotTheSame("steps without their times") from None
    return found


def _alike(one: bytes, other: bytes) -> bool:
    try:
        here, there = (_numbers(step) for step in (one, other))
    except ValueError:
        return False
    return here.size == there.size and bool(
        np.allclose(here, there, rtol=SAME, atol=SAME * float(np.abs(here).max(initial=0.0)))
    )


def _numbers(step: bytes) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """The last numbers of the lines of a step."""
    lines = [line for line in step.splitlines() if line.strip() and not line.startswith(b"*")]
    return np.array([float(re.split(rb"[,\s]+", line.strip())[-1]) for line in lines])
