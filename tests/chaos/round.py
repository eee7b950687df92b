"""A round: a study is started again and again under random signals until it finishes, and then looked at."""

import os
import random
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from tests.chaos.comparison import differences
from tests.chaos.ledger import Ledger
from tests.chaos.victims import MARK, Victims

BETWEEN_S = 0.4  # signals, on average
LOOK_EVERY = 10  # signals
GONE_S = 20.0  # for processes of a run that has ended
STUCK_S = 300.0  # without a line in the log and a run of the solver


@dataclass
class Round:
    """What happened in a round. ``ends``: how its runs ended, by exit code and the last line they printed."""

    seed: int
    hits: Counter[tuple[str, str]] = field(default_factory=Counter)
    ends: Counter[str] = field(default_factory=Counter)
    trouble: list[str] = field(default_factory=list)
    finished: bool = False


class Place:
    """The folder of all rounds: study, cohort and solver, and the calm result that others are compared with."""

    def __init__(self, folder: Path, study: Path) -> None:
        self.folder, self.study = folder, study
        self.out, self.calm = folder / "out", folder / "calm"
        self.terminal, self.temporary = folder / "terminal", folder / "tmp"
        self.notes, self.begun = folder / "notes", folder / "begun"
        self.temporary.mkdir()
        self.calm_runs: Counter[str] = Counter()

    def start(self, mark: str) -> subprocess.Popen[bytes]:
        """`sinew run`, with folders for temporary files of its own and all that it prints in ``terminal``."""
        environment = {**os.environ, MARK: mark, "TMPDIR": str(self.temporary)}
        command = [sys.executable, "-m", "sinew", "run", str(self.study), "--out", str(self.out)]
        with open(self.terminal, "ab") as terminal:
            return subprocess.Popen(
                command, stdout=terminal, stderr=terminal, env=environment, start_new_session=True, cwd=self.folder
            )

    def run_calm(self) -> None:
        """The result without signals; it was made at the same path, which enters some hashes."""
        process = self.start("calm")
        if process.wait() != 0:
            raise SystemExit(f"the calm run failed:\n{self.terminal.read_text()}")
        self.out.rename(self.calm)
        self.calm_runs.update(self.begun.read_text().split())
        self.begin()

    def begin(self) -> None:
        """Remove what a round before has left."""
        if self.out.exists():
            self.out.rename(self.folder / f"out-{time.monotonic_ns()}")
        for path in (self.terminal, self.notes, self.begun):
            path.unlink(missing_ok=True)

    def tail(self) -> str:
        """The last lines of the log and of the terminal."""
        log = self.out / "log.jsonl"
        lines = log.read_text(errors="replace").splitlines()[-5:] if log.exists() else []
        return "\n".join([*lines, *self.terminal.read_text(errors="replace").splitlines()[-10:]])

    def progress(self) -> tuple[int, ...]:
        """Numbers that grow while a run comes along."""
        return tuple(path.stat().st_size if path.exists() else 0 for path in (self.out / "log.jsonl", self.begun))


def play(place: Place, seed: int, until: float, signals: int | None = None) -> Round:
    """One round. After ``until`` (monotonic, s) or so many ``signals``, the run is left in peace to finish."""
    result, dice = Round(seed), random.Random(seed)
    victims = Victims(f"{os.getpid()}-{seed}", str(place.folder / "solver"), dice, hits=result.hits)
    ledger = Ledger(place.out, place.begun)
    while not result.finished:
        process = place.start(victims.mark)
        _disturb(process, place, victims, ledger, result, until, signals)
        victims.wake(all_of_them=True)
        result.finished = process.wait() == 0
        result.ends[_end(process.returncode, place)] += 1
        _all_gone(victims, result)
        ledger.look(running=False)
        if result.trouble:
            return result
    _judge(place, ledger, result)
    return result


def _disturb(
    process: subprocess.Popen[bytes],
    place: Place,
    victims: Victims,
    ledger: Ledger,
    result: Round,
    until: float,
    signals: int | None,
) -> None:
    """Send signals until the run ends."""
    progress, since = place.progress(), time.monotonic()
    due = time.monotonic() + victims.dice.expovariate(1 / BETWEEN_S)
    count = 0
    while process.poll() is None:
        time.sleep(0.02)
        victims.wake()
        peace = time.monotonic() > until or (signals is not None and total(result.hits) >= signals)
        if time.monotonic() >= due and not peace:
            if victims.strike(process.pid) is not None:
                count += 1
                if count % LOOK_EVERY == 0:
                    ledger.look(running=True)
            due = time.monotonic() + victims.dice.expovariate(1 / BETWEEN_S)
        if place.progress() != progress:
            progress, since = place.progress(), time.monotonic()
        elif time.monotonic() - since > STUCK_S:
            result.trouble.append(f"nothing has happened for {STUCK_S:.0f} s; alive: {_titles(victims.look())}")
            for each in victims.look():
                each.kill()


def total(hits: Counter[tuple[str, str]]) -> int:
    """Signals that hit; that a stopped process goes on is none of its own."""
    return sum(count for (_, kind), count in hits.items() if kind != "SIGCONT")


def _end(code: int, place: Place) -> str:
    lines = [line for line in place.terminal.read_text(errors="replace").splitlines() if line.startswith("sinew: ")]
    return f"{code}: {lines[-1]}" if code > 0 and lines else str(code)


def _all_gone(victims: Victims, result: Round) -> None:
    """Nothing of a run may outlive it for long."""
    until = time.monotonic() + GONE_S
    while (left := victims.look()) and time.monotonic() < until:
        time.sleep(0.1)
    if left:
        result.trouble.append(f"{len(left)} processes outlive their run: {_titles(left)}")
        for process in left:
            process.kill()


def _titles(processes: list[psutil.Process]) -> str:
    words = []
    for process in processes:
        try:
            words.append(f"{process.pid} ({process.status()}, child of {process.ppid()}) {' '.join(process.cmdline())}")
        except psutil.Error:
            continue
    return "; ".join(each[:200].strip() for each in words)


def _judge(place: Place, ledger: Ledger, result: Round) -> None:
    """Look at what a finished round has left."""
    if ledger.lost:
        result.trouble.append(f"{len(ledger.lost)} committed rows are lost: {sorted(ledger.lost)[:5]}")
    if again := ledger.again(place.study, place.calm_runs):
        result.trouble.append(f"{len(again)} committed rows were computed again: {again[:5]}")
    result.trouble += differences(place.calm, place.out)
    left = sorted(path.relative_to(place.temporary).as_posix() for path in place.temporary.rglob("*") if path.is_file())
    if left:
        result.trouble.append(f"{len(left)} temporary files are left: {', '.join(left[:10])}")
    lines = place.terminal.read_text(errors="replace").splitlines()
    for number, line in enumerate(lines):
        if "Traceback" in line or "Exception ignored" in line:
            result.trouble.append("a traceback on the terminal:\n    " + "\n    ".join(lines[number : number + 40]))
            break
