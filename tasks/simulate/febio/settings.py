"""The settings of FEBio in a study: the solver, with the tendon's template or a template of the user's own."""

import os
import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from sinew.runner.errors import BadInput, shown
from sinew.tasks.model.effect import model_without
from sinew.tasks.simulate import Simulator, Summary
from sinew.tasks.simulate.bar_parameters import given_to_the_bar
from sinew.tasks.simulate.febio.attempt import program_hash, solver_version
from sinew.tasks.simulate.febio.constituents import NAMES
from sinew.tasks.simulate.febio.field_output import FieldOutput
from sinew.tasks.simulate.febio.files import read_files
from sinew.tasks.simulate.febio.output import Logged, Reduce
from sinew.tasks.simulate.febio.renderer import Allowance
from sinew.tasks.simulate.febio.simulator import FEBio, Template, inside
from sinew.tasks.simulate.febio.template import OwnTemplate, check_template, with_constituents
from sinew.tasks.simulate.febio.tendon import read_template
from sinew.tasks.simulate.settings import Law, Purpose, SimulatorSettings, SolverMissing
from sinew.tasks.study.fields import Finite, Name, Unit
from sinew.tasks.study.settings_file import FieldError, Section
from sinew.tasks.study.trust import Request, refuse_program_of_others, require

LONGEST_S = 86_400 * 30
Seconds = Annotated[float, Field(gt=0, le=LONGEST_S, allow_inf_nan=False)]
Executable = Annotated[str, Field(min_length=1, pattern=r"^[^\x00-\x1f-][^\x00-\x1f]*$")]
PlotVariable = Annotated[str, Field(min_length=1, max_length=60, pattern=r"^[A-Za-z0-9][A-Za-z0-9_ .()*/+=;:'-]*$")]

MaterialPath = Annotated[str, Field(min_length=1, max_length=300, pattern=r"^[^\x00-\x1f]*$")]

FEBIO = "febio4"  # what a study may run without its user's consent
FIELDS = ("displacement", "stress", "reaction forces")  # what is kept unless the study says what
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
OF_THE_STORE = ("objective", "measured", "displacement", "time", "wall", "summary", "conf", "total", "rmse")


class TimeSteps(Section):
    """The time steps of the solver. Each step ends at a measured row; between steps the force is interpolated.

    ``ramp_s``: longest step while the displacement moves (0: every row). ``hold_growth``: in a hold, a step may grow to
    this fraction of the time since the hold began (0: every row). ``still_mm``: how far the displacement may stray
    from a constant for a stretch of time to count as a hold.
    """

    ramp_s: Annotated[float, Field(ge=0, le=LONGEST_S, allow_inf_nan=False)] = 0.0
    hold_growth: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] = 0.02
    still_mm: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.0


class SolverSettings(SimulatorSettings):
    """The solver: ``executable`` by name or path, where it stops, and how a run is limited.

    ``restart_s``: how often the state of a run is kept (s), from which it goes on when it is interrupted.
    """

    executable: Executable = FEBIO
    timeout_s: Seconds = 600.0
    max_file_mb: Annotated[int, Field(gt=0, le=1_000_000)] = 4096
    time_steps: TimeSteps = TimeSteps()
    keep_failed: Annotated[int, Field(ge=0, le=10_000)] = 20
    restart_s: Annotated[float, Field(ge=1, le=LONGEST_S, allow_inf_nan=False)] | None = None

    def build(self, purpose: Purpose) -> Simulator:
        template = self.read_template(purpose)  # before the solver, which may be on another machine only
        found, confirmed = self.found(purpose, template)
        if found is None:
            where = f"{purpose.study}: simulator.executable" if purpose.solver is None else "--solver"
            problem = f"{shown(purpose.solver or self.executable)} was not found"
            raise SolverMissing(where, problem, "febio4 on the PATH, or the path of the solver")
        version = solver_version(found, confirmed)
        simulator = self.with_solver(template, str(found), version, purpose.scratch, purpose.kept)
        return replace(simulator, confirmed=confirmed).surrounded(purpose.effects)

    def read_template(self, purpose: Purpose) -> Template:
        """The template, checked. Raises :class:`BadInput`."""
        raise NotImplementedError

    def found(self, purpose: Purpose, template: Template) -> tuple[Path | None, bytes | None]:
        """Where the solver is on this machine, and the hash of one that its user had to confirm.

        Raises :class:`BadInput` for a program that the user does not trust.
        """
        require(request := self.request(purpose, template))
        if request is None:
            return _program(purpose.solver or self.executable), None
        return Path(os.fsdecode(request.contents[0])), request.contents[1]  # not looked up again: links may change

    def request(self, purpose: Purpose, template: Template) -> Request | None:
        """What only the user may allow: to run another program than ``febio4`` on what ``template`` renders."""
        program = _program(self.executable)
        if purpose.solver is not None or program is None:
            return None
        if self.executable == FEBIO and Path(str(shutil.which(FEBIO))).is_absolute():  # not by a PATH such as ".:/bin"
            return None
        refuse_program_of_others(f"{purpose.study}: simulator.executable", self.executable, f"{FEBIO}, --solver")
        return Request(
            purpose.study,
            purpose.text,
            "simulator.executable",
            f"{shown(self.executable)} would run on this machine",
            f"{FEBIO}, --solver",
            (os.fsencode(program), program_hash(program), *_as_bytes(template.files)),
            f"{program} may read or run other files: a change of these is not asked about again",
        )

    def with_solver(
        self, template: Template, executable: str, version: str, scratch: Path, kept: Path | None = None
    ) -> FEBio:
        """The simulator with a solver that is known, by these settings; ``kept`` is the folder of kept runs."""
        steps = self.time_steps
        return FEBio(
            executable, version, template, scratch, timeout_s=self.timeout_s, max_file_bytes=self.max_file_mb * 2**20,
            ramp_s=steps.ramp_s, hold_growth=steps.hold_growth, still_mm=steps.still_mm, keep_failed=self.keep_failed,
            restart_s=self.restart_s,
        )  # fmt: skip


