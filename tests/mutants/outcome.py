"""What became of a target's mutants."""

import json
import random
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from scipy.stats import binomtest

KILLED = (1, 3)
TIMED_OUT = (-24, 24, 36, 152, 255)
SURVIVORS = Path(__file__).with_name("survivors.md")


@dataclass(frozen=True)
class Outcome:
    """The mutants of a target: how many were killed, ran out of time, survived or were not tested yet.

    ``of``: how many the target has; they are a sample where that is more.
    """

    target: str
    killed: int
    timed_out: int
    survived: int
    untested: int
    of: int

    @property
    def mutants(self) -> int:
        return self.killed + self.timed_out + self.survived + self.untested

    @property
    def percent(self) -> float:
        """Part that was noticed: a mutant that never ends is one that somebody notices."""
        return 100.0 * (self.killed + self.timed_out) / max(self.mutants, 1)

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval (Clopper and Pearson) of ``percent`` for all mutants of the target, from a sample."""
        if self.mutants in (0, self.of):
            return self.percent, self.percent
        found = binomtest(self.killed + self.timed_out, self.mutants).proportion_ci(method="exact")
        return 100.0 * found.low, 100.0 * found.high


def exit_codes(folder: Path) -> dict[str, int | None]:
    """By mutant of a working copy, the exit code of its tests; None where they did not run yet."""
    found: dict[str, int | None] = {}
    for meta in _metas(folder):
        found |= json.loads(meta.read_text())["exit_code_by_key"]
    return found


def forget(folder: Path) -> None:
    """Have all mutants that were not killed tested again: tests may have been added since."""
    for meta in _metas(folder):
        data = json.loads(meta.read_text())
        codes = data["exit_code_by_key"]
        data["exit_code_by_key"] = {name: code if code in KILLED else None for name, code in codes.items()}
        meta.write_text(json.dumps(data))
    (folder / "mutants" / "mutmut-stats.json").unlink(missing_ok=True)


def drawn(codes: Iterable[str], sample: int | None, seed: int = 0) -> list[str]:
    """The names of ``sample`` mutants, or of all: an order drawn at random, so that a larger sample holds a smaller."""
    names = sorted(codes)
    return names if sample is None else random.Random(seed).sample(names, len(names))[:sample]


def outcome(target: str, codes: dict[str, int | None], of: int) -> Outcome:
    """Counts of the exit codes. A mutant that no test runs has survived."""
    kinds = Counter(_kind(code) for code in codes.values())
    return Outcome(target, kinds["killed"], kinds["timed out"], kinds["survived"], kinds["untested"], of)


def survivors(codes: dict[str, int | None]) -> list[str]:
    return [name for name, code in codes.items() if _kind(code) == "survived"]


def table(outcomes: Sequence[Outcome]) -> str:
    """The outcomes, a line each."""
    lines = [
        f"{'target':10} {'mutants':>8} {'tested':>8} {'killed':>8} {'timed out':>10} {'survived':>9} {'untested':>9} "
        f"{'killed':>8} {'95 % interval':>15}"
    ]
    lines += [
        f"{one.target:10} {one.of:8} {one.mutants:8} {one.killed:8} {one.timed_out:10} {one.survived:9} "
        f"{one.untested:9} {one.percent:6.1f} % {one.interval[0]:6.1f} to {one.interval[1]:.1f}"
        for one in outcomes
    ]
    return "\n".join(lines)


def row(diff: str) -> str:
    """The row of ``survivors.md`` that a mutant's diff belongs to, without the reason."""
    path = next(line for line in diff.splitlines() if line.startswith("--- "))[4:].removeprefix("sinew/")
    changed = [line for line in diff.splitlines() if re.match(r"[-+](?![-+]{2} )", line)]
    before = " ".join(line[1:].strip() for line in changed if line[0] == "-")
    after = " ".join(line[1:].strip() for line in changed if line[0] == "+")
    return f"| {path} | `{_cell(before)}` → `{_cell(after)}` |"


def unlisted(rows: Sequence[str], listed: str) -> list[str]:
    """Those of ``rows`` that ``survivors.md`` does not give a reason for."""
    return [one for one in rows if one not in listed]


def _cell(code: str) -> str:
    return code.replace("|", "\\|")


def _kind(code: int | None) -> str:
    if code is None:
        return "untested"
    return "killed" if code in KILLED else "timed out" if code in TIMED_OUT else "survived"


def _metas(folder: Path) -> Iterator[Path]:
    return (folder / "mutants" / "sinew").rglob("*.meta")
