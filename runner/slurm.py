"""What sinew says to SLURM, and the table of jobs beside the results that says which job did what, and when."""

import json
import os
import re
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from runner.errors import ClusterError

COMMAND_TIMEOUT_S = 60.0
PATIENCE_S = 3600.0
T = TypeVar("T")
_LIVE = """PENDING RUNNING CONFIGURING COMPLETING SUSPENDED STOPPED RESIZING SIGNALING STAGE_OUT REQUEUED REQUEUE_HOLD
REQUEUE_FED RESV_DEL_HOLD SPECIAL_EXIT"""
LIVE = frozenset(_LIVE.split())


class Away(ClusterError):
    """SLURM's controller does not answer."""


class Refused(ClusterError):
    """SLURM does not take a job; ``field`` says which of a job's properties it does not like, when that is known."""

    def __init__(self, words: str) -> None:
        super().__init__(f"SLURM refuses the job: {words}")
        self.words = words
        self.field = next((field for pattern, field in _REASONS if re.search(pattern, words, re.IGNORECASE)), None)


_REASONS = (
    (r"invalid partition|partition.*(not available|down|inactive)|use this partition", "partition"),
    (r"invalid account|account.*(not permitted|denied)|AssocMax|AssocGrp", "account"),
    (r"invalid qos|qos.*(not permitted|denied)|QOSMax|QOSGrp", "qos"),
    (r"invalid feature|invalid constraint", "constraint"),
    (r"reservation", "directives"),
    (r"memory specification|memory.*(not available|exceed|per)", "memory"),
    (r"requested time limit|TimeLimit", "walltime"),
    (r"more processors|cpu count|too many (cpus|tasks)|node configuration is not available", "cores"),
)


@dataclass(frozen=True)
class QueuedJob:
    """A job as ``squeue`` shows it."""

    job: str
    state: str
    reason: str
    nodes: str
    name: str

    @property
    def live(self) -> bool:
        """Whether it waits or runs."""
        return self.state in LIVE


def _call(*command: str) -> subprocess.CompletedProcess[str]:
    # a job script that is submitted from inside a job must not see that job's own numbers
    environment = {name: value for name, value in os.environ.items() if not _OF_A_JOB.match(name)}
    try:
        return subprocess.run(
            command,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=COMMAND_TIMEOUT_S,
            stdin=subprocess.DEVNULL,
            env=environment,
        )
    except FileNotFoundError:
        raise ClusterError(f"{command[0]} was not found; run this on a login node, where SLURM is") from None
    except subprocess.TimeoutExpired:
        raise Away(f"{command[0]} gave no answer within {COMMAND_TIMEOUT_S:g} s; is slurmctld running?") from None
    except OSError as error:
        raise ClusterError(f"{command[0]} cannot be run ({error.strerror})") from None


_OF_A_JOB = re.compile(r"^(SBATCH_|SLURM_(?!CONF$)|SLURMD_|SINEW_)")


def _words(finished: subprocess.CompletedProcess[str]) -> str:
    """What a command printed as its error, on one line."""
    lines = [re.sub(r"^\w+: (error: )?", "", line).strip() for line in finished.stderr.splitlines()]
    return "; ".join(dict.fromkeys(line for line in lines if line)) or f"exit code {finished.returncode}"


def _failed(finished: subprocess.CompletedProcess[str]) -> ClusterError:
    command = finished.args[0]
    words = _words(finished)
    if re.search(r"unable to contact|connection refused|socket timed out|communication", words, re.IGNORECASE):
        return Away(f"SLURM's controller does not answer ({words}); try again when it is back")
    return Refused(words) if command == "sbatch" else ClusterError(f"{command}: {words}")


def version() -> str:
    """What SLURM says of itself, such as ``slurm-wlm 22.05.8``. Raises ``ClusterError`` without one."""
    finished = _call("sbatch", "--version")
    if finished.returncode != 0:
        raise _failed(finished)
    return finished.stdout.strip()


