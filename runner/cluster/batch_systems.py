"""The batch systems that sinew works with, and the one whose job this process belongs to."""

import os
import socket
import time
from collections.abc import Callable
from typing import TypeVar

from sinew.runner.cluster import grid_engine, slurm
from sinew.runner.cluster.batch_system import Away, BatchSystem

#: By the name that a profile gives as ``batch_system``.
BATCH_SYSTEMS: dict[str, BatchSystem] = {
    "slurm": slurm,
    "grid_engine": grid_engine,
}
PATIENCE_S = 3600.0
T = TypeVar("T")


def current() -> BatchSystem | None:
    """The batch system whose job this process belongs to."""
    return next((system for system in BATCH_SYSTEMS.values() if system.job() is not None), None)


def current_job() -> str | None:
    """The number of the job that this process belongs to."""
    system = current()
    return None if system is None else system.job()


def this_node() -> str:
    """The node that this process runs on, in the batch system's words, or else the host's name."""
    system = current()
    return (system.node() if system is not None else "") or socket.gethostname()


def this_process() -> str:
    """A description of this process for people: its number, its host and its job."""
    system = current()
    job = f", {system.title} job {system.job()}" if system is not None else ""
    return f"process {os.getpid()} on {socket.gethostname()}{job}"


def patiently(ask: Callable[[], T]) -> T:
    """The answer to a question; inside a job, ask for up to an hour while the batch system does not answer."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return ask()
        except Away:
            if current_job() is None or time.monotonic() > until:
                raise
            time.sleep(5.0)
