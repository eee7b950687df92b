"""Kinds of fields that several sections of a study have, and the base of the tasks' sections."""

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import AfterValidator, Field

from sinew.runner.errors import shown
from sinew.tasks.study.settings_file import Section

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
#: Nothing that a terminal or a page would not show as it stands: control, direction and invisible characters.
Unit = Annotated[
    str,
    Field(
        min_length=1,
        max_length=24,
        pattern="^[^\x00-\x1f\x7f-\xa0\xad\u200b-\u200f\u2028-\u202f\u2060-\u206f\ufeff\U000e0000-\U000e0fff]*$",
    ),
]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


def _once(value: Any) -> Any:
    seen = set[str]()
    for name in value if isinstance(value, list) else ():
        if name in seen:
            raise ValueError(f"{shown(name)} is a duplicate; expected each specimen once")
        seen.add(name)
    return value


Specimens = Annotated[Literal["all"] | Annotated[list[str], Field(min_length=1)], AfterValidator(_once)]


class TaskSettings(Section):
    """The section of a task in the study file."""

    def check_study(self, study: "Study") -> None:
        """Check fields that depend on the rest of the study. Raises :class:`FieldError` with the field's name."""
