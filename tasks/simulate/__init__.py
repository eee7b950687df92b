"""Simulators: from parameters to the force along a protocol. All have the same signature and are interchangeable."""

from dataclasses import dataclass
from typing import Any
from typing import Protocol as Interface

import numpy as np

from tasks.model import Curve, Model, Protocol, Specimen

Array = np.ndarray[Any, np.dtype[Any]]


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
    """

    rmse_N: Array
    force_N: Array
    status: Array
    messages: tuple[str, ...]


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


def impossible(model: Model, parameters: Array) -> dict[int, str]:
    """Rows whose parameters the model cannot have, with the reason."""
    reasons: dict[int, str] = {}
    for column, parameter in enumerate(model.parameters):
        values = parameters[:, column]
        above = values > parameter.floor if parameter.exclusive else values >= parameter.floor
        for row in np.flatnonzero(~(above & (values < parameter.ceiling))):
            reasons.setdefault(int(row), f"{parameter.name} = {values[row]:g}; expected {parameter.limits}")
    return reasons
