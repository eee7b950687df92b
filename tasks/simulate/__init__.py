"""Simulators: from parameters to the force along a protocol. All have the same signature and are interchangeable."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, cast
from typing import Protocol as Interface

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.model import FORCE, Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Effect

Array = np.ndarray[Any, np.dtype[Any]]


Courses = Mapping[str, Array]
"""What a model gives along a protocol, ``[n, t]`` by quantity: the force (N), and others in their own units."""

Summary = Literal["max", "min", "mean", "last"]


@dataclass(frozen=True)
class Output:
    """A named quantity over time that a simulator gives besides the force; ``summary`` reduces it to one number."""

    name: str
    unit: str
    summary: Summary = "max"

    def summarised(self, values: Array) -> Array:
        """The summaries ``[n]`` of values ``[n, t]``."""
        if self.summary == "last":
            return np.asarray(values[:, -1])
        if self.summary == "mean":
            return np.asarray(values.mean(axis=1))
        return np.asarray(values.max(axis=1) if self.summary == "max" else values.min(axis=1))


@dataclass(frozen=True, eq=False)
class Simulated:
    """Forces along a protocol for ``n`` parameter sets.

    ``force_N`` ``[n, t]`` (N; NaN where a row failed), ``status`` ``[n]`` (positions in
    :data:`sinew.runner.store.schema.STATUSES`), ``messages`` (``n`` texts), and on request the second Piola-Kirchhoff
    stresses of both constituents, ``matrix_MPa`` and ``fibre_MPa`` ``[n, t]`` (MPa). ``outputs``: those of the
    simulator besides the force, by name, ``[n, t]``.
    """

    force_N: Array
    status: Array
    messages: tuple[str, ...]
    matrix_MPa: Array | None = None
    fibre_MPa: Array | None = None
    outputs: Courses = field(default_factory=dict)

    def courses(self, others: Iterable[str]) -> Courses:
        """The force, and these of the other outputs."""
        return {FORCE: self.force_N, **{name: self.outputs[name] for name in others}}


@dataclass(frozen=True, eq=False)
class Compared:
    """How far ``n`` parameter sets are from a measured curve.

    ``rmse_N`` ``[n]`` (N) over every measured point, and the force at the kept points, ``force_N`` ``[n, k]`` (N).
    Of each of the simulator's outputs, by name, its values at the kept points ``[n, k]`` and its summary ``[n]``.
    ``rmse`` ``[n]``: of those that were measured (the ``others`` of the curve), over every measured point, in their
    own unit.
    """

    rmse_N: Array
    force_N: Array
    status: Array
    messages: tuple[str, ...]
    outputs: Mapping[str, Array] = field(default_factory=dict)
    summaries: Mapping[str, Array] = field(default_factory=dict)
    rmse: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Capabilities:
    """What a simulator can do. Tasks ask for this, never for a simulator's class or name.

    ``batch_multiple``: rows that are computed together at no extra cost. ``quick``: a row takes less time than sending
    it to a worker. ``stresses``: the stresses of both constituents, on request. ``effects``: how it has effects of the
    library: ``embedded``, by sinew's own equations; ``solver``, as :class:`TakesEffects`; or not at all. ``outputs``:
    quantities along time, all that are stored besides the force. ``force``: the output that is the force; None when
    there is no force to compare with a measured one. ``constituents``: where the fibre and the matrix stand in a model
    of the user's own, by name, which decides what effects inside it are. ``restarts``: a row that is
    interrupted goes on where it was.
    """

    batch_multiple: int = 1
    quick: bool = False
    stresses: bool = False
    effects: Literal["none", "embedded", "solver"] = "none"
    outputs: tuple[Output, ...] = ()
    force: str | None = "force"
    constituents: tuple[tuple[str, str], ...] = ()
    restarts: bool = False


class Simulator(Interface):
    """What every simulator offers. It is frozen data: it can be pickled and sent to a worker."""

    @property
    def name(self) -> str: ...

    @property
    def capabilities(self) -> Capabilities: ...

    def identity(self) -> dict[str, Any]:
        """What an outcome depends on besides model, specimen and parameters: solver, version, input template."""
        ...

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        """Force along ``protocol`` for ``parameters`` ``[n, d]``, at each of its times."""
        ...

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        """Distance to a measured curve for ``parameters`` ``[n, d]``, and the force at the points ``keep`` ``[k]``."""
        ...


class TakesEffects(Simulator, Interface):
    """A simulator whose ``effects`` are ``solver``: another simulator has the effects in it."""

    def can_have(self, effects: tuple[Effect, ...]) -> bool:
        """Whether it can have all of these effects at once."""
        ...

    def why_not(self, effect: Effect) -> str | None:
        """Why it cannot have an effect; None where it can."""
        ...

    def with_effects(self, effects: tuple[Effect, ...], near: Any = None) -> "Simulator":
        """The same with ``effects``, for models of :func:`sinew.tasks.model.effect.model_with`.

        ``near``: a :class:`sinew.tasks.simulate.near.Near`, where calls have nearly the same parameters.
        """
        ...


def taking_effects(simulator: Simulator) -> TakesEffects | None:
    """The simulator, if it is to be run with effects of the library in it; None where sinew's own equations have them.

    Raises :class:`BadInput` for a simulator that cannot have effects.
    """
    if simulator.capabilities.effects == "none":
        raise BadInput(
            "simulator",
            f"{simulator.name} cannot have effects of the library",
            "simulator: uniaxial, febio or template",
        )
    return cast(TakesEffects, simulator) if simulator.capabilities.effects == "solver" else None


def rmse_of(values: Array, measured: Array) -> Array:
    """Root mean square ``[n]`` of ``values`` ``[n, t]`` less ``measured`` ``[t]``, where that is a number.

    NaN where nothing was measured.
    """
    there = np.flatnonzero(np.isfinite(measured))
    if not there.size:
        return np.full(len(values), np.nan)
    return np.asarray(np.sqrt(np.mean((np.take(values, there, axis=1) - measured[there]) ** 2, axis=1)))


def impossible(model: Model, parameters: Array) -> dict[int, str]:
    """Rows whose parameters the model cannot have, with the reason."""
    reasons: dict[int, str] = {}
    for column, parameter in enumerate(model.parameters):
        values = parameters[:, column]
        above = values > parameter.floor if parameter.exclusive else values >= parameter.floor
        for row in np.flatnonzero(~(above & (values < parameter.ceiling))):
            reasons.setdefault(int(row), f"{parameter.name} = {values[row]:g}; expected {parameter.limits}")
    return reasons
