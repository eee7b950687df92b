"""A cluster's profile: one YAML file with what to ask of its batch system, validated. It says nothing about tissue.

A profile is code of its owner, like a job script: its prologue is run by a shell on the cluster.
"""

import shlex
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, field_validator

from sinew.runner.cluster.allocation import Allocation
from sinew.runner.cluster.batch_system import BatchSystem
from sinew.runner.cluster.batch_systems import BATCH_SYSTEMS
from sinew.runner.cluster.jobs import POLL_S, Jobs
from sinew.runner.cluster.network import Network
from sinew.runner.errors import shown
from sinew.tasks.study.settings_file import FieldError, Section, read_settings

_OPTION = r"^[A-Za-z0-9_.:@%+=,*&|()\[\]!/-]{1,200}$"
_VARIABLE = r"\$\{[A-Za-z_][A-Za-z0-9_]*\}"
_SCRATCH = rf'^(/|\$[A-Za-z_]|{_VARIABLE})([^\x00-\x1f"`\\;&|<> (){{}}]|{_VARIABLE}){{0,199}}$'
Option = Annotated[str, Field(pattern=_OPTION)]
Line = Annotated[str, Field(min_length=1, max_length=1000, pattern=r"^[^\x00-\x1f]+$")]
_WALLTIME = "D-HH:MM:SS, HH:MM:SS or MM:SS, of at least one minute and at most a year"
_MEMORY = "memory such as 4G or 4000M, at least 256M"


def _seconds(text: str) -> float:
    """The seconds of a walltime."""
    days, dash, clock = text.rpartition("-")
    parts = clock.split(":")
    if len(text) > 20 or not (
        all(part.isascii() and part.isdigit() for part in parts) and len(parts) in ((3,) if dash else (2, 3))
    ):  # SLURM reads D-HH:MM as hours and minutes
        raise ValueError(f"{shown(text)}; expected {_WALLTIME}")
    if dash and not (days.isascii() and days.isdigit()):
        raise ValueError(f"{shown(text)}; expected {_WALLTIME}")
    numbers = [int(part) for part in parts]
    seconds = 0
    for number in numbers:
        seconds = 60 * seconds + number
    seconds += 86_400 * int(days or 0)
    if not 60 <= seconds <= 366 * 86_400 or any(number > 59 for number in numbers[1:]):
        raise ValueError(f"{shown(text)}; expected {_WALLTIME}")
    return float(seconds)


def _megabytes(text: str) -> int:
    unit = {"M": 1, "G": 1024, "T": 1024**2}.get(text[-1:].upper())
    number = text[:-1]
    if unit is None or not (number.isascii() and number.isdigit()) or len(number) > 9 or int(number) * unit < 256:
        raise ValueError(f"{shown(text)}; expected {_MEMORY}")
    return int(number) * unit


class _Size(Section):
    """What one job asks for."""

    cores: Annotated[int, Field(ge=1, le=1024)] = 1
    memory: str = "4G"
    walltime: str = "1:00:00"
    partition: Option | None = None

    @field_validator("walltime", "memory")
    @classmethod
    def _readable(cls, value: str, info: Any) -> str:
        _seconds(value) if info.field_name == "walltime" else _megabytes(value)
        return value

    @property
    def walltime_s(self) -> float:
        return _seconds(self.walltime)

    @property
    def memory_mb(self) -> int:
        return _megabytes(self.memory)


class CoordinatorSettings(_Size):
    """The small job that leads: scheduler and client. It requeues itself when its walltime is near."""

    memory: str = "4G"
    walltime: str = "24:00:00"


class WorkerSettings(_Size):
    """The jobs that evaluate: from ``minimum`` to ``jobs`` of them, each with one worker on each of its ``cores``."""

    cores: Annotated[int, Field(ge=1, le=1024)] = 4
    memory: str = "8G"
    walltime: str = "4:00:00"
    jobs: Annotated[int, Field(ge=1, le=10_000)] = 4
    minimum: Annotated[int, Field(ge=0, le=10_000)] = 0
    poll_s: Annotated[float, Field(ge=1, le=600)] = POLL_S


class AllocationSettings(_Size):
    """One job for everything: ``tasks`` processes of one core each, of which two lead and the others evaluate."""

    memory: str = "2G"
    tasks: Annotated[int, Field(ge=3, le=100_000)] = 16
    walltime: str = "4:00:00"