def patiently(ask: Callable[[], T]) -> T:
    """The answer to a question; in a job, ask for as long as the controller is away (at most an hour)."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return ask()
        except Away:
            if job() is None or time.monotonic() > until:
                raise
            time.sleep(5.0)


def check_script(script: Path) -> None:
    """Ask SLURM whether it would take a job script, without submitting it. Raises :class:`Refused`."""
    finished = _call("sbatch", "--test-only", str(script))
    if finished.returncode != 0:
        failed = _failed(finished)
        if isinstance(failed, Refused) and failed.field == "cores":  # or memory, which it does not say here
            with_less = _call("sbatch", "--test-only", "--mem=1", str(script))
            failed.field = "memory" if with_less.returncode == 0 else "cores"
        raise failed


def submit(script: Path) -> str:
    """Submit a job script; returns the job's number. Raises :class:`Refused`."""
    finished = _call("sbatch", "--parsable", str(script))
    job = finished.stdout.strip().partition(";")[0]
    if finished.returncode != 0:
        raise _failed(finished)
    if not job.isdigit():
        raise ClusterError(f"sbatch took the job but told no number ({job[:80] or 'nothing'}); look at `squeue --me`")
    return job


def queue(jobs: Iterable[str] | None = None) -> dict[str, QueuedJob]:
    """The user's own jobs that ``squeue`` knows, by number; only ``jobs``, when given. Raises :class:`ClusterError`."""
    wanted = None if jobs is None else set(jobs)
    if wanted is not None and not wanted:
        return {}
    finished = _call("squeue", "--me", "--noheader", "--states=all", "--format=%A|%T|%r|%N|%j")
    if finished.returncode != 0:
        raise _failed(finished)
    found = {}
    for line in finished.stdout.splitlines():
        parts = line.strip().split("|", 4)
        if len(parts) == 5 and (wanted is None or parts[0] in wanted):
            found[parts[0]] = QueuedJob(*parts)
    return found


def cancel(jobs: Sequence[str]) -> None:
    """End jobs; those that have ended already are passed over. Raises :class:`ClusterError`."""
    if jobs:
        finished = _call("scancel", "--quiet", *jobs)
        words = _words(finished)
        if finished.returncode != 0 and not re.search(r"invalid job id|already (completing|completed)", words, re.I):
            raise _failed(finished)


def node() -> str:
    """The node that this process runs on, in SLURM's words; empty outside of a job."""
    return os.environ.get("SLURMD_NODENAME", "")


def job() -> str | None:
    """The SLURM job that this process belongs to."""
    return os.environ.get("SLURM_JOB_ID")


# ---- the table of jobs

COORDINATOR, WORKER = "coordinator", "worker"


@dataclass
class JobRecord:
    """A job that worked, or works, on a result folder. Times are seconds since 1970; ``spent_s`` is for ended runs."""

    job: str
    role: str = ""
    name: str = ""
    cores: int = 0
    nodes: str = ""
    end: str = ""
    submitted: float | None = None
    started: float | None = None
    ended: float | None = None
    spent_s: float = 0.0

    def happened(self, event: str, at: float) -> None:
        """Take note of an event. A job that is requeued starts and ends more than once."""
        if event == "submitted":
            self.submitted = at
        elif event == "started":
            self.started, self.ended = at, None
        elif event == "ended" and self.ended is None:
            self.ended = at
            self.spent_s += at - self.started if self.started is not None else 0.0

    def core_hours(self, now: float) -> float:
        """What it has cost."""
        running_s = now - self.started if self.started is not None and self.ended is None else 0.0
        return self.cores * (self.spent_s + max(running_s, 0.0)) / 3600


class JobTable:
    """``jobs.jsonl``: a line for everything that happened to a job. It is only ever appended to."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "jobs.jsonl"

    def note(self, job: str, event: str, **facts: Any) -> None:
        """Write down that ``job`` was ``submitted``, ``started`` or ``ended``."""
        line = json.dumps({"time": round(time.time(), 3), "job": job, "event": event, **facts})
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with open(self.path, "a", encoding="utf-8") as file:
            file.write(line + "\n")

    def read(self) -> dict[str, JobRecord]:
        """All jobs by number, in the order in which they were submitted. Lines that are cut short are passed over."""
        records: dict[str, JobRecord] = {}
        try:
            lines = self.path.read_text("utf-8", errors="replace").splitlines()
        except (FileNotFoundError, NotADirectoryError):
            return {}
        for line in lines:
            try:
                said = json.loads(line)
                number, event, at = str(said["job"]), str(said["event"]), float(said["time"])
                facts = {name: kind(said[name]) for name, kind in _FACTS.items() if name in said}
            except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
                continue
            if not (0 <= at < 1e11 and 0 <= facts.get("cores", 0) < 10**7):  # NaN, too
                continue
            record = records.setdefault(number, JobRecord(number))
            for name, value in facts.items():
                setattr(record, name, value)
            record.happened(event, at)
        return records


_FACTS = {"role": str, "name": str, "cores": int, "nodes": str, "end": str}
