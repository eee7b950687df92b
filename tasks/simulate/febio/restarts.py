"""A long run of the solver goes on where it was interrupted.

The solver dumps its state after a step that it has solved (``-dump=1``), each time into the same file: after every step
until it is known how long one takes, then less often (``-dump_stride``). Now and then this file is taken away, with
what was logged by then, and kept as a state of :mod:`sinew.tasks.simulate.febio.states`. A later run of the same input
by the same solver starts from there (``-r``), logs the steps that are missing, and both logs are joined. A state is
kept only once a later step was logged as well: steps that both logs have must agree. A solver that does not go on as it
would have gone is not believed, and its run starts over, once.
"""

import errno
import hashlib
import os
import re
import secrets
import stat
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sinew.runner.evaluation.interim import keep_until_written, note_kept
from sinew.runner.files import NotReadable, read_regular, what_is
from sinew.runner.secret import secret
from sinew.tasks.simulate.febio.output import MAX_TEXT_BYTES
from sinew.tasks.simulate.febio.states import State, read_state, write_state

LOG, PLOT = "model.log", "model.xplt"
WORTH = 20.0  # times as long as it took to keep a state: the least time until the next
OFTEN = 2.0  # dumps in the time after which a state is due
SAME = 1e-6  # of the largest number of a step: what two runs of the same input may differ by
_STEP = re.compile(rb"^(?=\*Step\b)", re.MULTILINE)
_TIME = re.compile(rb"^\*Time\s*=\s*(\S+)$", re.MULTILINE)
_seconds_per_step: dict[Path, float] = {}  # the longest of this process's runs, by the folder of their states


class NotTheSame(Exception):
    """A run that was taken up again does not go on as it did before it was interrupted."""


