"""A Dask client from a cluster specification: local processes, jobs, one allocation, or a scheduler's address."""

import contextlib
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import dask
from distributed import Client
from distributed.security import Security

from sinew.runner.cluster.allocation import Allocation, open_allocation
from sinew.runner.cluster.dask_settings import ENVIRONMENT, SETTINGS, WAIT_FOR_WORKERS_S
from sinew.runner.cluster.jobs import Jobs, open_jobs
from sinew.runner.cluster.keeper import Growing
from sinew.runner.cluster.local import Local, LocalWorkers, open_local
from sinew.runner.errors import ClusterError

ADDRESS_S = 10.0  # to connect to a scheduler that runs already


@dataclass(frozen=True)
class Address:
    """A running scheduler; its TLS files come from Dask's own configuration."""

    address: str


ClusterSpec = Local | Address | Jobs | Allocation


def free_cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_client(spec: ClusterSpec, folder: Path | None = None) -> Iterator[Client]:
    """Start or join a cluster; a cluster that was started here ends with the ``with`` block.

    Local workers keep their own files in ``folder``, by default one among the system's temporary ones; it is removed
    at the end. Raises ``ClusterError`` when the cluster cannot be reached. Workers use one numerical thread each.
    """
    kinds: dict[type, Callable[[Any], contextlib.AbstractContextManager[Client]]] = {
        Address: _address,
        Local: partial(open_local, folder=folder),
        Jobs: open_jobs,
        Allocation: open_allocation,
    }
    with (
        dask.config.set(SETTINGS),
        dask.config.set({"distributed.nanny.pre-spawn-environ": ENVIRONMENT}),
        kinds[type(spec)](spec) as client,
    ):
        yield client


def wait_for_workers(client: Client, check: Callable[[], None]) -> None:
    """Wait for the first worker. Jobs may wait in a queue for days; other workers start at once or not at all.

    ``check`` is called every second and may raise. Raises ``ClusterError`` when no worker starts.
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
    """Tell a cluster of jobs how many workers have something to do now; other clusters do not change.

    Raises ``ClusterError`` when the cluster's jobs or local workers do not start to work.
    """
    if isinstance(client.cluster, Growing):
        client.cluster.wanted_slots = slots
    if isinstance(client.cluster, Growing | LocalWorkers) and client.cluster.failure is not None:
        raise client.cluster.failure


@contextmanager
def _address(spec: Address) -> Iterator[Client]:
    if spec.address.startswith("tls://") and not Security().get_connection_args("client").get("ssl_context"):
        words = "is encrypted, but Dask's configuration names no certificate (distributed.comm.tls)"
        raise ClusterError(f"cluster.address: {spec.address} {words}")
    try:
        client = Client(spec.address, timeout=ADDRESS_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"cluster.address: no scheduler at {spec.address} ({error})") from error
    with client:
        yield client
