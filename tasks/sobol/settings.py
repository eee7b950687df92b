"""The section ``sobol`` of a study."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from sinew.runner.errors import BadInput, shown
from sinew.tasks.study.fields import Specimens, TaskSettings
from sinew.tasks.study.files import read_json
from sinew.tasks.study.model import model_of
from sinew.tasks.study.settings_file import FieldError

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study


class Settings(TaskSettings):
    """A Saltelli design of ``base_samples`` x (free parameters + 2) rows, or of at least ``points`` rows.

    They come from ``scrambles`` independent scrambles of the Sobol sequence, whose scatter gives the intervals; with
    one, the intervals come from ``resamples`` of a bootstrap. ``specimens``: which to study, ``all`` or names.
    ``output``: of which of a template's outputs the indices are (left out: of the objective where there is one).
    """

    points: Annotated[int, Field(ge=1, le=10**8)] | None = None
    base_samples: Annotated[int, Field(ge=2, le=2**26)] | None = None
    specimens: Specimens = "all"
    output: str | None = None
    second_order: bool = False
    scrambles: Annotated[int, Field(ge=1, le=64)] = 8
    resamples: Annotated[int, Field(ge=10, le=100_000)] = 200
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        if self.points is not None and self.base_samples is not None:
            raise FieldError("points", "given beside base_samples", "one of the two")
        if self.base_samples is not None and self.base_samples & (self.base_samples - 1):
            raise FieldError("base_samples", str(self.base_samples), "a power of two, as the Sobol sequence needs")
        if self.scrambles & (self.scrambles - 1):
            raise FieldError("scrambles", str(self.scrambles), "a power of two: 1, 4, 8, 16")
        return self

    def check_study(self, study: Study) -> None:
        outputs = study.simulator.output_names
        if self.output is not None and self.output not in outputs:
            known = f"one of {', '.join(outputs)}" if outputs else "nothing; only templates have outputs"
            raise FieldError("output", f"no output {shown(self.output)}", known)


DEFAULT = Settings(points=20_000)


def check(study: Study, out: Path, *, extend: bool = False) -> None:
    """Refuse a study with one free parameter, and ``extend`` where there is nothing to extend."""
    if len(model_of(study.model, study.simulator.law).free) < 2:
        raise BadInput(f"{study.path}: model.parameters", "one free parameter", "at least two for Sobol indices")
    if extend and read_json(out / "sobol.json") is None:
        raise BadInput(out / "sobol.json", "is not there", "a finished `sinew sobol` to extend")
