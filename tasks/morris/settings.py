"""The section ``morris`` of a study."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from sinew.runner.errors import shown
from sinew.tasks.study.fields import Specimens, TaskSettings
from sinew.tasks.study.settings_file import FieldError

if TYPE_CHECKING:
    from sinew.tasks.study.study import Study


class Settings(TaskSettings):
    """``trajectories`` through a grid of ``levels``, each of free parameters + 1 rows for every specimen.

    ``specimens``: which to study, ``all`` or names. ``resamples``: bootstrap resamples behind the intervals.
    ``output``: of which of a template's outputs the effects are (left out: of the objective where there is one).
    """

    trajectories: Annotated[int, Field(ge=4, le=100_000)] = 50
    levels: Annotated[int, Field(ge=4, le=1000, multiple_of=2)] = 4
    specimens: Specimens = "all"
    output: str | None = None
    resamples: Annotated[int, Field(ge=10, le=100_000)] = 1000
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    def check_study(self, study: Study) -> None:
        """Refuse an output that the simulator does not have."""
        outputs = study.simulator.output_names
        if self.output is not None and self.output not in outputs:
            known = f"one of {', '.join(outputs)}" if outputs else "nothing; only templates have outputs"
            raise FieldError("output", f"no output {shown(self.output)}", known)
