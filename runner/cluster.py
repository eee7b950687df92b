"""A Dask client from a cluster specification: ``local`` processes, SLURM jobs, one allocation, or an ``address``."""

import contextlib
import logging
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import dask
from distributed import Client, LocalCluster
from distributed.security import Security

from runner.allocation import Allocation, open_allocation
from runner.errors import ClusterError
from runner.jobs import Growing, Jobs, open_jobs
from runner.periodic import every
from runner.settings import DASHBOARD, ONE_THREAD, SETTINGS, WAIT_FOR_WORKERS_S


@dataclass(frozen=True)
class Local:
    """``workers`` processes of one thread each on this machine; traffic stays on loopback, under TLS."""

    workers: int = 2
    tls: bool = True


@dataclass(frozen=True)
class Address:
    """A scheduler that runs already; its TLS files come from Dask's own configuration."""

    address: str


ClusterSpec = Local | Address | Jobs | Allocation


def free_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_client(spec: ClusterSpec) -> Iterator[Client]:
    """Start or join the cluster; stop what was started at the end.

    Raises ``ClusterError`` when it cannot be reached. Workers run with one numerical thread each.
    """
    kinds: dict[type, Callable[[Any], contextlib.AbstractContextManager[Client]]] = {
        Address: _address,
        Local: _local,
        Jobs: open_jobs,
        Allocation: open_allocation,
    }
    with (
        dask.config.set(SETTINGS),
        dask.config.set({"distributed.nanny.pre-spawn-environ": ONE_THREAD}),
        kinds[type(spec)](spec) as client,
    ):
        yield client


def wait_for_workers(client: Client, check: Callable[[], None]) -> None:
    """Wait until there is a worker. Jobs may wait in a queue for days, other workers come at once or not at all.

    ``check`` is called now and then and may raise. Raises ``ClusterError`` when none will come.
    """
    until = math.inf if isinstance(client.cluster, Growing) else time.monotonic() + WAIT_FOR_WORKERS_S
    while True:
        with contextlib.suppress(TimeoutError):
            client.wait_for_workers(1, timeout=1.0)
            return
        check()
        if time.monotonic() > until:
            raise ClusterError(f"the cluster has no worker after {WAIT_FOR_WORKERS_S:g} s; start some")


def ask_for(client: Client, slots: int) -> None:
    """Say how many workers would have something to do now; clusters that can grow, grow towards it.

    Raises ``ClusterError`` when the cluster's jobs do not come to work.
    """
    if isinstance(client.cluster, Growing):
        client.cluster.wanted_slots = slots
        if client.cluster.failure is not None:
            raise client.cluster.failure


@contextmanager
def _address(spec: Address) -> Iterator[Client]:
    try:
        client = Client(spec.address, timeout="10 s", set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"cluster.address: no scheduler at {spec.address} ({error})") from error
    with client:
        yield client


@contextmanager
def _local(spec: Local) -> Iterator[Client]:
    try:
        cluster = LocalCluster(
            n_workers=spec.workers,
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://" if spec.tls else "tcp://",
            security=Security.temporary() if spec.tls else None,
            dashboard_address=DASHBOARD,
            silence_logs=logging.ERROR,
            preload="runner.interrupts",
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

    def replace() -> None:
        if len(cluster.scheduler_info["workers"]) < workers:
            cluster.scale(workers)  # starts what is planned but gone for longer than lost-worker-timeout

    with every(2.0, replace, "sinew-workers"):
        yield
