"""Workers as jobs of a batch system, through dask-jobqueue."""

import asyncio
import contextlib
import logging
import math
import os
import shutil
import socket
import sys
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

from sinew.runner.cluster import drain
from sinew.runner.cluster.batch_system import BatchSystem, JobRequest, jobqueue
from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS, patiently
from sinew.runner.cluster.dask_settings import DASHBOARD, ENVIRONMENT, SETTINGS, scheduler_folder
from sinew.runner.cluster.job_table import WORKER, JobTable, noted
from sinew.runner.cluster.keeper import Growing, Keeper
from sinew.runner.cluster.network import Network, check_interface, shared_certificate
from sinew.runner.errors import ClusterError
from sinew.runner.evaluation import external
from sinew.runner.periodic import every

POLL_S = 15.0  # between two questions about the queue, unless a profile says otherwise


@dataclass(frozen=True)
class Jobs:
    """From ``minimum`` to ``maximum`` worker jobs, each with ``cores`` workers of one thread.

    ``folder``: on a file system that all nodes share, for the table of jobs, their output and the certificate;
    ``directives``: options in the batch system's words; ``prologue``: shell lines before the workers start;
    ``scratch``: a folder on the node for solver runs, in shell syntax (None: solvers run beside the results);
    ``batch_system``: a name in :data:`sinew.runner.cluster.batch_systems.BATCH_SYSTEMS`.
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
    poll_s: float = POLL_S
    batch_system: str = "slurm"

    @property
    def system(self) -> BatchSystem:
        return BATCH_SYSTEMS[self.batch_system]


@lru_cache(maxsize=4)
def _classes(name: str) -> tuple[Any, Any]:
    """dask-jobqueue's cluster and job class for a batch system, with sinew's additions."""
    system = BATCH_SYSTEMS[name]
    job_class: Any
    cluster_class: Any
    job_class, cluster_class = system.dask_classes(jobqueue(system.dask_module()))

    class WorkerJob(job_class):  # type: ignore[misc]
        """A job whose refusal is kept instead of raised in the scheduler's loop."""

        refusal: ClusterError | None = None
        submitted_at = math.inf

        async def _submit_job(self, script_filename: str) -> str:
            return await asyncio.to_thread(system.submit, Path(script_filename))  # does not block the scheduler

        async def start(self) -> None:
            try:
                await super().start()
            except ClusterError as error:
                self.refusal = error
                self.status = Status.running  # for the cluster; the keeper replaces it
            self.submitted_at = time.monotonic()

        @classmethod
        async def _close_job(cls, job_id: str | None, cancel_command: str) -> None:
            if job_id:
                with contextlib.suppress(ClusterError):  # not reachable; the job ends without a scheduler
                    await asyncio.to_thread(system.cancel, [job_id])

        async def close(self) -> None:
            await super().close()
            self.status = Status.closed

    class JobsCluster(cluster_class, Growing):  # type: ignore[misc]
        job_cls = WorkerJob
        wanted_slots = 0
        failure: ClusterError | None = None

    return JobsCluster, WorkerJob


def _job_name(spec: Jobs) -> str:
    return JobTable(spec.folder).job_name(spec.name, WORKER)


def _log(spec: Jobs, job: str) -> Path:
    """The output of a worker job."""
    return spec.folder / f"sinew-{spec.name}-worker-{job}.log"


def _job_options(spec: Jobs) -> dict[str, Any]:
    """Arguments of dask-jobqueue's job class for every worker job."""
    inherited = dask.config.serialize(dask.config.expand_environment_variables(_nested(SETTINGS)))
    prologue = [*drain.job_script_lines(spec.walltime_s), f"export DASK_INTERNAL_INHERIT_CONFIG={inherited}"]
    prologue += [f"export {name}={value}" for name, value in ENVIRONMENT.items()]
    prologue += _own_folders(spec)
    prologue += spec.prologue
    output = str(_log(spec, spec.system.job_in_path))
    request = JobRequest(_job_name(spec), output, spec.cores, spec.memory_mb, spec.walltime_s, spec.directives)
    return {
        "cores": spec.cores,
        "processes": spec.cores,
        "memory": f"{spec.memory_mb * 2**20}B",
        "job_name": _job_name(spec),
        **spec.system.worker_options(request),
        "job_script_prologue": prologue,
        "interface": spec.network.interface,
        "python": sys.executable,
        "death_timeout": "60",
        "local_directory": f'"${_WORKER_FILES}"',
        "worker_extra_args": ["--no-dashboard"],
        "config_name": "sinew",
    }