class Profile(Section):
    """A validated profile. Build it by :func:`read_profile`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
    batch_system: str = "slurm"
    mode: Literal["jobs", "allocation"] = "jobs"
    account: Option | None = None
    partition: Option | None = None
    qos: Option | None = None
    constraint: Option | None = None
    directives: list[str] = Field(default_factory=list)
    modules: list[Option] = Field(default_factory=list)
    prologue: list[Line] = Field(default_factory=list)
    interface: Annotated[str, Field(pattern=r"^[A-Za-z0-9_.:@-]{1,15}$")] | None = None
    scratch: Annotated[str, Field(pattern=_SCRATCH)] | None = None
    tls: bool = True
    job_script: str | None = None
    coordinator: CoordinatorSettings = CoordinatorSettings()
    workers: WorkerSettings = WorkerSettings()
    allocation: AllocationSettings = AllocationSettings()

    _path: Path = PrivateAttr(default=Path())

    @field_validator("directives")
    @classmethod
    def _options_of_the_system(cls, value: list[str], info: Any) -> list[str]:
        system = BATCH_SYSTEMS[info.data.get("batch_system", "slurm")]
        for i, option in enumerate(value):
            if (problem := system.option_problem(option)) is not None:
                raise FieldError(str(i), *problem)
        return value

    @field_validator("batch_system")
    @classmethod
    def _registered(cls, value: str) -> str:
        if value not in BATCH_SYSTEMS:
            raise ValueError(f"{shown(value)}; expected one of {' or '.join(map(repr, BATCH_SYSTEMS))}")
        return value

    @field_validator("mode")
    @classmethod
    def _offered(cls, value: str, info: Any) -> str:
        system = BATCH_SYSTEMS[info.data.get("batch_system", "slurm")]
        if value == "allocation" and system.launcher is None:
            raise ValueError(f"{shown(value)} is not offered with {system.title}; expected 'jobs'")
        return value

    @field_validator("account", "qos", "constraint", "partition")
    @classmethod
    def _known_to_the_system(cls, value: str | None, info: Any) -> str | None:
        system = BATCH_SYSTEMS[info.data.get("batch_system", "slurm")]
        if value is not None and info.field_name in system.unknown_fields:
            problem = f"{shown(value)}, but {system.title} has no {info.field_name}"
            raise ValueError(f"{problem}; expected another field, or an option in directives")
        return value

    @field_validator("job_script")
    @classmethod
    def _beside(cls, value: str | None, info: Any) -> str | None:
        if value is not None:
            folder = info.context["folder"]
            try:
                beside = (folder / value).resolve().is_relative_to(folder.resolve()) and (folder / value).is_file()
            except (ValueError, RuntimeError, OSError):
                beside = False
            if not beside:
                raise ValueError(f"{shown(value)} is no file there; expected a template beside")
        return value

    @field_validator("workers")
    @classmethod
    def _limits(cls, value: WorkerSettings) -> WorkerSettings:
        if value.minimum > value.jobs:
            raise FieldError("minimum", f"{value.minimum} is above jobs {value.jobs}", "at most jobs")
        return value

    @property
    def path(self) -> Path:
        return self._path

    @property
    def leader(self) -> CoordinatorSettings | AllocationSettings:
        """The job that is submitted from the login node."""
        return self.coordinator if self.mode == "jobs" else self.allocation

    @property
    def system(self) -> BatchSystem:
        return BATCH_SYSTEMS[self.batch_system]

    def options(self, size: _Size) -> tuple[str, ...]:
        """The options that the profile adds to those of every job."""
        fields = {name: getattr(self, name) for name in ("account", "qos", "constraint")}
        fields["partition"] = size.partition or self.partition
        given = {name: value for name, value in fields.items() if value is not None}
        return (*self.system.options(given), *self.directives)

    def shell_lines(self) -> tuple[str, ...]:
        """What a job does before it starts anything."""
        return (*(f"module load {shlex.quote(name)}" for name in self.modules), *self.prologue)

    def cluster(self, study: str, folder: Path) -> Jobs | Allocation:
        """The cluster for a study, with its table of jobs and their output in ``folder``."""
        if self.mode == "allocation":
            return Allocation(folder, Network(self.interface, self.tls), self.batch_system)
        return self.jobs(study, folder, self.workers)

    def one_job(self, study: str, folder: Path) -> Jobs:
        """A job like those that evaluate, to look around in."""
        size = self.workers
        if self.mode == "allocation":
            asked = self.allocation
            size = WorkerSettings(cores=asked.cores, memory=asked.memory, walltime=asked.walltime, jobs=1, poll_s=2.0)
        return self.jobs(study, folder, size)

    def jobs(self, study: str, folder: Path, workers: WorkerSettings) -> Jobs:
        """Worker jobs of this size."""
        return Jobs(
            name=study,
            folder=folder,
            maximum=workers.jobs,
            minimum=workers.minimum,
            cores=workers.cores,
            memory_mb=workers.memory_mb,
            walltime_s=workers.walltime_s,
            network=Network(self.interface, self.tls),
            directives=self.options(workers),
            prologue=self.shell_lines(),
            scratch=self.scratch,
            poll_s=workers.poll_s,
            batch_system=self.batch_system,
        )


def read_profile(path: Path) -> Profile:
    """Read and validate a profile. Raises :class:`BadInput` for the first thing that is wrong."""
    profile = read_settings(path, Profile, "profile")
    profile._path = path
    return profile
