"""Simulators: from parameters to the force along a protocol. All have the same signature and are interchangeable."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, runtime_checkable
from typing import Protocol as Interface

import numpy as np

from tasks.model import Curve, Model, Protocol, Specimen

Array = np.ndarray[Any, np.dtype[Any]]


Summary = Literal["max", "min", "mean", "last"]


@dataclass(frozen=True)
class Output:
    """A named quantity along time that a simulator gives besides the force; ``summary`` makes one number of it."""

    name: str
    unit: str
    summary: Summary = "max"

    def summarised(self, values: Array) -> Array:
        """Of values ``[n, t]`` one number each ``[n]``."""
        if self.summary == "last":
            return np.asarray(values[:, -1])
        if self.summary == "mean":
            return np.asarray(values.mean(axis=1))
        return np.asarray(values.max(axis=1) if self.summary == "max" else values.min(axis=1))


@dataclass(frozen=True, eq=False)
class Simulated:
    """Forces along a protocol for ``n`` parameter sets.

    ``force_N`` ``[n, t]`` (N; NaN where a row failed), ``status`` ``[n]`` (positions in
    :data:`runner.store.STATUSES`), ``messages`` (``n`` texts), and on request the second Piola-Kirchhoff stresses of
    both constituents, ``matrix_MPa`` and ``fibre_MPa`` ``[n, t]`` (MPa).
    """

    force_N: Array
    status: Array
    messages: tuple[str, ...]
    matrix_MPa: Array | None = None
    fibre_MPa: Array | None = None


@dataclass(frozen=True, eq=False)
class Compared:
    """How far ``n`` parameter sets are from a measured curve.

    ``rmse_N`` ``[n]`` (N) over every measured point, and the force at the kept points, ``force_N`` ``[n, k]`` (N).
    Of each of the simulator's outputs, by name, its values at the kept points ``[n, k]`` and its summary ``[n]``.
    """

    rmse_N: Array
    force_N: Array
    status: Array
    messages: tuple[str, ...]
    outputs: Mapping[str, Array] = field(default_factory=dict)
    summaries: Mapping[str, Array] = field(default_factory=dict)


class Simulator(Interface):
    """What every simulator offers. It is frozen data: it can be pickled and sent to a worker."""

    @property
    def name(self) -> str: ...

    @property
    def batch_multiple(self) -> int:
        """Rows that are computed together at no extra cost."""
        ...

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


@runtime_checkable
class GivesOutputs(Interface):
    """A simulator that gives other quantities, too; ``force`` is the name of that which is the force, or None."""

    @property
    def outputs(self) -> tuple[Output, ...]: ...

    @property
    def force(self) -> str | None: ...


def outputs_of(simulator: Simulator) -> tuple[Output, ...]:
    """What a simulator gives along time, besides what every simulator does."""
    return simulator.outputs if isinstance(simulator, GivesOutputs) else ()


def gives_force(simulator: Simulator) -> bool:
    return not isinstance(simulator, GivesOutputs) or simulator.force is not None


def impossible(model: Model, parameters: Array) -> dict[int, str]:
    """Rows whose parameters the model cannot have, with the reason."""
    reasons: dict[int, str] = {}
    for column, parameter in enumerate(model.parameters):
        values = parameters[:, column]
        above = values > parameter.floor if parameter.exclusive else values >= parameter.floor
        for row in np.flatnonzero(~(above & (values < parameter.ceiling))):
            reasons.setdefault(int(row), f"{parameter.name} = {values[row]:g}; expected {parameter.limits}")
    return reasons