def _program(executable: str) -> Path | None:
    found = shutil.which(executable)
    return None if found is None or not Path(found).is_file() else Path(found).resolve()


def _as_bytes(files: Mapping[str, str]) -> tuple[bytes, ...]:
    return tuple(part.encode() for name, text in sorted(files.items()) for part in (name, text))


class FEBioSettings(SolverSettings):
    """The tendon in FEBio: ``template`` beside the study file, by default the built-in one."""

    template_field: ClassVar[str | None] = "template"

    name: Literal["febio"] = "febio"
    template: str | None = None

    @property
    def like_embedded(self) -> bool:
        return self.template is None

    def read_template(self, purpose: Purpose) -> Template:
        template = read_template(purpose.study.parent, self.template)
        return template.with_effects(inside(template, purpose.effects))


class OutputSettings(Section):
    """A quantity of the solver's log file: ``item`` of ``data``, of a ``set`` or some ``ids``, made one number.

    Or one of its plot file: a ``component`` of ``field``. ``reduce`` says how; that is times ``scale``, in ``unit``.
    ``at_rest`` is its value before the first step, of which FEBio logs nothing. ``summary`` makes one number of its
    course, for the tasks that need one.
    """

    data: Literal["node_data", "element_data", "rigid_body_data"] | None = None
    item: Annotated[str, Field(max_length=64, pattern=r"^[A-Za-z][A-Za-z0-9_ .\[\]()^*/+-]*$")] | None = None
    field: PlotVariable | None = None
    component: Annotated[str, Field(min_length=1, max_length=20, pattern=r"^[A-Za-z0-9_]+$")] | None = None
    set: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    ids: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1, max_length=100_000)] | None = None
    reduce: Reduce = "single"
    scale: Finite = 1.0
    unit: Unit = "1"
    at_rest: Finite = 0.0
    summary: Summary = "max"

    @model_validator(mode="after")
    def _one_choice(self) -> Self:
        self._check_source()
        if not self.scale:
            raise FieldError("scale", "0", "a factor other than 0")
        if self.field is not None and self.set is None and self.ids is None:
            return self  # all places
        if (self.set is None) == (self.ids is None):
            raise FieldError("ids", "beside set" if self.ids else "missing", "either ids or the name of a set")
        if self.ids is not None and len(set(self.ids)) < len(self.ids):
            raise FieldError("ids", "one of them is given twice", "each id once")
        return self

    def _check_source(self) -> None:
        if self.field is None:
            for name in ("data", "item"):
                if getattr(self, name) is None:
                    raise FieldError(name, "missing", "data and item, or field")
            if self.component is not None:
                raise FieldError("component", "without field", "it for outputs of the plot file only")
        elif self.data is not None or self.item is not None:
            raise FieldError("field", "beside data or item", "either data and item, or field")

    def logged(self, name: str) -> Logged:
        """These settings for the simulator, of an output of the log."""
        fields = self.model_dump(exclude={"ids", "field", "component"})
        return Logged(name=name, ids=tuple(self.ids or ()), **fields)

    def of_field(self, name: str) -> FieldOutput:
        """These settings for the simulator, of an output of the plot file."""
        fields = self.model_dump(exclude={"ids", "data", "item"})
        return FieldOutput(name=name, ids=tuple(self.ids or ()), **fields)


