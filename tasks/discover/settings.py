"""The section ``discover`` of a study."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, field_validator

from sinew.runner.errors import BadInput, shown
from sinew.tasks.model.effects import library
from sinew.tasks.study.fields import Specimens, TaskSettings

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study


class Settings(TaskSettings):
    """Which ``effects`` of the library are candidates, and from how many ``starts`` the model without them is fitted.

    ``chance``: how often some cell of the whole cohort may look wrong where nothing is. ``laws``: whether a law is
    looked for that describes what the library leaves.
    """

    specimens: Specimens = "all"
    effects: Literal["all"] | Annotated[list[str], Field(min_length=1)] = "all"
    starts: Annotated[int, Field(ge=1, le=100)] = 4
    chance: Annotated[float, Field(gt=0, lt=0.5)] = 0.05
    laws: bool = True

    @field_validator("effects")
    @classmethod
    def _known(cls, value: list[str] | str) -> list[str] | str:
        if isinstance(value, list) and (unknown := [slug for slug in value if slug not in library()]):
            raise ValueError(f"{shown(unknown[0])} is no effect; expected some of {', '.join(library())}")
        return value


def check(study: "Study", out: Path) -> None:
    """Refuse effects that can neither act around a user's own model nor, as far as the study says, inside it."""
    if study.simulator.law == "tendon":
        return
    study.simulator.refuse_around(f"{study.path}: discover")
    asked = study.section(Settings).effects
    can = {
        slug for slug, effect in library().items() if effect.around or (effect.febio and study.simulator.constituents)
    }
    if asked != "all" and (others := [slug for slug in asked if slug not in can]):
        named = "" if study.simulator.constituents else ", or simulator.fibre and simulator.matrix for those inside"
        problem = f"{', '.join(others)}: not with this template"
        raise BadInput(f"{study.path}: discover.effects", problem, f"some of {', '.join(sorted(can))}, or all{named}")
