"""The real solver: FEBio 4, run once for each parameter set and protocol on an input rendered from a template.

For each run, the template is rendered in a process of its own (:mod:`sinew.tasks.simulate.febio.renderer`), the solver
runs in a directory and a process group of its own (:mod:`sinew.tasks.simulate.febio.attempt`), and what it logged is
brought to the times of the protocol.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from typing import Protocol as Interface

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, Simulator, rmse_of
from sinew.tasks.simulate.around import Around
from sinew.tasks.simulate.febio.attempt import INPUT, attempt, confinement
from sinew.tasks.simulate.febio.field_output import FieldOutput, field_course
from sinew.tasks.simulate.febio.output import Logged, read_output, read_output_at, slack, what_of
from sinew.tasks.simulate.febio.plot_file import PlotFile, read_plot_file
from sinew.tasks.simulate.febio.plot_request import PLOT, with_plot_file
from sinew.tasks.simulate.febio.renderer import render_input
from sinew.tasks.simulate.febio.stepping import at_every_row, from_rest, solver_steps
from sinew.tasks.simulate.near import Near
from sinew.tasks.simulate.row_by_row import Failed, row_by_row

if TYPE_CHECKING:
    from sinew.tasks.simulate.febio.keeping import Keeper
    from sinew.tasks.simulate.febio.kept import Run


class Template(Interface):
    """What distinguishes one kind of template from another.

    ``files`` by name, of which ``main`` is rendered. ``logs``: the log files that are read, and the output in each.
    ``fields``: outputs that are computed from the plot file.
    ``logs_itself``: the template writes these log files at exactly the asked times; else sinew adds them to the input.
    ``loaded_at_rest``: there is force at zero displacement, so the solver waits before it starts.
    """

    @property
    def name(self) -> str:
        """The name of the simulator."""
        ...

    @property
    def files(self) -> Mapping[str, str]: ...

    @property
    def main(self) -> str: ...

    @property
    def logs(self) -> tuple[tuple[str, Logged], ...]: ...

    @property
    def fields(self) -> tuple[FieldOutput, ...]: ...

    @property
    def logs_itself(self) -> bool: ...

    @property
    def loaded_at_rest(self) -> bool: ...

    @property
    def capabilities(self) -> Capabilities: ...

    def identity(self, ramp_s: float, hold_growth: float, still_mm: float) -> dict[str, Any]: ...

    def settling(self, model: Model, values: Array) -> float: ...

    def variables(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, times: Array, displacements: Array
    ) -> dict[str, Any]: ...

    def can_have(self, effects: tuple[Effect, ...]) -> bool: ...

    def why_not(self, effect: Effect) -> str | None: ...

    def with_effects(self, effects: tuple[Effect, ...]) -> "Template": ...

    def completed(self, text: str, variables: Mapping[str, Any]) -> str:
        """A rendered input with what the template does not say itself. Raises :class:`Failed`."""
        ...


def inside(template: Template, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Those of the effects that must be in a template's input: the others act around it."""
    return tuple(effect for effect in effects if not effect.around or template.can_have((effect,)))


class _Stops(NamedTuple):
    """Where the solver stops: at ``rows`` of the protocol, which are its times (s) and displacements from ``first``."""

    rows: Array
    times: Array
    displacements: Array
    first: int


