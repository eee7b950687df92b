"""Which simulator a study asks for, and what that is told. Settings only; :mod:`tasks.simulate` does the work."""

import re
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tasks.problems import shown
from tasks.settings import FieldError, Section
from tasks.simulate import Summary
from tasks.simulate.template import Logged, Reduce

Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0, le=86_400 * 30, allow_inf_nan=False)]
Executable = Annotated[str, Field(min_length=1, pattern=r"^[^\x00-\x1f-][^\x00-\x1f]*$")]
Unit = Annotated[str, Field(min_length=1, max_length=24, pattern=r"^[^\x00-\x1f]*$")]

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
OF_THE_STORE = ("objective", "measured", "displacement", "time", "wall", "summary", "conf", "total")


class UniaxialSettings(Section):
    name: Literal["uniaxial"] = "uniaxial"


class TimeSteps(Section):
    """Where the solver steps. All steps end at measured rows; between them the force is interpolated.

    ``ramp_s``: longest step while the displacement moves (0: every row). ``hold_growth``: in a hold, a step may grow to
    this fraction of the time since the hold began (0: every row). ``still_mm``: how far the displacement may stray
    from a constant for a stretch of time to count as a hold.
    """

    ramp_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    hold_growth: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] = 0.02
    still_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0


class FEBioSettings(Section):
    """The real solver: ``executable`` by name or path, ``template`` beside the study file (default: the tendon)."""

    name: Literal["febio"] = "febio"
    executable: Executable = "febio4"
    template: str | None = None
    timeout_s: Seconds = 600.0
    max_file_mb: Annotated[int, Field(gt=0, le=1_000_000)] = 4096
    time_steps: TimeSteps = TimeSteps()
    keep_failed: Annotated[int, Field(ge=0, le=10_000)] = 20


class OutputSettings(Section):
    """A quantity of the solver's log file: ``item`` of ``data``, of a ``set`` or some ``ids``, made one number.

    ``reduce`` says how; that is times ``scale``, in ``unit``. ``at_rest`` is its value before the first step, of which
    FEBio logs nothing. ``summary`` makes one number of its course, for the tasks that need one.
    """

    data: Literal["node_data", "element_data", "rigid_body_data"]
    item: Annotated[str, Field(max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_ .\[\]()^*/+-]*$")]
    set: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    ids: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1, max_length=100_000)] | None = None
    reduce: Reduce = "single"
    scale: Finite = 1.0
    unit: Unit = "1"
    at_rest: Finite = 0.0
    summary: Summary = "max"

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        if (self.set is None) == (self.ids is None):
            raise FieldError("ids", "beside set" if self.ids else "missing", "either ids or the name of a set")
        if self.ids is not None and len(set(self.ids)) < len(self.ids):
            raise FieldError("ids", "one of them is given twice", "each id once")
        return self

    def logged(self, name: str) -> Logged:
        """What the simulator is told."""
        told = self.model_dump(exclude={"ids"})
        return Logged(name=name, ids=tuple(self.ids or ()), **told)


class TemplateSettings(Section):
    """The real solver on an input of one's own: the template ``file``, and what to read of the solver's log.

    ``force`` names the output that is compared with measured forces. ``settle_s``: how long the solver waits at the
    first displacement of a protocol that does not start at rest.
    """

    name: Literal["template"] = "template"
    file: Annotated[str, Field(min_length=1)]
    outputs: Annotated[dict[str, OutputSettings], Field(min_length=1, max_length=100)]
    force: str | None = None
    executable: Executable = "febio4"
    timeout_s: Seconds = 600.0
    max_file_mb: Annotated[int, Field(gt=0, le=1_000_000)] = 1024
    time_steps: TimeSteps = TimeSteps()
    settle_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    keep_failed: Annotated[int, Field(ge=0, le=10_000)] = 20

    @model_validator(mode="after")
    def _names(self) -> Self:
        if self.force is not None:
            if self.force not in self.outputs:
                raise FieldError("force", shown(self.force), f"one of the outputs {', '.join(self.outputs)}")
            if self.outputs[self.force].unit != "N":
                problem = f"the force is in {self.outputs[self.force].unit!r}"
                expected = "'N', with a scale if the model has other units"
                raise FieldError(f"outputs.{self.force}.unit", problem, expected)
        for name in self.outputs:
            if not IDENTIFIER.fullmatch(name) or name in OF_THE_STORE:
                expected = "letters, digits and '_', no word of the store's"
                raise FieldError(f"outputs.{name}", "cannot be a name", expected)
            if name == "force" and self.force != "force":
                raise FieldError(f"outputs.{name}", "is not said to be the force", "force: force, or another name")
        return self