_WORKER_FILES = "SINEW_WORKER_FILES"


def _own_folders(spec: Jobs) -> list[str]:
    """Shell lines that make the folder of the job's workers on its node, and name the one of its solvers."""
    lines = [f'{_WORKER_FILES}="$(mktemp -d "${{TMPDIR:-/tmp}}/sinew-XXXXXXXXXX")" || exit 1']
    removed = [_WORKER_FILES]
    if spec.scratch is not None:
        lines.append(external.scratch_line(spec.scratch, spec.system.job_variable))
        removed.append(external.SCRATCH)
    folders = " ".join(f'"${name}"' for name in removed)
    return [*lines, f"trap 'rm -rf -- {folders}' EXIT"]


# settings of the user's other Dask projects must not enter these jobs
_KEYS = """name cores memory processes interface death-timeout local-directory extra env-extra job-extra queue account
walltime job-cpu job-mem log-directory python header-skip shared-temp-directory project resource-spec"""
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
    # Dask would restart a job whose workers are away for a while; here the keeper decides, from the queue
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


def worker_job_script(spec: Jobs) -> str:
    """The script of a worker job, as it would be submitted, with an invented scheduler address."""
    _, job_class = _classes(spec.batch_system)
    with dask.config.set(_ONLY_OURS):
        return str(job_class("tls://127.0.0.1:8786", name="worker", **_job_options(spec)).job_script())


@contextmanager
def open_jobs(spec: Jobs) -> Iterator[Client]:
    """A client of a cluster of worker jobs; the jobs end with it. Raises ``ClusterError``."""
    check_interface(spec.network.interface)
    certificates = spec.folder / "certificate"
    security = shared_certificate(certificates, create=True) if spec.network.tls else None
    cluster_class, _ = _classes(spec.batch_system)
    table = JobTable(spec.folder)
    _end_orphans(table, spec.system)
    host = {} if spec.network.interface else {"host": socket.gethostname()}
    with dask.config.set(_ONLY_OURS):
        try:
            cluster = cluster_class(
                **_job_options(spec),
                security=security,
                protocol="tls://" if security else "tcp://",
                scheduler_options={"dashboard_address": DASHBOARD, "local_directory": scheduler_folder(), **host},
                silence_logs=logging.ERROR,
                name=f"sinew-{os.getpid()}-{round(time.time())}",
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise ClusterError(f"cluster: the scheduler could not be started ({error})") from error
        keeper = Keeper(
            cluster,
            spec.system,
            table,
            lambda job: _log(spec, job),
            minimum=spec.minimum,
            maximum=spec.maximum,
            cores=spec.cores,
            facts=noted(spec.batch_system),
        )
        try:
            with cluster, Client(cluster, set_as_default=False) as client:
                try:
                    with every(spec.poll_s, keeper.look, "sinew-jobs"):
                        yield client
                finally:
                    keeper.ended_now()
        finally:
            shutil.rmtree(certificates, ignore_errors=True)


def _end_orphans(table: JobTable, system: BatchSystem) -> None:
    """End worker jobs whose coordinator was killed: nothing uses them any more."""
    unfinished = [record for record in table.read().values() if record.role == WORKER and record.ended is None]
    found = patiently(lambda: system.queue(record.job for record in unfinished))
    left = [r.job for r in unfinished if r.job in found and found[r.job].live and table.is_job(r, found[r.job].name)]
    patiently(lambda: system.cancel(left))
    for record in unfinished:
        table.note(record.job, "ended", end="cancelled, its coordinator was gone" if record.job in left else "lost")
