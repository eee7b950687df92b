"""What sinew needs from a batch system. One module implements it for each system; nothing else knows a system's words.

The modules are registered in :mod:`sinew.runner.cluster.batch_systems`. To add a system: write a module with the
attributes and functions of :class:`BatchSystem`, and register it there.
"""

import importlib
import os
import re
import signal
import subprocess
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from sinew.runner.errors import ClusterError

COMMAND_TIMEOUT_S = 60.0


class Away(ClusterError):
    """The batch system does not answer; it may be back soon."""


class Refused(ClusterError):
    """The batch system does not take a job; ``field`` is the profile's field that it dislikes, if that is known."""

    def __init__(self, title: str, words: str, field: str | None) -> None:
        super().__init__(f"{title} refuses the job: {words}")
        self.words = words
        self.field = field


@dataclass(frozen=True)
class QueuedJob:
    """A job as the queue shows it; ``state`` in the system's own words, ``live``: it waits or runs."""

    job: str
    state: str
    reason: str
    nodes: str
    name: str
    live: bool
    running: bool


@dataclass(frozen=True)
class JobRequest:
    """What a job asks for: ``tasks`` processes of ``cores`` each, and memory per task (per core if ``tasks`` > 1).

    ``output``: its log file, in which :attr:`BatchSystem.job_in_path` stands for its number; ``options``: further
    options in the system's words.
    """

    name: str
    output: str
    cores: int
    memory_mb: int
    walltime_s: float
    options: tuple[str, ...] = ()
    tasks: int = 1


class BatchSystem(Protocol):
    """A batch system. Functions that call its commands raise ``ClusterError``, of which :class:`Away` is one."""

    @property
    def title(self) -> str:
        """Its name in messages."""

    @property
    def queue_command(self) -> str:
        """The command that shows the queue, for messages."""

    @property
    def submit_command(self) -> str:
        """The command that takes jobs, for messages."""

    @property
    def job_variable(self) -> str:
        """The environment variable that holds a job's number inside it."""

    @property
    def job_in_path(self) -> str:
        """What stands for the job's number in the name of its output file."""

    @property
    def unknown_fields(self) -> frozenset[str]:
        """Those of ``account``, ``qos``, ``constraint`` and ``partition`` that mean nothing to the system."""

    @property
    def launcher(self) -> tuple[str, ...] | None:
        """The command that starts a program as every task of an allocation; None: no such allocations."""

    # ---- on the login node

    def version(self) -> str:
        """The system's name and version."""

    def check_script(self, script: Path) -> None:
        """Ask whether a job script would be taken, without submitting it. Raises :class:`Refused`."""

    def submit(self, script: Path) -> str:
        """Submit a job script; returns the job's number. Raises :class:`Refused`."""

    def queue(self, jobs: Iterable[str] | None = None) -> dict[str, QueuedJob]:
        """The user's own jobs that are known, by number; only ``jobs``, if given. Ended jobs may be missing."""

    def cancel(self, jobs: Sequence[str]) -> None:
        """End jobs. Jobs that have ended already are ignored."""

    # ---- job scripts

    def memory_option(self, request: JobRequest) -> str:
        """The option that asks for memory."""

    def options(self, fields: Mapping[str, str]) -> tuple[str, ...]:
        """Options for the profile's ``account``, ``qos``, ``constraint`` and ``partition``, as far as given."""

    def option_problem(self, option: str) -> tuple[str, str] | None:
        """The problem of an option of the profile's ``directives``, and what is expected; None for a good one."""

    def leader_directives(self, request: JobRequest) -> list[str]:
        """The lines of a job script that ask for the job that leads."""

    def requeue_lines(self) -> list[str]:
        """Shell lines with which a job puts itself back into the queue."""

    def worker_options(self, request: JobRequest) -> dict[str, Any]:
        """Arguments of dask-jobqueue's job class for a worker job."""

    def dask_module(self) -> str:
        """The module of dask-jobqueue for this system."""

    def dask_classes(self, module: Any) -> tuple[Any, Any]:
        """The job class and the cluster class of that module."""

    def allocation_runner(self, module: Any) -> Any:
        """The runner class of that module for allocations; only where there is a :attr:`launcher`."""

    # ---- inside a job

    def job(self) -> str | None:
        """The number of the job that this process belongs to; None outside of this system's jobs."""

    def node(self) -> str:
        """The node that this process runs on; empty outside of a job."""

    def restarts(self) -> int:
        """How often this process's job has been requeued, as far as the system says."""

    def cpus(self) -> int | None:
        """The number of CPUs that this process's task was given, if the system says."""

    def task(self) -> int | None:
        """The number of this process's task in an allocation; None outside of one."""


@dataclass(frozen=True)
class Commands:
    """Runs the commands of a batch system, and turns their failures into errors.

    ``title``: the system's name in messages, ``server`` and ``daemon`` those of what answers its commands. ``submit``:
    the command that takes jobs. ``of_a_job``: environment variables of a job, which a command that is called from
    inside a job must not see. ``message``: the error message of a command that has failed, on one line. ``away``: the
    pattern of messages by which the server does not answer. ``reasons``: patterns of refusals, and the profile's field
    that each is about.
    """

    title: str
    server: str
    daemon: str
    submit: str
    of_a_job: re.Pattern[str]
    message: Callable[[subprocess.CompletedProcess[str]], str]
    away: str
    reasons: tuple[tuple[str, str], ...]

    def call(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command, whatever its exit code will be.

        Raises ``ClusterError`` when it cannot be run, and :class:`Away` when it does not end in time.
        """
        environment = {name: value for name, value in os.environ.items() if not self.of_a_job.match(name)}
        try:
            return subprocess.run(
                list(command),
                capture_output=True,
                text=True,
                errors="replace",
                timeout=COMMAND_TIMEOUT_S,
                stdin=subprocess.DEVNULL,
                env=environment,
            )
        except FileNotFoundError:
            raise ClusterError(f"{command[0]} was not found; run this on a login node, where {self.title} is") from None
        except subprocess.TimeoutExpired:
            timeout = f"{COMMAND_TIMEOUT_S:g} s"
            raise Away(f"{command[0]} gave no answer within {timeout}; is {self.daemon} running?") from None
        except OSError as error:
            raise ClusterError(f"{command[0]} cannot be run ({error.strerror})") from None

    def error(self, finished: subprocess.CompletedProcess[str]) -> ClusterError:
        """The error for a command that has failed: :class:`Away`, :class:`Refused`, or another one."""
        command, words = finished.args[0], self.message(finished)
        if re.search(self.away, words, re.IGNORECASE):
            return Away(f"{self.title}'s {self.server} does not answer ({words}); try again when it is back")
        return self.refused(words) if command == self.submit else ClusterError(f"{command}: {words}")

    def refused(self, words: str) -> Refused:
        """The error for a job that is refused with these words."""
        field = next((field for pattern, field in self.reasons if re.search(pattern, words, re.IGNORECASE)), None)
        return Refused(self.title, words, field)


def walltime(seconds: float) -> str:
    """A walltime as hours:minutes:seconds, which every batch system reads."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"


@lru_cache(maxsize=4)
def jobqueue(module: str) -> Any:
    """A module of dask-jobqueue. Importing it replaces the handler of Ctrl-C, which is put back."""
    before = signal.getsignal(signal.SIGINT)
    imported = importlib.import_module(module)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, before)
    return imported
