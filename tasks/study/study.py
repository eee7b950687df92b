"""The study file: one YAML file, validated into frozen objects. Every mistake names the file, line and field."""

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, PrivateAttr, create_model, field_validator, model_validator

from sinew.runner.errors import BadInput
from sinew.tasks.data.cohort import NAME
from sinew.tasks.model import FORCE, Curve, Protocol
from sinew.tasks.registry import TASKS
from sinew.tasks.simulate.registry import AnySimulator
from sinew.tasks.simulate.settings import UniaxialSettings
from sinew.tasks.study.fields import Finite, Name, Positive, TaskSettings
from sinew.tasks.study.measured import Quantities, check_quantities
from sinew.tasks.study.model import ModelSettings, model_of
from sinew.tasks.study.settings_file import FieldError, Section, by_name, read_text, settings_in

ADDRESS = r"^(tls|tcp)://[A-Za-z0-9_.:\[\]-]+:\d+$"  # of a scheduler
S = TypeVar("S", bound=TaskSettings)

if TYPE_CHECKING:
    TaskName = str
else:
    TaskName = Literal[tuple(TASKS)]


MAX_POINTS = 2_000_000  # of all histories of a study


class HistorySettings(Section):
    """A displacement history by its corners, at ``points`` times evenly spread, and at the corners themselves."""

    time_s: Annotated[list[Finite], Field(min_length=2, max_length=10_000)]
    displacement_mm: Annotated[list[Finite], Field(min_length=2, max_length=10_000)]
    points: Annotated[int, Field(ge=3, le=1_000_000)] = 101

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.time_s) != len(self.displacement_mm):
            problem = f"{len(self.displacement_mm)} numbers beside {len(self.time_s)} of time_s"
            raise FieldError("displacement_mm", problem, "one displacement for each time")
        if any(later <= earlier for earlier, later in pairwise(self.time_s)):
            raise FieldError("time_s", "times do not increase", "increasing times")
        return self

    def curve(self, name: str) -> Curve:
        """Along it, nothing was measured."""
        times = np.union1d(np.linspace(self.time_s[0], self.time_s[-1], self.points), self.time_s)
        moved = np.interp(times, self.time_s, self.displacement_mm)
        return Curve(Protocol(name, times, moved), np.full(times.size, np.nan))


class SpecimenSettings(Section):
    """The size of the specimen of a study without measured curves."""

    length_mm: Positive
    width_mm: Positive
    thickness_mm: Positive


class LocalSettings(Section):
    name: Literal["local"] = "local"
    workers: Annotated[int, Field(ge=1, le=1024)] | None = None
    tls: bool = True


class AddressSettings(Section):
    name: Literal["address"] = "address"
    address: Annotated[str, Field(pattern=ADDRESS)]


class SlurmSettings(Section):
    """Worker jobs of a batch system. What they ask for is in the profile given to the command, never in the study."""

    name: Literal["slurm"] = "slurm"


class StoreSettings(Section):
    """``points_per_curve``: how many points of each simulated curve are kept (``all``: every measured point)."""

    points_per_curve: Literal["all"] | Annotated[int, Field(ge=2, le=10**6)] = 96


