"""Workers as jobs under SLURM, through dask-jobqueue: as many as have work, new ones for those that ended."""

import asyncio
import contextlib
import importlib
import logging
import math
import os
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import dask
from distributed import Client
from distributed.core import Status

from runner import drain, external, slurm
from runner.errors import ClusterError
from runner.network import Network, check_interface, shared_certificate
from runner.periodic import every
from runner.settings import DASHBOARD, ONE_THREAD, SETTINGS

log = logging.getLogger("sinew")

LOST_AFTER_S = 10.0  # squeue may not know a job yet that was submitted just now


@dataclass(frozen=True)
class Jobs:
    """Worker jobs under SLURM, from ``minimum`` to ``maximum`` of them, each of ``cores`` workers with one thread.

    ``folder``: on a file system that all nodes see; holds the jobs' table, their output and the certificate.
    ``directives``: options for ``sbatch``; ``prologue``: shell lines before the workers start; ``scratch``: a folder
    on the node for solver runs, in shell words (None: solvers run beside the results).
    """

    name: str
    folder: Path
    maximum: int
    minimum: int
    cores: int
    memory_mb: int
    walltime_s: float
    network: Network
    directives: tuple[str, ...] = ()
    prologue: tuple[str, ...] = ()
    scratch: str | None = None
    poll_s: float = 15.0


class Growing:
    """A cluster whose number of jobs follows the work: ``wanted_slots`` workers would have something to do now.

    ``failure`` says why its jobs do not come to work.
    """

    wanted_slots: int
    failure: ClusterError | None


@lru_cache(maxsize=1)
def jobqueue() -> Any:
    """dask-jobqueue's SLURM module. Importing it replaces Ctrl-C's handler, which is put back."""
    before = signal.getsignal(signal.SIGINT)
    module = importlib.import_module("dask_jobqueue.slurm")
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, before)
    return module


@lru_cache(maxsize=1)
def _classes() -> tuple[Any, Any]:
    """dask-jobqueue's cluster and job, with what sinew adds."""

    class WorkerJob(jobqueue().SLURMJob):  # type: ignore[misc]
        """A job whose refusal is kept, not thrown into the scheduler's loop."""

        refusal: ClusterError | None = None
        submitted_at = math.inf

        async def _submit_job(self, script_filename: str) -> str:
            return await asyncio.to_thread(slurm.submit, Path(script_filename))  # the scheduler goes on meanwhile

        async def start(self) -> None:
            try:
                await super().start()
            except ClusterError as error:
                self.refusal = error
                self.status = Status.running  # as far as the cluster is concerned; the keeper sees to it
            self.submitted_at = time.monotonic()

        @classmethod
        async def _close_job(cls, job_id: str | None, cancel_command: str) -> None:
            if job_id:
                with contextlib.suppress(ClusterError):  # the controller is away; the job ends without a scheduler
                    await asyncio.to_thread(slurm.cancel, [job_id])

        async def close(self) -> None:
            await super().close()
            self.status = Status.closed

    class JobsCluster(jobqueue().SLURMCluster, Growing):  # type: ignore[misc]
        job_cls = WorkerJob
        wanted_slots = 0
        failure: ClusterError | None = None

    return JobsCluster, WorkerJob


def _job_name(spec: Jobs) -> str:
    return f"sinew-{spec.name}-worker"


def _log(spec: Jobs, job: str) -> Path:
    """What a worker job prints."""
    return spec.folder / f"{_job_name(spec)}-{job}.log"


def _job_options(spec: Jobs) -> dict[str, Any]:
    """What every worker job is made of, in dask-jobqueue's words."""
    inherited = dask.config.serialize(dask.config.expand_environment_variables(_nested(SETTINGS)))
    prologue = [*drain.job_script_lines(spec.walltime_s), f"export DASK_INTERNAL_INHERIT_CONFIG={inherited}"]
    prologue += [f"export {name}={value}" for name, value in ONE_THREAD.items()]
    if spec.scratch is not None:
        prologue += [
            external.scratch_line(spec.scratch),
            f'mkdir -p -m 700 "${external.SCRATCH}" || exit 1',
            f"trap 'rm -rf -- \"${external.SCRATCH}\"' EXIT",
        ]
    prologue += spec.prologue
    return {
        "cores": spec.cores,
        "processes": spec.cores,
        "memory": f"{spec.memory_mb * 2**20}B",
        "job_cpu": spec.cores,
        "job_mem": f"{spec.memory_mb}M",
        "walltime": slurm_time(spec.walltime_s),
        "job_name": _job_name(spec),
        "job_extra_directives": ["--no-requeue", f"--output={_log(spec, '%j')}", *spec.directives],
        "job_script_prologue": prologue,
        "interface": spec.network.interface,
        "python": sys.executable,
        "death_timeout": "60",
        "local_directory": f'"${{{external.SCRATCH}:-${{TMPDIR:-/tmp}}}}"',
        "worker_extra_args": ["--no-dashboard"],
        "config_name": "sinew",
    }


