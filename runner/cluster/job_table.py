"""The table of jobs beside the results: which job did what, and when."""

import hashlib
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sinew.runner.errors import StoreError
from sinew.runner.files import NotReadable, append_file, read_regular

MAX_BYTES = 2**23  # some ten thousand jobs

COORDINATOR, WORKER = "coordinator", "worker"
_ENDINGS = {COORDINATOR: "", WORKER: "-worker"}  # of names in the queue, by which a prologue can tell them apart
SLURM = "slurm"  # the batch system of jobs for which the table names none


def noted(batch_system: str) -> dict[str, str]:
    """What the table notes of the batch system of a submitted job."""
    return {} if batch_system == SLURM else {"batch_system": batch_system}


@dataclass
class JobRecord:
    """A job that worked, or works, on a result folder. Times are seconds since 1970; ``spent_s`` is for ended runs."""

    job: str
    role: str = ""
    name: str = ""
    cores: int = 0
    nodes: str = ""
    end: str = ""
    batch_system: str = SLURM
    submitted: float | None = None
    started: float | None = None
    ended: float | None = None
    spent_s: float = 0.0

    def happened(self, event: str, at: float) -> None:
        """Note an event. A requeued job starts and ends more than once."""
        if event == "submitted":
            self.submitted = at
        elif event == "started":
            self.started, self.ended = at, None
        elif event == "ended" and self.ended is None:
            self.ended = at
            self.spent_s += max(at - self.started, 0.0) if self.started is not None else 0.0

    def core_hours(self, now: float) -> float:
        """The core-hours that the job has used."""
        running_s = now - self.started if self.started is not None and self.ended is None else 0.0
        return self.cores * (self.spent_s + max(running_s, 0.0)) / 3600


class JobTable:
    """``jobs.jsonl``: one line for each event of a job. Lines are only ever appended."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "jobs.jsonl"

    @property
    def _place(self) -> str:
        return hashlib.sha256(os.fsencode(os.path.realpath(self.path))).hexdigest()[:10]

    def job_name(self, study: str, role: str) -> str:
        """The name in the queue of a job that works on this result folder: it holds a hash of the folder's path."""
        return f"sinew-{study}-{self._place}{_ENDINGS[role]}"

    def is_job(self, record: JobRecord, queued_name: str) -> bool:
        """Whether the job in the queue that has the number of ``record`` is the one of this table.

        A table may come with a result folder of somebody else, or with a copy of one of your own: only jobs that were
        submitted for this very folder are ever its jobs.
        """
        ours = tuple(f"-{self._place}{ending}" for ending in _ENDINGS.values())
        return record.name == queued_name and queued_name.startswith("sinew-") and queued_name.endswith(ours)

    def note(self, job: str, event: str, **facts: Any) -> None:
        """Append that ``job`` was ``submitted``, ``started`` or ``ended``."""
        line = json.dumps({"time": round(time.time(), 3), "job": job, "event": event, **facts})
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with append_file(self.path) as file:
            file.write(f"{line}\n".encode())

    def read(self) -> dict[str, JobRecord]:
        """All jobs by number, in the order of submission. Incomplete lines are ignored."""
        records: dict[str, JobRecord] = {}
        try:
            lines = read_regular(self.path, MAX_BYTES).decode("utf-8", errors="replace").splitlines()
        except (FileNotFoundError, NotADirectoryError):
            return {}
        except NotReadable as problem:
            raise StoreError(f"{self.path}: {problem}; expected the table of jobs that `sinew submit` writes") from None
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


_FACTS = {"role": str, "name": str, "cores": int, "nodes": str, "end": str, "batch_system": str}