class CoarseSettings(Section):
    """A cheaper version of a model: what is different in it, the template ``file``, ``time_steps`` or some ``outputs``.

    ``rows``: how many of its runs are made for each of the model itself.
    """

    file: Annotated[str, Field(min_length=1)] | None = None
    time_steps: TimeSteps | None = None
    outputs: dict[str, OutputSettings] = Field(default_factory=dict)
    rows: Annotated[int, Field(ge=1, le=1000)] = 8

    @model_validator(mode="after")
    def _cheaper(self) -> Self:
        if self.file is None and self.time_steps is None:
            raise FieldError("file", "missing", "file or time_steps that make a run cheaper")
        return self


class TemplateSettings(SolverSettings):
    """The user's own model in FEBio: the template ``file``, and the ``outputs`` to read from the solver's log.

    With ``keep: fields``, the variables ``fields`` of the solver's plot file are kept for every row. ``force`` names
    the output that is compared with measured forces. ``settle_s``: how long the solver waits at the first displacement
    of a protocol that does not start at rest. ``fibre`` and ``matrix``: which of the model's materials effects inside
    the tissue act on, such as ``tendon.solid[2].elastic``; one may be both. ``fidelities``: what stands in for the
    model where a task can use it, the cheapest first and the model itself (``fine``) last: ``bar``, the embedded bar,
    with numbers or parameters of the model for its own, and ``coarse``, another template or larger time steps.
    """

    law: ClassVar[Law] = "template"
    template_field: ClassVar[str | None] = "file"

    name: Literal["template"] = "template"
    file: Annotated[str, Field(min_length=1)]
    outputs: Annotated[dict[str, OutputSettings], Field(min_length=1, max_length=100)]
    force: str | None = None
    max_file_mb: Annotated[int, Field(gt=0, le=1_000_000)] = 1024
    settle_s: Annotated[float, Field(ge=0, le=LONGEST_S, allow_inf_nan=False)] = 0.0
    fibre: MaterialPath | None = None
    matrix: MaterialPath | None = None
    fidelities: list[Literal["bar", "coarse", "fine"]] = Field(default_factory=list)
    bar: dict[str, Name | Finite] = Field(default_factory=dict)
    coarse: CoarseSettings | None = None
    keep: Literal["nothing", "fields"] = "nothing"
    fields: Annotated[list[PlotVariable], Field(min_length=1, max_length=50)] = Field(default_factory=lambda: [*FIELDS])

    @property
    def constituents(self) -> dict[str, str]:
        """Paths of the materials that are the fibre and the matrix, as far as they are given."""
        return {name: path for name in NAMES if (path := getattr(self, name)) is not None}

    @property
    def cheaper(self) -> tuple[str, ...]:
        return tuple(self.fidelities[:-1])

    @property
    def coarse_rows(self) -> int:
        return 0 if self.coarse is None else self.coarse.rows

    @property
    def further_templates(self) -> tuple[str, ...]:
        return () if self.coarse is None or self.coarse.file is None else (self.coarse.file,)

    def coarser(self) -> "TemplateSettings":
        """The settings of the coarse version."""
        assert self.coarse is not None, "it is there where fidelities name it"
        given = {"file": self.coarse.file, "time_steps": self.coarse.time_steps}
        changed = {name: value for name, value in given.items() if value is not None}
        outputs = {name: self.coarse.outputs.get(name, output) for name, output in self.outputs.items()}
        return self.model_copy(update={**changed, "outputs": outputs, "keep": "nothing", "fidelities": []})

    def of_the_bar(self, purpose: Purpose) -> dict[str, str | float]:
        """What each parameter of the bar is, by name; effects are left out of it. Raises :class:`BadInput`."""
        if not purpose.sized:
            raise BadInput(f"{purpose.study}: simulator.fidelities", "a bar without a size", "specimen: its dimensions")
        names = model_without(purpose.model, purpose.effects).names
        return given_to_the_bar(self.bar, names, f"{purpose.study}: simulator.bar")

    def request(self, purpose: Purpose, template: Template, coarse: Template | None = None) -> Request | None:
        found = super().request(purpose, template)
        if found is None or not self.further_templates:
            return found
        further = coarse or self.coarser().read_template(purpose)
        return replace(found, contents=(*found.contents, *_as_bytes(further.files)))

    @property
    def output_names(self) -> tuple[str, ...]:
        return tuple(self.outputs)

    @property
    def comparable(self) -> dict[str, str]:
        return {name: output.unit for name, output in self.outputs.items() if name != self.force}

    @property
    def gives_force(self) -> bool:
        return self.force is not None

    def read_template(self, purpose: Purpose) -> Template:
        allowance = Allowance()
        main, files = read_files(purpose.study.parent, self.file, allowance)
        outputs = tuple(output.logged(name) for name, output in self.outputs.items() if output.field is None)
        fields = tuple(output.of_field(name) for name, output in self.outputs.items() if output.field is not None)
        template = OwnTemplate(files, main, outputs, self.force, self.settle_s, fields)
        if purpose.effects:
            self.refuse_around(f"{purpose.study}: model.effects")
        bare, sized = model_without(purpose.model, purpose.effects), purpose.sized
        check_template(purpose.study, template, bare, sized=sized, moved=self.gives_force, allowance=allowance)
        template = with_constituents(purpose.study, template, bare, self.constituents, sized=sized, allowance=allowance)
        within = inside(template, purpose.effects)
        for effect in within:
            if (why := template.why_not(effect)) is not None:
                expected = "effects that this template can have (docs/own_model.md)"
                raise BadInput(f"{purpose.study}: model.effects", f"{effect.name}: {why}", expected)
        if not template.can_have(within):
            names = ", ".join(effect.name for effect in within)
            raise BadInput(f"{purpose.study}: model.effects", f"one input cannot have {names}", "fewer of them at once")
        if "coarse" in self.cheaper:
            self.coarser().read_template(purpose)
        if "bar" in self.cheaper:
            self.of_the_bar(purpose)
        return template.with_effects(within)

    def with_solver(
        self, template: Template, executable: str, version: str, scratch: Path, kept: Path | None = None
    ) -> FEBio:
        found = super().with_solver(template, executable, version, scratch)
        if self.keep == "nothing":
            return found
        asked = dict.fromkeys((*self.fields, *(output.field for output in self.outputs.values() if output.field)))
        return replace(found, plotted=tuple(asked), kept=kept)

    def refuse_around(self, where: str) -> None:
        if not self.gives_force:
            raise BadInput(where, "without a force", "simulator.force: the output that effects act on")
        if self.keep == "fields":
            raise BadInput(where, "with keep: fields", "keep: nothing (runs with effects keep no fields)")

    @model_validator(mode="after")
    def _fidelities(self) -> Self:
        order = [name for name in ("bar", "coarse", "fine") if name in self.fidelities]
        if self.fidelities and (self.fidelities != order or order[-1] != "fine" or len(order) == 1):
            expected = "some of [bar, coarse, fine] in this order, fine among them"
            raise FieldError("fidelities", str(self.fidelities), expected)
        if "bar" in self.fidelities and self.force is None:
            raise FieldError("fidelities", "bar without a force", "force: the output that is the force")
        for name in ("bar", "coarse"):
            if name in self.model_fields_set and name not in self.fidelities:
                raise FieldError(name, "not among the fidelities", f"{name} in fidelities, or no {name}")
        if "coarse" in self.fidelities:
            self._check_coarse()
        return self

    def _check_coarse(self) -> None:
        if self.coarse is None:
            raise FieldError("coarse", "missing", "what is different in it: file or time_steps")
        for name, output in self.coarse.outputs.items():
            if name not in self.outputs:
                raise FieldError(f"coarse.outputs.{name}", "no output", f"one of {', '.join(self.outputs)}")
            if output.field is not None:
                raise FieldError(f"coarse.outputs.{name}.field", "of the plot file", "data and item of the log")
        for name, output in self.coarser().outputs.items():
            if output.field is not None:
                raise FieldError("fidelities", f"coarse with {name}, of the plot file", f"coarse.outputs.{name}")
        if self.coarse.file is not None and PurePath(self.coarse.file).parent != PurePath(self.file).parent:
            raise FieldError("coarse.file", shown(self.coarse.file), "a template in the folder of file")

    @model_validator(mode="after")
    def _no_restarts_with_fields(self) -> Self:
        if self.restart_s is not None and self.keep == "fields":
            raise FieldError("restart_s", "given with keep: fields", "one of them: a plot file does not go on")
        return self

    @model_validator(mode="after")
    def _names(self) -> Self:
        for name, output in self.outputs.items():
            if output.field is not None and self.keep != "fields":
                raise FieldError(f"outputs.{name}.field", "without keep: fields", "keep: fields beside outputs")
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
