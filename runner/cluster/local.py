"""Workers on this machine: as many as asked for, also when some of them are killed while they start."""

import logging
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster
from distributed.core import Status
from distributed.worker_memory import parse_memory_limit

from sinew.runner.cluster.dask_settings import DASHBOARD
from sinew.runner.cluster.network import shared_certificate
from sinew.runner.cluster.terminal import children_write_to
from sinew.runner.errors import ClusterError
from sinew.runner.evaluation import external
from sinew.runner.files import own_folder, remove_folder
from sinew.runner.periodic import every
from sinew.runner.temporary import temporary_folder

LOOK_S = 2.0
TRIES = 5  # in a row, none of which started a worker

log = logging.getLogger("sinew")


@dataclass(frozen=True)
class Local:
    """``workers`` processes of one thread each on this machine; traffic stays on loopback, under TLS."""

    workers: int = 2
    tls: bool = True


class LocalWorkers(LocalCluster):
    """A cluster on this machine; ``failure``: why it has no workers, if none can be started any more."""

    failure: ClusterError | None = None


@contextmanager
def open_local(spec: Local, folder: Path | None = None) -> Iterator[Client]:
    """A client of new local workers, which end with the ``with`` block. Raises ``ClusterError``.

    ``folder``: for the workers' own files and the certificate of the run; it is removed at the end. When this process
    is killed it stays, so whoever names it removes it before the next run. One that nobody names is removed by the
    next process that makes a temporary folder.
    """
    with ExitStack() as stack:
        place = folder or stack.enter_context(temporary_folder()) / "workers"
        stack.callback(remove_folder, place)
        place.parent.mkdir(parents=True, exist_ok=True)
        own_folder(place)  # Dask puts it on the path from which modules are imported
        stack.enter_context(children_write_to(place / "errors"))
        yield stack.enter_context(_open_cluster(spec, place))


@contextmanager
def _open_cluster(spec: Local, place: Path) -> Iterator[Client]:
    try:
        # in files: a key that is a text, Dask writes to a temporary folder for a moment, where a kill would leave it
        security = shared_certificate(place / "certificate", create=True) if spec.tls else None
        cluster = LocalWorkers(  # type: ignore[no-untyped-call]
            n_workers=0,  # a worker that dies while it starts would end the cluster; see WorkerStarter
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            protocol="tls://" if spec.tls else "tcp://",
            security=security,
            dashboard_address=DASHBOARD,
            silence_logs=logging.ERROR,
            memory_limit=parse_memory_limit("auto", 1, spec.workers, logger=log),
            preload="sinew.runner.cluster.interrupts",
            scheduler_kwargs={"local_directory": str(place)},
            local_directory=str(place),
        )
    except (OSError, RuntimeError) as error:
        raise ClusterError(f"cluster: the scheduler could not be started ({error})") from error
    with cluster:
        starter = WorkerStarter(cluster, spec.workers, place / "errors")
        starter.start()
        with Client(cluster, set_as_default=False) as client, every(LOOK_S, starter.look, "sinew-workers"):
            yield client


class WorkerStarter:
    """Starts the workers of a local cluster, and starts them anew where Dask gave up.

    Dask restarts a worker that dies, but not one that dies while it starts for the first time.
    """

    def __init__(self, cluster: Any, workers: int, errors: Path) -> None:
        self.cluster, self.workers, self.errors = cluster, workers, errors
        self.failures = 0
        self.busy = False

    def start(self) -> None:
        """Start all workers. Raises ``ClusterError`` when not even one of them starts in several tries."""
        resource_tracker.ensure_running()  # starting it lets interrupts in again
        self.cluster.sync(_shield_from_interrupts)
        while not self.cluster.sync(self._start_missing):
            if self.cluster.failure is not None:
                raise self.cluster.failure

    def look(self) -> None:
        """Start workers that are gone. Returns at once; called periodically."""
        self.cluster.loop.add_callback(self._start_missing)

    async def _start_missing(self) -> bool:
        """Start the workers that are missing; whether at least one is there. Raises nothing."""
        if self.busy or self.cluster.status != Status.running:
            return True
        self.busy, reason = True, ""
        try:
            for name, nanny in list(self.cluster.workers.items()):
                if nanny.status in (Status.closed, Status.failed):
                    del self.cluster.workers[name]
            while len(self.cluster.worker_spec) < self.workers:
                self.cluster.worker_spec.update(self.cluster.new_worker_spec())
            await self.cluster
        except (TimeoutError, OSError, RuntimeError) as error:
            said = [line.strip() for line in external.tail(self.errors).splitlines() if line.strip()]
            reason = said[-1] if said else str(error.__cause__ or error)
            log.warning("worker", extra={"error": reason})
            self.failures += 1
        finally:
            self.busy = False
        if any(nanny.status == Status.running for nanny in self.cluster.workers.values()):
            self.failures = 0
            return True
        if self.failures >= TRIES:
            words = f"cluster: {self.workers} local workers could not be started ({reason})"
            self.cluster.failure = ClusterError(words)
        return False


async def _shield_from_interrupts() -> Any:
    """Ctrl-C in a terminal reaches all processes: those that this thread starts get the signal only when they want it.

    The main process ends them. Without this, a worker that is still importing would die of it with a traceback.
    """
    return signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