@dataclass(frozen=True)
class FEBio:
    """A solver, its version, the template of its input, and how a run is stepped and limited.

    ``scratch`` holds one directory for each attempt, unless the job names a folder on its node; those of failed rows
    are kept in ``scratch``, at most ``keep_failed``. ``ramp_s``, ``hold_growth`` and ``still_mm`` say where the solver
    stops, see :func:`sinew.tasks.simulate.febio.stepping.solver_steps`. With ``plotted`` variables, the solver's plot
    file is read as well; the runs are kept in the folder ``kept``, if there is one, and taken from there. ``confirmed``
    is the hash of a program that its user had to confirm: nothing else is run in its place. ``restart_s``: how often
    the state of a run is kept, for the case that it is interrupted.
    """

    executable: str
    version: str
    template: Template
    scratch: Path
    timeout_s: float = 600.0
    max_file_bytes: int = 2**32
    ramp_s: float = 0.0
    hold_growth: float = 0.02
    still_mm: float = 0.0
    keep_failed: int = 20
    plotted: tuple[str, ...] = ()
    kept: Path | None = None
    confirmed: bytes | None = None
    restart_s: float | None = None

    @property
    def name(self) -> str:
        return self.template.name

    @property
    def confinement(self) -> str:
        """What the solver's runs can write on this machine, in words."""
        return confinement(Path(self.executable))

    @property
    def capabilities(self) -> Capabilities:
        can = replace(self.template.capabilities, restarts=self.restart_s is not None)
        return replace(can, effects="none") if self.plotted else can  # runs with other displacements are not kept

    def identity(self) -> dict[str, Any]:
        of_template = self.template.identity(self.ramp_s, self.hold_growth, self.still_mm)
        return {"name": self.name, "version": self.version} | of_template

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        """Whether one input can have all of these effects, but those that act around the specimen."""
        return self.template.can_have(inside(self.template, effects))

    def why_not(self, effect: Effect) -> str | None:
        """Why it cannot have an effect, inside or around; None where it can."""
        return None if effect.around else self.template.why_not(effect)

    def with_effects(self, effects: tuple[Effect, ...], near: Near | None = None) -> Simulator:
        """The solver with an input that has ``effects``, and around it those that are not in an input.

        ``near``: what earlier runs with these have shown. Raises :class:`BadInput` where there is no such input.
        """
        within = self.template.with_effects(inside(self.template, effects))
        return replace(self, template=within).surrounded(effects, near)

    def surrounded(self, effects: tuple[Effect, ...], near: Near | None = None) -> Simulator:
        """The solver with those of ``effects`` around it that are not in its input; ``near`` as there."""
        within = inside(self.template, effects)
        outside = tuple(effect for effect in effects if effect not in within)
        return Around(self, outside, near) if outside else self

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        """The force. Raises :class:`BadInput` when no output is one, and when ``stresses`` are asked for."""
        if stresses:
            raise BadInput("simulator", f"{self.name} reports no constituent stresses", "simulator: uniaxial")
        if self.capabilities.force is None:
            raise BadInput("simulator", "no output is the force", "simulator.force: the name of an output")
        found, status, messages = self._rows(model, specimen, protocol, parameters)
        outputs = {output.name: found[:, number] for number, output in enumerate(self.capabilities.outputs)}
        return Simulated(found[:, self._force], status, messages, outputs=outputs)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        found, status, messages = self._rows(model, specimen, curve.protocol, parameters)
        force = found[:, self._force] if self.capabilities.force is not None else np.full(found[:, 0].shape, np.nan)
        outputs = {output.name: found[:, number] for number, output in enumerate(self.capabilities.outputs)}
        return Compared(
            rmse_of(force, curve.force_N),
            force[:, keep],
            status,
            messages,
            {name: values[:, keep] for name, values in outputs.items()},
            {output.name: output.summarised(outputs[output.name]) for output in self.capabilities.outputs},
            {name: rmse_of(outputs[name], values) for name, values in curve.others.items() if name in outputs},
        )

    def rendered(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> str:
        """The solver's input for one parameter set ``[d]``. Raises :class:`BadInput`."""
        try:
            return self._rendered(model, specimen, protocol, values, self._stops(model, protocol, values))
        except Failed as failed:
            raise BadInput(self.template.main, failed.words, "a template that can be rendered") from None

    @property
    def _force(self) -> int:
        read = (*(output for _, output in self.template.logs), *self.template.fields)
        return [output.name for output in read].index(str(self.capabilities.force))

    def _rows(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array
    ) -> tuple[Array, Array, tuple[str, ...]]:
        """All outputs ``[n, logs and fields, t]``, NaN for rows that failed; status ``[n]``; messages."""
        outputs = len(self.template.logs) + len(self.template.fields)
        found = np.full((len(parameters), outputs, protocol.time_s.size), np.nan)
        if not self.plotted:
            return found, *row_by_row(model, parameters, partial(self._solved, model, specimen, protocol), found)
        keeper = self._keeper(model, specimen, protocol)
        solve = partial(self._with_fields, model, specimen, protocol, keeper)
        status, messages = row_by_row(model, parameters, solve, found)
        if keeper is not None:
            keeper.close()  # before the outcomes of these rows are written: a row that counts has its fields
        return found, status, messages

    def _stops(self, model: Model, protocol: Protocol, values: Array) -> _Stops:
        rows = solver_steps(protocol.pace, self.ramp_s, self.hold_growth, self.still_mm)
        settling = self.template.settling(model, values)
        return _Stops(rows, *from_rest(protocol, rows, settling, loaded_at_rest=self.template.loaded_at_rest))

    def _rendered(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, stops: _Stops) -> str:
        """Raises :class:`Failed`."""
        template = self.template
        variables = template.variables(model, specimen, protocol, values, stops.times, stops.displacements)
        outputs = None if template.logs_itself else [asdict(output) for _, output in template.logs]
        text = render_input(template.files, template.main, variables, outputs)
        if len(text) > self.max_file_bytes:
            raise Failed("bad_input", f"{template.main} renders to more than max_file_mb")
        return template.completed(text, variables)

    def _keeper(self, model: Model, specimen: Specimen, protocol: Protocol) -> "Keeper | None":
        if self.kept is None:
            return None
        from sinew.tasks.simulate.febio.keeping import Keeper
        from sinew.tasks.simulate.febio.kept import settings_of

        of = settings_of(model.identity(), specimen.size(), self.identity(), protocol.digest)
        return Keeper(self.kept, of, protocol.name, model.names)

    def _solved(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> Array:
        """What is read ``[logs, t]`` for one parameter set. Raises :class:`Failed`."""
        return self._run(model, specimen, protocol, values)[0]

    def _run(
        self, model: Model, specimen: Specimen, protocol: Protocol, values: Array
    ) -> tuple[Array, PlotFile | None]:
        """What one run logs ``[logs, t]``, and its plot file if that is read. Raises :class:`Failed`."""
        stops = self._stops(model, protocol, values)

        def prepare(directory: Path) -> None:
            text = self._rendered(model, specimen, protocol, values, stops)
            text = with_plot_file(text, self.plotted) if self.plotted else text
            (directory / INPUT).write_text(text, "utf-8")

        def read(directory: Path) -> tuple[Array, PlotFile | None]:
            logged = [self._read(directory / file, output, protocol, stops) for file, output in self.template.logs]
            plot = read_plot_file(directory / PLOT, self.max_file_bytes) if self.plotted else None
            return np.array(logged).reshape(len(logged), protocol.time_s.size), plot

        logs = [file for file, _ in self.template.logs]
        return attempt(self, prepare, read, dict(zip(model.names, values.tolist(), strict=True)), logs)

    def _with_fields(
        self, model: Model, specimen: Specimen, protocol: Protocol, keeper: "Keeper | None", values: Array
    ) -> Array:
        """All outputs ``[logs and fields, t]`` of one parameter set, from a run that was kept if there is one.

        A new run is kept whatever becomes of the outputs. Raises :class:`Failed`.
        """
        wanted = [what_of(output) for _, output in self.template.logs]
        enough = partial(self._enough, wanted=wanted, protocol=protocol)
        run = keeper.find(values, enough) if keeper is not None else None
        if run is None:
            from sinew.tasks.simulate.febio.kept import Run

            logged, plot = self._run(model, specimen, protocol, values)
            assert plot is not None
            run = Run(dict(zip(wanted, logged, strict=True)), plot)
            if keeper is not None:
                keeper.add(values, run)
        stops = self._stops(model, protocol, values)
        courses = [run.logged[what] for what in wanted]
        for output in self.template.fields:
            at, course = field_course(output, run.plot)
            if not at.size or at[-1] < stops.times[-1] - slack(float(stops.times[-1])):
                raise Failed("bad_output", f"{output.name}: the plot file does not reach the end of the protocol")
            courses.append(self._at_rows(at, course, output.at_rest, protocol, stops))
        return np.stack(courses)

    def _enough(self, run: "Run", wanted: list[str], protocol: Protocol) -> bool:
        """Whether a kept run has all that the outputs need; a plot variable is missing if it was not asked for then."""
        courses = [run.logged.get(what) for what in wanted]
        there = all(course is not None and course.size == protocol.time_s.size for course in courses)
        return there and all(output.field in run.plot.variables for output in self.template.fields)

    def _read(self, path: Path, output: Logged, protocol: Protocol, stops: _Stops) -> Array:
        """An output ``[t]`` at the times of the protocol. Raises :class:`Failed`."""
        rows, times, _, first = stops
        if self.template.logs_itself:
            logged = read_output_at(path, output, self.max_file_bytes, times[1:])
            return at_every_row(protocol.pace, rows, np.append(output.at_rest, logged)[first:], self.still_mm)
        at, logged = read_output(path, output, self.max_file_bytes, float(times[-1]))
        return self._at_rows(at, logged, output.at_rest, protocol, stops)

    def _at_rows(self, at: Array, logged: Array, at_rest: float, protocol: Protocol, stops: _Stops) -> Array:
        """Values ``[t]`` at the times of the protocol, of those at the times ``at`` of the solver."""
        rows, times, _, first = stops
        if at[0] > 0:
            at, logged = np.append(0.0, at), np.append(at_rest, logged)
        nearest = np.clip(np.searchsorted(at, times[first:] - slack(times[-1])), 0, at.size - 1)
        if np.all(np.abs(at[nearest] - times[first:]) <= slack(times[-1])):  # the solver stopped where it was asked to
            return at_every_row(protocol.pace, rows, logged[nearest], self.still_mm)
        from scipy.interpolate import PchipInterpolator  # slow to import

        asked = protocol.time_s - protocol.time_s[0] + times[first]
        return np.asarray(PchipInterpolator(at, logged)(np.minimum(asked, at[-1])))
