"""The section ``surrogate`` of a study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.growing import TURN, sizes_up_to
from sinew.tasks.study.fields import Specimens, TaskSettings
from sinew.tasks.study.model import model_of

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study


SMALLEST = 0.002  # error that can be asked: what principal components leave out comes near to half of it
MOST_RUNS = 2000


class Settings(TaskSettings):
    """Emulators of each specimen, trained with more and more runs, at most ``runs`` of each.

    No more are added once left-out errors of every course are at most ``error``, in parts of its spread. ``growth``:
    ``active``, where the emulator is least sure, or ``even``, over all of the ranges. ``specimens``: ``all`` or names.
    """

    error: Annotated[float, Field(ge=SMALLEST, lt=1)] = 0.02
    runs: Annotated[int, Field(ge=32, le=MOST_RUNS)] = 400
    growth: Literal["active", "even"] = "active"
    specimens: Specimens = "all"


DEFAULT = Settings()


def fewest(parameters: int) -> int:
    """Runs from which an emulator of so many parameters is trained, at least: twice what a process has of numbers."""
    return max(16, 2 * (parameters + 2))


def sizes(settings: Settings, parameters: int) -> list[int]:
    """Runs after each batch: those of a plain design, but no fewer in the first than an emulator takes."""
    return [size for size in sizes_up_to(settings.runs) if size >= fewest(parameters)]


def check(study: Study, out: Path) -> None:
    """Refuse a study without free parameters, and one with more of them than its runs can tell of."""
    free = len(model_of(study.model, study.simulator.law).free)
    if not free:
        raise BadInput(f"{study.path}: model.parameters", "no free parameter", "at least one for an emulator")
    settings = study.section(Settings)
    if not sizes(settings, free):
        expected = f"at least {TURN * -(-fewest(free) // TURN)} for {free} free parameters"
        raise BadInput(f"{study.path}: surrogate.runs", f"{settings.runs}", expected)