# settings of the user's own Dask projects have no place in these jobs
_KEYS = """name cores memory processes interface death-timeout local-directory extra env-extra job-extra queue account
walltime job-cpu job-mem log-directory python header-skip shared-temp-directory project"""
_ONLY_OURS: dict[str, Any] = {
    "jobqueue.sinew": {
        **dict.fromkeys(_KEYS.split()),
        "worker-command": "distributed.cli.dask_worker",
        "worker-extra-args": [],
        "job-script-prologue": [],
        "job-extra-directives": [],
        "job-directives-skip": [],
        "scheduler-options": {},
        "shebang": "#!/usr/bin/env bash",
    },
    # Dask would start a job anew when its workers are away for a while; here the keeper does, when SLURM says so
    "distributed.deploy.lost-worker-timeout": "365 d",
}


def _nested(flat: dict[str, Any]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, last = name.split(".")
        inner = nested
        for parent in parents:
            inner = inner.setdefault(parent, {})
        inner[last] = value
    return nested


def slurm_time(seconds: float) -> str:
    """Hours, minutes and seconds as SLURM writes them."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


def worker_job_script(spec: Jobs) -> str:
    """The script of a worker job, as it would be submitted; its scheduler's address is made up."""
    _, job_class = _classes()
    with dask.config.set(_ONLY_OURS):
        return str(job_class("tls://127.0.0.1:8786", name="worker", **_job_options(spec)).job_script())


@contextmanager
def open_jobs(spec: Jobs) -> Iterator[Client]:
    check_interface(spec.network.interface)
    certificates = spec.folder / "certificate"
    security = shared_certificate(certificates, create=True) if spec.network.tls else None
    cluster_class, _ = _classes()
    table = slurm.JobTable(spec.folder)
    _end_what_is_left(table)
    host = {} if spec.network.interface else {"host": socket.gethostname()}
    with dask.config.set(_ONLY_OURS):
        try:
            cluster = cluster_class(
                **_job_options(spec),
                security=security,
                protocol="tls://" if security else "tcp://",
                scheduler_options={"dashboard_address": DASHBOARD, **host},
                silence_logs=logging.ERROR,
                name=f"sinew-{os.getpid()}-{round(time.time())}",
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise ClusterError(f"cluster: the scheduler could not be started ({error})") from error
        keeper = _Keeper(cluster, spec, table)
        try:
            with cluster, Client(cluster, set_as_default=False) as client:
                try:
                    with every(spec.poll_s, keeper.look, "sinew-jobs"):
                        yield client
                finally:
                    keeper.ended_now()
        finally:
            shutil.rmtree(certificates, ignore_errors=True)


def _end_what_is_left(table: slurm.JobTable) -> None:
    """End worker jobs of a coordinator that was killed: nothing listens to them any more."""
    open_jobs = [record for record in table.read().values() if record.role == slurm.WORKER and record.ended is None]
    found = slurm.patiently(lambda: slurm.queue(record.job for record in open_jobs))
    left = [r.job for r in open_jobs if r.job in found and found[r.job].live and found[r.job].name == r.name]
    slurm.patiently(lambda: slurm.cancel(left))
    for record in open_jobs:
        table.note(record.job, "ended", end="cancelled, its coordinator was gone" if record.job in left else "lost")


class _Keeper:
    """Sees to it that as many jobs wait or run as have something to do."""

    GIVE_UP_AFTER = 3  # times the number of jobs, in a row, that ended before a worker came

    def __init__(self, cluster: Any, spec: Jobs, table: slurm.JobTable) -> None:
        self.cluster, self.spec, self.table = cluster, spec, table
        self.noted: dict[str, str] = {}
        self.useful: set[str] = set()
        self.useless = 0
        self.idle_since = time.monotonic()

    def look(self) -> None:
        """Compare the jobs that there should be with those that there are."""
        try:
            self._look()
        except (ClusterError, OSError) as error:  # controller or disk are away for a while: what runs, runs on
            log.warning("slurm", extra={"error": str(error)})
        except Exception as error:  # noqa: BLE001 - in a thread of its own, it would be lost and the run wait for ever
            self.cluster.failure = ClusterError(f"the worker jobs cannot be looked after: {error!r}")

    def _look(self) -> None:
        jobs = dict(self.cluster.workers)
        ours = {name: job for name, job in jobs.items() if job.job_id}
        self._note_new()
        queued = slurm.queue(job.job_id for job in ours.values())
        workers = self.cluster.scheduler_info["workers"].values()
        for name, job in ours.items():
            if any(str(worker["name"]).startswith(f"{name}-") or worker["name"] == name for worker in workers):
                self.useful.add(job.job_id)
                self.useless = 0
        gone: list[str] = []
        for name, job in jobs.items():
            found = queued.get(job.job_id or "")
            if found is not None and found.state == "RUNNING" and self.noted.get(job.job_id) == "submitted":
                self._note(job.job_id, "started", nodes=found.nodes)
            old = time.monotonic() - job.submitted_at > LOST_AFTER_S
            if job.refusal is not None or (found is None and old) or (found is not None and not found.live):
                gone.append(name)
                self._count(job, found)
        wanted = self._wanted_jobs() if self.cluster.failure is None else 0
        if gone or wanted != len(jobs):
            self._replace(gone, wanted)

    def _count(self, job: Any, found: slurm.QueuedJob | None) -> None:
        if job.refusal is not None:
            reason = str(job.refusal)
            self.useless += isinstance(job.refusal, slurm.Refused)  # else the controller is away: try again
        else:
            self._note(job.job_id, "ended", end="unknown to squeue" if found is None else found.state)
            if job.job_id in self.useful:
                return
            self.useless += 1
            reason = f"worker job {job.job_id} ended before it came to work: {self._last_words(job)}"
        log.warning("job", extra={"error": reason})
        waiting = any(other.refusal is None for other in self.cluster.workers.values() if other is not job)
        if self.useless >= self.GIVE_UP_AFTER * self.spec.maximum or (
            isinstance(job.refusal, slurm.Refused) and not waiting
        ):
            self.cluster.failure = ClusterError(f"{reason}; finished rows are kept")

    def _last_words(self, job: Any) -> str:
        path = _log(self.spec, job.job_id)
        lines = [line.strip() for line in external.tail(path).splitlines() if line.strip()]
        return f"{lines[-1] if lines else 'it said nothing'} ({path})"

    def _wanted_jobs(self) -> int:
        if self.cluster.wanted_slots > 0:
            self.idle_since = time.monotonic()
        elif time.monotonic() - self.idle_since > 60.0:
            return self.spec.minimum
        wanted = math.ceil(self.cluster.wanted_slots / self.spec.cores)
        # those that work are left alone when there is less to do: they end with the run
        return max(self.spec.minimum, min(self.spec.maximum, max(wanted, len(self.cluster.workers))))

    def _replace(self, gone: list[str], wanted: int) -> None:
        async def replace() -> None:
            if gone:
                await self.cluster.scale_down(gone)
            self.cluster.scale(jobs=wanted)

        self.cluster.sync(replace)

    def _note_new(self) -> None:
        for job in list(self.cluster.workers.values()):
            if job.job_id and job.job_id not in self.noted:
                self._note(job.job_id, "submitted", cores=self.spec.cores, role=slurm.WORKER, name=job.job_name)

    def _note(self, job: str, event: str, **facts: Any) -> None:
        self.noted[job] = event
        self.table.note(job, event, **facts)

    def ended_now(self) -> None:
        """The cluster closes and takes all of its jobs with it."""
        self._note_new()
        for job, event in list(self.noted.items()):
            if event != "ended":
                self._note(job, "ended", end="done")
