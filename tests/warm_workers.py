"""Local workers that the tests of one process share, where workers are not what a test is about.

To start two of them, and to import there what they need, takes seconds, for each of a few hundred runs of a study.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from distributed import Client, Worker

from sinew.runner.cluster import client as opening
from sinew.runner.cluster.client import ClusterSpec
from sinew.runner.cluster.local import Local, open_local


class WarmWorkers:
    """What :func:`sinew.runner.cluster.client.open_client` opens; local workers are kept for whoever asks next.

    Those that a run left busy, or not all of which are there, are closed.
    """

    def __init__(self) -> None:
        self.kept: dict[Local, tuple[ExitStack, Client]] = {}

    @contextmanager
    def open_client(self, spec: ClusterSpec, folder: Path | None = None) -> Iterator[Client]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(opening, "open_local", self._open_local)
            with opening.open_client(spec, folder) as client:
                yield client

    @contextmanager
    def _open_local(self, spec: Local, folder: Path | None = None) -> Iterator[Client]:
        if spec not in self.kept:
            stack = ExitStack()
            self.kept[spec] = stack, stack.enter_context(open_local(spec, None))
        stack, first = self.kept[spec]
        try:
            with Client(first.cluster, set_as_default=False) as client:
                yield client
        finally:
            if first.cluster.failure is not None or not _idle(first, spec.workers):
                del self.kept[spec]
                stack.close()

    def close(self) -> None:
        while self.kept:
            self.kept.popitem()[1][0].close()


def _idle(client: Client, workers: int) -> bool:
    """Whether all workers are there, and none does anything: what a run gave up is not at once ended there."""
    working = client.processing()
    return len(working) == workers and not any(working.values()) and not any(client.run(_threads_at_work).values())


def _threads_at_work(dask_worker: Worker) -> int:
    return len(dask_worker.active_threads)
