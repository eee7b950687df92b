"""One evaluation: a parameter set against every measured curve of a specimen."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from runner.batch import Outcome
from runner.store import STATUSES, Coordinate, Field, TableSpec
from tasks.model import Model, Protocol, Specimen
from tasks.simulate import Array, Simulator


@dataclass(frozen=True, eq=False)
class SpecimenEvaluation:
    """The objective of Pekedis (2025), f(x), curve by curve: RMSE in newton, and points of the simulated forces.

    A parameter set that fails on one curve is a failed row: an objective over the other curves is another objective.
    """

    model: Model
    specimen: Specimen
    simulator: Simulator
    points_per_curve: int | Literal["all"]

    def __call__(self, parameters: Array) -> Outcome:
        count = len(parameters)
        status = np.zeros(count, dtype=np.int8)
        messages = [""] * count
        objective = np.empty((count, len(self.specimen.curves)))
        values: dict[str, Array] = {"objective": objective}
        for column, curve in enumerate(self.specimen.curves):
            keep = kept_points(curve.protocol, self.points_per_curve)
            compared = self.simulator.compare(self.model, self.specimen, curve, parameters, keep)
            objective[:, column] = compared.rmse_N
            values[f"force_{curve.name}"] = compared.force_N
            for row in np.flatnonzero((compared.status > 0) & (status == 0)):
                status[row] = compared.status[row]
                messages[row] = f"{curve.name}: {compared.messages[row]}"
        return Outcome(values, status, tuple(messages) if status.any() else ())

    def table(self) -> TableSpec:
        """The store's table for this evaluation."""
        names = [curve.name for curve in self.specimen.curves]
        coordinates = [Coordinate("protocol", "protocol", np.array(names, dtype=object))]
        fields = [Field("objective", ("protocol",), "N", "root mean square error of the force")]
        for curve in self.specimen.curves:
            keep = kept_points(curve.protocol, self.points_per_curve)
            dim = f"time_{curve.name}"
            history = curve.protocol
            coordinates += [
                Coordinate(dim, dim, history.time_s[keep], "s"),
                Coordinate(f"displacement_{curve.name}", dim, history.displacement_mm[keep], "mm"),
                Coordinate(f"measured_{curve.name}", dim, curve.force_N[keep], "N"),
            ]
            fields.append(Field(f"force_{curve.name}", (dim,), "N", f"simulated force, {curve.name}"))
        return TableSpec(
            title=f"{self.specimen.name} {self.simulator.name}",
            identity=self.identity(),
            parameters=self.model.names,
            units=tuple(parameter.unit for parameter in self.model.parameters),
            fields=tuple(fields),
            coordinates=tuple(coordinates),
        )

    def identity(self) -> dict[str, Any]:
        """Everything but the parameters that the outcome depends on."""
        return {
            "model": self.model.identity(),
            "specimen": self.specimen.identity(),
            "simulator": self.simulator.identity(),
            "points_per_curve": self.points_per_curve,
            "statuses": list(STATUSES),
        }


@lru_cache(maxsize=256)
def kept_points(protocol: Protocol, count: int | Literal["all"]) -> Array:
    """Rows of a protocol that represent it: half of them spread evenly along the path of the displacement, half along
    the logarithm of the time since it last moved, where relaxation happens. First and last row are among them.
    """
    rows = protocol.time_s.size
    if count == "all" or rows <= count:
        return np.arange(rows)
    step = np.diff(protocol.time_s)
    path = np.abs(np.diff(protocol.displacement_mm))
    moving = path > 0.1 * np.median(path[path > 0]) if (path > 0).any() else np.zeros(rows - 1, dtype=bool)
    last_moved = np.maximum.accumulate(np.where(moving, protocol.time_s[1:], protocol.time_s[0]))
    waiting = np.where(moving, 0.0, step / (1.0 + protocol.time_s[1:] - last_moved))
    parts = [part / part.sum() for part in (path, waiting) if part.sum() > 0]
    along = np.concatenate([[0.0], np.cumsum(sum(parts, np.zeros(rows - 1)))])
    targets = np.linspace(0.0, along[-1], count)
    keep = np.unique(np.concatenate([[0], np.searchsorted(along, targets[1:-1]), [rows - 1]]))
    missing = count - keep.size  # a jump can swallow several targets
    if missing > 0:
        others = np.setdiff1d(np.arange(rows), keep)
        keep = np.union1d(keep, others[np.linspace(0, others.size - 1, missing).astype(int)])
    return keep
