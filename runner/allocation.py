"""A whole cluster inside one SLURM allocation: one ``srun``, whose tasks are scheduler, client and workers."""

import asyncio
import logging
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dask
from distributed import Client, SchedulerPlugin
from distributed.core import Status

from runner import external
from runner.errors import ClusterError
from runner.jobs import jobqueue
from runner.network import Network, check_interface, shared_certificate
from runner.settings import DASHBOARD, ONE_THREAD, SETTINGS


@dataclass(frozen=True)
class Allocation:
    """One ``srun`` inside a SLURM allocation: task 0 is the scheduler, task 1 the client, all others are workers."""

    folder: Path
    network: Network


class _EndWithClient(SchedulerPlugin):
    """Ends the cluster when its only client is gone, so that srun ends when the client was killed."""

    def remove_client(self, scheduler: Any, client: str) -> None:
        self.closing = asyncio.ensure_future(scheduler.close(reason="its client is gone"))


@contextmanager
def open_allocation(spec: Allocation) -> Iterator[Client]:
    """The client's side of an allocation; tasks that are not the client never come back from here."""
    check_interface(spec.network.interface)
    task = os.environ.get("SLURM_PROCID")
    if task is None:
        raise ClusterError("cluster: an allocation is used inside of srun; submit the study by `sinew submit`")
    this = f"{os.environ.get('SLURM_JOB_ID')}-{os.environ.get('SLURM_RESTART_COUNT', 0)}"
    certificates = spec.folder / f"certificate-{this}"
    security = shared_certificate(certificates, create=task == "0") if spec.network.tls else None
    scheduler_file = spec.folder / f"scheduler-{this}.json"
    common: dict[str, Any] = {
        "protocol": "tls://" if security else "tcp://",
        "security": security,
        "interface": spec.network.interface,
    }
    os.environ.update(ONE_THREAD)
    try:
        runner = jobqueue().SLURMRunner(
            scheduler_file=str(scheduler_file),
            scheduler_options={**common, "dashboard_address": DASHBOARD, "plugins": [_EndWithClient()]},
            worker_class="distributed.Nanny",
            worker_options={
                **common,
                "nthreads": 1,
                "local_directory": external.scratch(Path(tempfile.gettempdir())),
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
            finally:  # else the other tasks, and srun with them, would stay until the walltime
                runner.status = Status.closed  # its own way of closing knows no TLS
                client.shutdown()
    finally:
        runner.status = Status.closed
        scheduler_file.unlink(missing_ok=True)
        shutil.rmtree(certificates, ignore_errors=True)


def join_allocation(spec: Allocation) -> None:
    """Serve as scheduler or worker if this is that task of the allocation; the client's task comes back at once.

    Raises ``SystemExit`` at the end of such a service.
    """
    if os.environ.get("SLURM_PROCID") in (None, "1"):
        return
    logging.getLogger("distributed").setLevel(logging.ERROR)
    try:
        with dask.config.set(SETTINGS), open_allocation(spec):
            raise ClusterError("cluster: this task of the allocation should have served")
    except KeyboardInterrupt:  # dask-jobqueue's way of saying that the cluster is closed
        raise SystemExit(0) from None
    finally:
        if external.SCRATCH in os.environ:  # on this node, no other task of the job has a use for it now
            shutil.rmtree(external.scratch(spec.folder), ignore_errors=True)
