"""A Dask client from a cluster specification: ``local`` processes or the ``address`` of a running scheduler."""

import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import dask
from distributed import Client, LocalCluster
from distributed.security import Security

from runner.errors import ClusterError


@dataclass(frozen=True)
class Local:
    """``workers`` processes of one thread each on this machine; traffic stays on loopback, under TLS."""

    workers: int = 2
    tls: bool = True


@dataclass(frozen=True)
class Address:
    """A scheduler that runs already; its TLS files come from Dask's own configuration."""

    address: str


ClusterSpec = Local | Address

_SETTINGS = {
    "distributed.scheduler.worker-saturation": 1.1,  # one batch runs and one waits on each worker
    "distributed.scheduler.allowed-failures": 3,
    "distributed.scheduler.work-stealing": False,
    "distributed.worker.profile.enabled": False,
    "distributed.diagnostics.nvml": False,
    # logs of messages would keep every batch that was ever sent
    "distributed.admin.low-level-log-length": 10,
    "distributed.admin.log-length": 100,
    "distributed.admin.tick.limit": "60 s",
    "distributed.comm.timeouts.connect": "60 s",
    "distributed.deploy.lost-worker-timeout": "4 s",
    # the journal holds the results; workers keep next to nothing in memory
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "logging.distributed": "error",
}


def free_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_client(spec: ClusterSpec) -> Iterator[Client]:
    """Start or join the cluster; stop what was started at the end.

    Raises ``ClusterError`` when it cannot be reached. Workers run with one numerical thread each.
    """
    threads = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    with dask.config.set(_SETTINGS), dask.config.set({"distributed.nanny.pre-spawn-environ": threads}):
        if isinstance(spec, Address):
            try:
                client = Client(spec.address, timeout="10 s", set_as_default=False)
            except (OSError, ValueError) as error:
                raise ClusterError(f"cluster.address: no scheduler at {spec.address} ({error})") from error
            with client:
                yield client
            return
        try:
            cluster = LocalCluster(
                n_workers=spec.workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                protocol="tls://" if spec.tls else "tcp://",
                security=Security.temporary() if spec.tls else None,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.ERROR,
            )
        except (OSError, RuntimeError) as error:
            raise ClusterError(f"cluster: {spec.workers} local workers could not be started ({error})") from error
        with cluster, Client(cluster, set_as_default=False) as client, _replaced_when_lost(cluster, spec.workers):
            yield client


@contextmanager
def _replaced_when_lost(cluster: LocalCluster, workers: int) -> Iterator[None]:
    """Start workers anew whose supervisor gave up, as it does when a worker dies while it starts.

    Without this, a run whose workers are all gone would wait forever.
    """
    end = threading.Event()

    def watch() -> None:
        while not end.wait(2.0):
            if len(cluster.scheduler_info["workers"]) < workers:
                cluster.scale(workers)  # starts what is planned but gone for longer than lost-worker-timeout

    thread = threading.Thread(target=watch, name="sinew-workers", daemon=True)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()