class StudyFields(Section):
    """The fields of a study beside the sections of its tasks."""

    name: Name
    cohort: str | None = None
    protocols: dict[str, HistorySettings] | None = None
    specimen: SpecimenSettings | None = None
    measured: Quantities | None = None
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    model: ModelSettings = ModelSettings()
    simulator: AnySimulator = UniaxialSettings()
    cluster: LocalSettings | AddressSettings | SlurmSettings = Field(default=LocalSettings(), discriminator="name")
    store: StoreSettings = StoreSettings()
    retries: Annotated[int, Field(ge=0, le=20)] = 1
    tasks: Annotated[list[TaskName], Field(min_length=1)] = Field(default_factory=lambda: ["sobol", "importance"])

    _path: Path = PrivateAttr(default=Path())
    _text: str = PrivateAttr(default="")
    _solver: str | None = PrivateAttr(default=None)

    @field_validator("simulator", "cluster", mode="before")
    @classmethod
    def _by_name(cls, value: Any) -> Any:
        return by_name(value)

    @field_validator("tasks")
    @classmethod
    def _tasks_once(cls, value: list[str]) -> list[str]:
        for task in value:
            if value.count(task) > 1:
                raise ValueError(f"{task} is a duplicate; expected each task once")
        for task in value:
            before = TASKS[task].needs
            if before in value and value.index(task) < value.index(before):
                raise ValueError(f"{task} before {before}, whose results it uses; expected {before} first")
        return value

    @model_validator(mode="after")
    def _known_parameters(self) -> Self:
        model_of(self.model, self.simulator.law)
        return self

    @model_validator(mode="after")
    def _own_protocols(self) -> Self:
        if self.protocols is not None:
            if self.simulator.law != "template":
                raise FieldError("protocols", "with the tissue model", "a cohort; only templates can do without one")
            if self.cohort is not None:
                raise FieldError("protocols", "given beside cohort", "one of the two")
            for name in self.protocols:
                if not NAME.fullmatch(name):
                    raise FieldError(f"protocols.{name}", "cannot be a name", "letters, digits, '_', '-' and '.'")
            if sum(one.points + len(one.time_s) for one in self.protocols.values()) > MAX_POINTS:
                raise FieldError("protocols", f"more than {MAX_POINTS:,} points in all", "fewer points")
            if not self.protocols:
                raise FieldError("protocols", "none", "at least one")
        if self.specimen is not None and self.protocols is None:
            raise FieldError("specimen", "given without protocols", "the size in each specimen.json of the cohort")
        return self

    @model_validator(mode="after")
    def _known_quantities(self) -> Self:
        if self.measured is not None:
            check_quantities(self.measured, self.simulator.comparable, self.simulator.gives_force)
        return self

    @model_validator(mode="after")
    def _sections_fit(self) -> Self:
        for task in TASKS:
            try:
                getattr(self, task).check_study(self)
            except FieldError as error:
                raise FieldError(f"{task}.{error.field}", error.problem, error.expected) from None
        return self

    @property
    def path(self) -> Path:
        return self._path

    @property
    def text(self) -> str:
        """What the study's file held when it was read."""
        return self._text

    @property
    def solver(self) -> str | None:
        """The solver that the user names, in place of the study's."""
        return self._solver

    def section(self, kind: type[S]) -> S:
        """The section of a task, by the class of its settings."""
        return next(getattr(self, name) for name, field in type(self).model_fields.items() if field.annotation is kind)

    @property
    def compared(self) -> tuple[str, ...]:
        """The simulator's outputs that are compared with measurements besides the force."""
        return tuple(name for name in self.measured or () if name != FORCE)

    @property
    def force_noise(self) -> float | None:
        """The standard deviation of the force's noise (N), where the study gives it."""
        given = (self.measured or {}).get(FORCE)
        return given.noise if given is not None and given.noise != "estimated" else None

    @property
    def noise_given(self) -> tuple[str, ...]:
        """What is compared whose noise the study gives."""
        return tuple(name for name, one in (self.measured or {}).items() if one.noise != "estimated")

    @property
    def cohort_path(self) -> Path:
        """The cohort's folder; relative paths start at the study file."""
        if self.cohort is None:
            raise BadInput(f"{self.path}: cohort", "missing", "a cohort folder, here or by --data")
        return self.path.parent / self.cohort


def _sections() -> dict[str, Any]:
    """A field for each task of the registry."""
    found = {}
    for name, task in TASKS.items():
        module = task.module("settings")
        found[name] = (module.Settings, getattr(module, "DEFAULT", None) or module.Settings())
    return found


if TYPE_CHECKING:
    Study = StudyFields
else:
    Study = create_model("Study", __base__=StudyFields, **_sections())
    Study.__doc__ = "A validated study: :class:`StudyFields`, and a section for each task. Read by :func:`read_study`."


def read_study(path: str | Path, *, seed: int | None = None, solver: str | None = None) -> Study:
    """Read and validate a study file; ``seed`` and ``solver`` (a name on the PATH, or a path) replace the study's.

    Raises :class:`BadInput` for the first thing that is wrong.
    """
    path = Path(path)
    text = read_text(path, "study")
    study = settings_in(text, path, Study, "study", {} if seed is None else {"seed": seed})
    study._path, study._text, study._solver = path, text, solver
    return study