@dataclass
class Interim:
    """What is kept of one run in ``directory``, of whose files ``logs`` are read: in ``file``, every ``every_s``.

    ``before``: the state from which the run goes on, if it was interrupted. ``again``: it has started over before.
    ``name``: of the solver's dumps, which no template can know. They have at most ``max_bytes``.
    """

    directory: Path
    file: Path
    every_s: float
    max_bytes: int
    logs: Sequence[str]
    secret: bytes
    name: str = field(default_factory=lambda: secrets.token_hex(8))
    before: State | None = None
    again: bool = False
    began: float = field(default_factory=time.monotonic)
    due: float = 0.0
    taken: dict[str, int] | None = None  # by log, the step of the dump that was taken away, or at most one less
    stamp: int = 0

    def __post_init__(self) -> None:
        self.due = self.began + self.every_s

    @property
    def dump(self) -> Path:
        """Where the solver dumps its state."""
        return self.directory / f"{self.name}.dmp"

    @property
    def _taken(self) -> Path:
        return self.directory / f"{self.name}-taken.dmp"

    @property
    def start(self) -> Path:
        """The dump from which the run goes on; by its name, FEBio tells it from an input."""
        return self.directory / f"{self.name}-from.dmp"

    @property
    def options(self) -> tuple[str, ...]:
        """Options of the solver that make it dump its state, and go on from the one before."""
        known = _seconds_per_step.get(self.file.parent, 0.0 if self.before is None else self.before.step)
        stride = int(self.every_s / OFTEN / known) if known else 1
        going_on = () if self.before is None else ("-r", self.start.name, "-noappend", "-p", PLOT)
        return (*going_on, "-dump=1", self.dump.name, *((f"-dump_stride={stride}",) if stride > 1 else ()))

    @property
    def seconds(self) -> float:
        """How long the solver has run, before an interruption as well."""
        return (0.0 if self.before is None else self.before.seconds) + time.monotonic() - self.began

    def look(self) -> None:
        """Called while the solver runs: keep its state if one is due.

        A dump that is taken away is whole as soon as the solver has begun the next one, and a state is kept once a step
        behind it is logged. Raises :class:`NotTheSame`, and ``OSError``.
        """
        if time.monotonic() < self.due:
            return
        try:
            logs = {name: whole_steps(read_regular(self.directory / name, MAX_TEXT_BYTES)) for name in self.logs}
        except (FileNotFoundError, NotReadable):  # whoever reads it when the run has ended says what is wrong
            return
        steps = {name: len(_STEP.findall(content)) for name, content in logs.items()}
        if self.taken is None:
            if _is_file(self.dump):
                self.dump.rename(self._taken)
                self.taken = {name: count + 1 for name, count in steps.items()}  # its own step is logged behind it
        elif not _is_file(self.dump):
            self._look_again(self.taken, steps)
        elif all(steps[name] > count for name, count in self.taken.items()):
            self._keep(logs)

    def _look_again(self, taken: dict[str, int], steps: Mapping[str, int]) -> None:
        """Where the dump is no longer written, and no other has begun, its own step is the last that is logged."""
        try:
            stamp = os.lstat(self._taken).st_mtime_ns
        except OSError:
            return
        if stamp == self.stamp:
            taken.update({name: min(taken[name], count) for name, count in steps.items()})
        self.stamp = stamp

    def _keep(self, logs: Mapping[str, bytes]) -> None:
        begun = time.monotonic()
        self._note_pace()
        state = State(self._joined(logs), self.seconds, _seconds_per_step.get(self.file.parent, 0.0), again=self.again)
        try:
            write_state(self.file, self.secret, state, self._taken, self.max_bytes)
        except NotReadable:  # somebody has put something else there
            return
        note_kept()
        ended = time.monotonic()
        self.due, self.taken, self.stamp = ended + max(self.every_s, WORTH * (ended - begun)), None, 0

    def _note_pace(self) -> None:
        """Learn how long a step takes, from what the solver says in its log."""
        try:
            steps = read_regular(self.directory / LOG, MAX_TEXT_BYTES).count(b"converged at time")
        except (OSError, NotReadable):
            return
        if steps:
            pace = (time.monotonic() - self.began) / steps
            _seconds_per_step[self.file.parent] = max(pace, _seconds_per_step.get(self.file.parent, 0.0))

    def join(self) -> None:
        """Put the whole logs into the directory of a run that has ended, and keep them if it took long.

        Raises :class:`NotTheSame`, and ``OSError``.
        """
        self._note_pace()
        try:
            logs = self._joined({name: read_regular(self.directory / name, MAX_TEXT_BYTES) for name in self.logs})
        except (FileNotFoundError, NotReadable) as kind:
            if self.before is None:  # whoever reads it says what is wrong
                return
            raise NotTheSame(f"a log is {kind}") from None
        if self.before is not None:
            for name, content in logs.items():
                (self.directory / name).write_bytes(content)
        if self.seconds >= self.every_s:
            state = State(logs, self.seconds, ended=True)
            write_state(self.file, self.secret, state, None, self.max_bytes)

    def restore(self) -> bool:
        """Whether the run had ended before; its logs are in the directory then."""
        if self.before is None or not self.before.ended:
            return False
        for name in self.logs:
            (self.directory / name).write_bytes(self.before.logs[name])
        return True

    def start_over(self) -> None:
        """Remember that the run could not go on, so that it is not tried without end. Raises ``OSError``."""
        write_state(self.file, self.secret, State({}, 0.0, again=True), None, self.max_bytes)

    def remove_dumps(self) -> None:
        """Dumps are large, and of no use once the run has ended."""
        for path in (self.dump, self._taken, self.start):
            path.unlink(missing_ok=True)

    def _joined(self, logs: Mapping[str, bytes]) -> dict[str, bytes]:
        if self.before is None:
            return dict(logs)
        return {name: joined(self.before.logs[name], later) for name, later in logs.items()}


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
    of = repr((sorted(solver.items()), list(logs))).encode() + b"\0" + input_text
    file = folder / f"{hashlib.blake2b(of, digest_size=16).hexdigest()}.state"
    if not keep_until_written(file):
        return None
    with suppress(FileExistsError):
        folder.mkdir(parents=True, exist_ok=True)
    if not stat.S_ISDIR(mode := os.lstat(folder).st_mode):
        kind = "a regular file" if stat.S_ISREG(mode) else what_is(mode)
        raise OSError(errno.ENOTDIR, f"is {kind}; remove it, it must be a folder", str(folder))
    interim = Interim(directory, file, every_s, max_bytes, logs, secret())
    before = read_state(file, interim.secret, interim.start, max_bytes + len(logs) * 2 * MAX_TEXT_BYTES)
    if before is not None:
        interim.again = before.again
        interim.before = before if before.ended or _is_file(interim.start) else None
    return interim


def _is_file(path: Path) -> bool:
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:
        return False


def whole_steps(content: bytes) -> bytes:
    """What a solver has logged, without a last step that it is still writing."""
    steps = _STEP.split(content)
    if len(steps) > 1 and (not content.endswith(b"\n") or steps[-1].count(b"\n") < steps[1].count(b"\n")):
        steps.pop()
    return b"".join(steps)


def joined(earlier: bytes, later: bytes) -> bytes:
    """The log of a run that went on: steps from the first of ``later`` on are its.

    Raises :class:`NotTheSame` where no step is in both, or one that should be is not, or is another; and for no log.
    """
    there, new = _by_time(earlier), _by_time(later)
    first, last = min(new, default=np.inf), max(new, default=-np.inf)
    both = [at for at in there if first <= at <= last]
    if not both:
        raise NotTheSame("no step is in both logs")
    for at in both:
        if at not in new or not _alike(there[at], new[at]):
            raise NotTheSame(f"other numbers at {at:g} s")
    return b"".join(step for at, step in there.items() if at < first) + later


def _by_time(content: bytes) -> dict[float, bytes]:
    found: dict[float, bytes] = {}
    for step in _STEP.split(content):
        if step:
            stamp = _TIME.search(step)
            try:
                at = float(stamp[1])  # type: ignore[index]
            except (TypeError, ValueError):
                raise NotTheSame("steps without their times") from None
            if at in found:
                raise NotTheSame(f"two steps at {at:g} s")
            found[at] = step
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
