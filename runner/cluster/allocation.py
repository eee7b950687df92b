"""A whole cluster inside one allocation: its tasks are scheduler, client and workers."""

import asyncio
import logging
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
from distributed import Client, SchedulerPlugin
from distributed.core import Status

from sinew.runner.cluster.batch_system import BatchSystem, jobqueue
from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS
from sinew.runner.cluster.dask_settings import DASHBOARD, ENVIRONMENT, SETTINGS, scheduler_folder
from sinew.runner.cluster.network import Network, check_interface, shared_certificate
from sinew.runner.errors import ClusterError
from sinew.runner.evaluation import external
from sinew.runner.files import temporary_folder


@dataclass(frozen=True)
class Allocation:
    """One allocation of a batch system: task 0 is the scheduler, task 1 the client, all others are workers."""

    folder: Path
    network: Network
    batch_system: str = "slurm"

    @property
    def system(self) -> BatchSystem:
        return BATCH_SYSTEMS[self.batch_system]


class _EndWithClient(SchedulerPlugin):
    """Ends the cluster when its only client is gone, so that the allocation ends when the client was killed."""

    def remove_client(self, scheduler: Any, client: str) -> None:
        self.closing = asyncio.ensure_future(scheduler.close(reason="its client is gone"))


@contextmanager
def open_allocation(spec: Allocation) -> Iterator[Client]:
    """The client's side of an allocation; the other tasks do not return from here."""
    check_interface(spec.network.interface)
    task = spec.system.task()
    if task is None:
        launcher = " ".join(spec.system.launcher or ())
        raise ClusterError(f"cluster: an allocation is used inside of {launcher}; submit the study by `sinew submit`")
    this = f"{spec.system.job()}-{spec.system.restarts()}"
    certificates = spec.folder / f"certificate-{this}"
    security = shared_certificate(certificates, create=task == 0) if spec.network.tls else None
    scheduler_file = spec.folder / f"scheduler-{this}.json"
    common: dict[str, Any] = {
        "protocol": "tls://" if security else "tcp://",
        "security": security,
        "interface": spec.network.interface,
    }
    os.environ.update(ENVIRONMENT)
    if task == 1:  # it leads, and nobody else does: the result folder is locked
        remove_abandoned(spec.folder, this)
    try:
        runner = spec.system.allocation_runner(jobqueue(spec.system.dask_module()))(
            scheduler_file=str(scheduler_file),
            scheduler_options={
                **common,
                "local_directory": scheduler_folder(),
                "dashboard_address": DASHBOARD,
                "plugins": [_EndWithClient()],
            },
            worker_class="distributed.Nanny",
            worker_options={
                **common,
                "nthreads": 1,
                "local_directory": external.scratch(temporary_folder()),
                "dashboard": False,
                "silence_logs": logging.ERROR,
            },
        )
    except RuntimeError as error:  # too few tasks
        raise ClusterError(f"cluster: {error}") from error
    try:
        with Client(runner.scheduler_address, security=security, set_as_default=False) as client:
            try:
                yield client
                client.retire_workers(close_workers=True)
            finally:  # otherwise the other tasks would stay until the walltime
                runner.status = Status.closed  # its own way of closing does not support TLS
                client.shutdown()
    finally:
        runner.status = Status.closed
        scheduler_file.unlink(missing_ok=True)
        shutil.rmtree(certificates, ignore_errors=True)


def remove_abandoned(folder: Path, this: str) -> None:
    """Remove what allocations that were killed have left in the folder of jobs; ``this`` is the present one."""
    for left in (*folder.glob("certificate-*"), *folder.glob(".certificate-*.partial")):
        if left.name not in (f"certificate-{this}", f".certificate-{this}.partial"):
            shutil.rmtree(left, ignore_errors=True)
    for left in folder.glob("scheduler-*.json"):
        if left.name != f"scheduler-{this}.json":
            with suppress(OSError):  # whatever stands there
                left.unlink()


def join_allocation(spec: Allocation) -> None:
    """Serve as scheduler or worker if this is such a task of the allocation; return at once in the client's task.

    Raises ``SystemExit`` at the end of such a service.
    """
    if spec.system.task() in (None, 1):
        return
    logging.getLogger("distributed").setLevel(logging.ERROR)
    own: Path | None = None
    if os.environ.get(external.SCRATCH):  # tasks on one node share it, and each removes its own
        os.environ[external.SCRATCH] = str(external.scratch(spec.folder) / f"task-{spec.system.task()}")
        own = external.scratch(spec.folder)  # now: the first task that ends removes an empty folder of the job
    try:
        with dask.config.set(SETTINGS), open_allocation(spec):
            raise ClusterError("cluster: this task of the allocation should have served")
    except KeyboardInterrupt:  # dask-jobqueue raises it when the cluster is closed
        raise SystemExit(0) from None
    finally:
        if own is not None:
            shutil.rmtree(own, ignore_errors=True)
            with suppress(OSError):  # others use theirs
                own.parent.rmdir()
