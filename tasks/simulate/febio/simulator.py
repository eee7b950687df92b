"""The real solver: FEBio 4, run once for each parameter set and protocol on an input rendered from a template.

For each run, the template is rendered in a process of its own (:mod:`sinew.tasks.simulate.febio.renderer`), the solver
runs in a directory and a process group of its own (:mod:`sinew.tasks.simulate.febio.attempt`), and what it logged is
brought to the times of the protocol.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from typing import Protocol as Interface

import numpy as np
from scipy.interpolate import PchipInterpolator

from sinew.runner.errors import BadInput
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, rmse_of
from sinew.tasks.simulate.febio.attempt import INPUT, Failed, attempt, row_by_row
from sinew.tasks.simulate.febio.output import Logged, read_output, read_output_at, slack
from sinew.tasks.simulate.febio.renderer import render
from sinew.tasks.simulate.febio.stepping import at_every_row, from_rest, solver_steps


class Template(Interface):
    """What distinguishes one kind of template from another.

    ``files`` by name, of which ``main`` is rendered. ``logs``: the log files that are read, and the output in each.
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

    def with_effects(self, effects: tuple[Effect, ...]) -> "Template": ...


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
    stops, see :func:`sinew.tasks.simulate.febio.stepping.solver_steps`.
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

    @property
    def name(self) -> str:
        return self.template.name

    @property
    def capabilities(self) -> Capabilities:
        return self.template.capabilities

    def identity(self) -> dict[str, Any]:
        of_template = self.template.identity(self.ramp_s, self.hold_growth, self.still_mm)
        return {"name": self.name, "version": self.version} | of_template

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        """Whether one input can have all of these effects."""
        return self.template.can_have(effects)

    def with_effects(self, effects: tuple[Effect, ...]) -> "FEBio":
        """The solver with an input that has ``effects``. Raises :class:`BadInput` where there is no such input."""
        return replace(self, template=self.template.with_effects(effects))

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        """The force. Raises :class:`BadInput` when no output is one, and when ``stresses`` are asked for."""
        if stresses:
            raise BadInput("simulator", f"{self.name} reports no constituent stresses", "simulator: uniaxial")
        if self.capabilities.force is None:
            raise BadInput("simulator", "no output is the force", "simulator.force: the name of an output")
        found, status, messages = self._rows(model, specimen, protocol, parameters)
        return Simulated(found[:, self._force], status, messages)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        found, status, messages = self._rows(model, specimen, curve.protocol, parameters)
        force = found[:, self._force] if self.capabilities.force is not None else np.full(found[:, 0].shape, np.nan)
        rmse = np.sqrt(np.mean((force - curve.force_N) ** 2, axis=1))  # NaN where nothing was measured
        outputs = {output.name: found[:, number] for number, output in enumerate(self.capabilities.outputs)}
        return Compared(
            rmse,
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
        return [output.name for _, output in self.template.logs].index(str(self.capabilities.force))

    def _rows(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array
    ) -> tuple[Array, Array, tuple[str, ...]]:
        """All that is read ``[n, logs, t]``, NaN for rows that failed; status ``[n]``; messages."""
        found = np.full((len(parameters), len(self.template.logs), protocol.time_s.size), np.nan)
        return found, *row_by_row(model, parameters, partial(self._solved, model, specimen, protocol), found)

    def _stops(self, model: Model, protocol: Protocol, values: Array) -> _Stops:
        rows = solver_steps(protocol, self.ramp_s, self.hold_growth, self.still_mm)
        settling = self.template.settling(model, values)
        return _Stops(rows, *from_rest(protocol, rows, settling, loaded_at_rest=self.template.loaded_at_rest))

    def _rendered(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array, stops: _Stops) -> str:
        """Raises :class:`Failed`."""
        template = self.template
        variables = template.variables(model, specimen, protocol, values, stops.times, stops.displacements)
        outputs = None if template.logs_itself else [asdict(output) for _, output in template.logs]
        (text,) = render(template.files, template.main, [variables], outputs)["texts"]
        if len(text) > self.max_file_bytes:
            raise Failed("bad_input", f"{template.main} renders to more than max_file_mb")
        return str(text)

    def _solved(self, model: Model, specimen: Specimen, protocol: Protocol, values: Array) -> Array:
        """What is read ``[logs, t]`` for one parameter set. Raises :class:`Failed`."""
        stops = self._stops(model, protocol, values)

        def prepare(directory: Path) -> None:
            (directory / INPUT).write_text(self._rendered(model, specimen, protocol, values, stops), "utf-8")

        def read(directory: Path) -> Array:
            return np.stack(
                [self._read(directory / file, output, protocol, stops) for file, output in self.template.logs]
            )

        return attempt(self, prepare, read, dict(zip(model.names, values.tolist(), strict=True)))

    def _read(self, path: Path, output: Logged, protocol: Protocol, stops: _Stops) -> Array:
        """An output ``[t]`` at the times of the protocol. Raises :class:`Failed`."""
        rows, times, _, first = stops
        if self.template.logs_itself:
            logged = read_output_at(path, output, self.max_file_bytes, times[1:])
            return at_every_row(protocol, rows, np.append(output.at_rest, logged)[first:], self.still_mm)
        at, logged = read_output(path, output, self.max_file_bytes, float(times[-1]))
        if at[0] > 0:
            at, logged = np.append(0.0, at), np.append(output.at_rest, logged)
        nearest = np.clip(np.searchsorted(at, times[first:] - slack(times[-1])), 0, at.size - 1)
        if np.all(np.abs(at[nearest] - times[first:]) <= slack(times[-1])):  # the solver stopped where it was asked to
            return at_every_row(protocol, rows, logged[nearest], self.still_mm)
        asked = protocol.time_s - protocol.time_s[0] + times[first]
        return np.asarray(PchipInterpolator(at, logged)(np.minimum(asked, at[-1])))
