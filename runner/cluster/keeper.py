"""Keeps as many worker jobs in the queue as have work, replaces jobs that ended, and notes what happens to each."""

import logging
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sinew.runner.cluster.batch_system import Away, BatchSystem, QueuedJob, Refused
from sinew.runner.cluster.job_table import WORKER, JobTable
from sinew.runner.errors import ClusterError
from sinew.runner.evaluation import external

log = logging.getLogger("sinew")

LOST_AFTER_S = 10.0  # the queue may not show a job yet that was submitted just now
IDLE_S = 60.0  # without work for so long, jobs above the minimum are ended


class Growing:
    """A cluster whose number of jobs follows the work: ``wanted_slots`` workers would have something to do now.

    ``failure``: why its jobs do not start to work, if they do not.
    """

    wanted_slots: int
    failure: ClusterError | None


class Keeper:
    """Compares the jobs of a cluster with the queue, and starts and ends jobs.

    ``output``: the log file of a job by its number; ``facts``: what to note of every submitted job besides.
    """

    GIVE_UP_AFTER = 3  # times the maximum of jobs, for jobs in a row that ended before a worker started

    def __init__(
        self,
        cluster: Any,
        system: BatchSystem,
        table: JobTable,
        output: Callable[[str], Path],
        *,
        minimum: int,
        maximum: int,
        cores: int,
        facts: Mapping[str, str],
    ) -> None:
        self.cluster, self.system, self.table, self.output = cluster, system, table, output
        self.minimum, self.maximum, self.cores, self.facts = minimum, maximum, cores, facts
        self.noted: dict[str, str] = {}
        self.useful: set[str] = set()
        self.useless = 0
        self.idle_since = time.monotonic()

    def look(self) -> None:
        """Start, replace and end jobs as needed; called periodically."""
        try:
            self._look()
        except (
            ClusterError,
            OSError,
        ) as error:  # queue or disk are away for a while
            log.warning(self.system.title.lower(), extra={"error": str(error)})
        except Exception as error:  # noqa: BLE001 - in this thread it would be lost, and the run would wait for ever
            self.cluster.failure = ClusterError(f"the worker jobs are no longer monitored: {error!r}")

    def _look(self) -> None:
        jobs = dict(self.cluster.workers)
        ours = {name: job for name, job in jobs.items() if job.job_id}
        self._note_new()
        queued = self.system.queue(job.job_id for job in ours.values())
        workers = self.cluster.scheduler_info["workers"].values()
        for name, job in ours.items():
            if any(str(worker["name"]).startswith(f"{name}-") or worker["name"] == name for worker in workers):
                self.useful.add(job.job_id)
                self.useless = 0
        gone: list[str] = []
        for name, job in jobs.items():
            found = queued.get(job.job_id or "")
            if found is not None and found.running and self.noted.get(job.job_id) == "submitted":
                self._note(job.job_id, "started", nodes=found.nodes)
            if job.refusal is not None or _has_ended(job, found):
                gone.append(name)
                self._count(job, found)
        wanted = self._wanted_jobs(len(jobs) - len(gone)) if self.cluster.failure is None else 0
        if gone or wanted != len(jobs):
            self._replace(gone, wanted)

    def _count(self, job: Any, found: QueuedJob | None) -> None:
        if job.refusal is not None:
            reason = str(job.refusal)
            self.useless += not isinstance(job.refusal, Away)  # the batch system may be back soon: try again
        else:
            self._note_end(job, found)
            if job.job_id in self.useful:
                return
            self.useless += 1
            reason = f"worker job {job.job_id} ended before it came to work: {self._last_words(job)}"
        log.warning("job", extra={"error": reason})
        waiting = any(other.refusal is None for other in self.cluster.workers.values() if other is not job)
        if self.useless >= self.GIVE_UP_AFTER * self.maximum or (isinstance(job.refusal, Refused) and not waiting):
            self.cluster.failure = ClusterError(f"{reason}; finished rows are kept")

    def _last_words(self, job: Any) -> str:
        path = self.output(job.job_id)
        lines = [line.strip() for line in external.tail(path).splitlines() if line.strip()]
        return f"{lines[-1] if lines else 'it said nothing'} ({path})"

    def _wanted_jobs(self, left: int) -> int:
        """How many jobs there should be; ``left``: of those that there are now."""
        if self.cluster.wanted_slots > 0:
            self.idle_since = time.monotonic()
        elif time.monotonic() - self.idle_since > IDLE_S:
            return self.minimum
        wanted = math.ceil(self.cluster.wanted_slots / self.cores)
        # with less to do, working jobs stay: they end with the run
        return max(self.minimum, min(self.maximum, max(wanted, left)))

    def _replace(self, gone: list[str], wanted: int) -> None:
        async def replace() -> None:
            if gone:
                await self.cluster.scale_down(gone)
            self.cluster.scale(jobs=wanted)

        self.cluster.sync(replace)

    def _note_new(self) -> None:
        for job in list(self.cluster.workers.values()):
            if job.job_id and job.job_id not in self.noted:
                self._note(job.job_id, "submitted", cores=self.cores, role=WORKER, name=job.job_name, **self.facts)

    def _note(self, job: str, event: str, **facts: Any) -> None:
        self.noted[job] = event
        self.table.note(job, event, **facts)

    def _note_end(self, job: Any, found: QueuedJob | None) -> None:
        unknown = f"unknown to {self.system.queue_command}"
        self._note(job.job_id, "ended", end=unknown if found is None else found.state)

    def ended_now(self) -> None:
        """Note the end of all jobs: some may have ended since the last look, the others end as the cluster closes."""
        self._note_new()
        jobs = list(self.cluster.workers.values())
        left = [job for job in jobs if job.job_id and self.noted.get(job.job_id, "ended") != "ended"]
        try:
            queued = self.system.queue(job.job_id for job in left)
        except (ClusterError, OSError) as error:
            log.warning(self.system.title.lower(), extra={"error": str(error)})
        else:
            for job in left:
                if _has_ended(job, queued.get(job.job_id)):
                    self._note_end(job, queued.get(job.job_id))
        for number, event in list(self.noted.items()):
            if event != "ended":
                self._note(number, "ended", end="done")


def _has_ended(job: Any, found: QueuedJob | None) -> bool:
    """Whether a job has ended, by what the queue shows of it; a job submitted just now may not be shown yet."""
    if found is None:
        return time.monotonic() - job.submitted_at > LOST_AFTER_S
    return not found.live
