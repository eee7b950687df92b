"""One evaluation: a parameter set against every measured curve of a specimen."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from sinew.runner.evaluation.batch import Outcome
from sinew.runner.store.schema import STATUSES, Coordinate, Field, TableSpec
from sinew.tasks.model import FORCE, Model, Protocol, Specimen
from sinew.tasks.simulate import Array, Capabilities, Simulator
from sinew.tasks.simulate.series import Series

HISTORY = "history"  # the coordinate that says along which history of displacement a row was run


@dataclass(frozen=True, eq=False)
class SpecimenEvaluation:
    """The objective of Pekedis (2025), f(x), curve by curve: RMSE in newton, and points of the simulated forces.

    A parameter set that fails on one curve is a failed row: an objective over the other curves is another objective.
    There is no objective where nothing was measured. Of a simulator's other outputs there are points of their course,
    ``OUTPUT_PROTOCOL``, and one number by protocol, ``summary_OUTPUT``.

    Where a specimen has ``noise`` levels of several quantities, the objective of a curve is the sum over them of RMSE
    over level, without unit, and ``rmse_OUTPUT`` holds each RMSE in its own unit.
    """

    model: Model
    specimen: Specimen
    simulator: Simulator
    points_per_curve: int | Literal["all"]

    def __call__(self, parameters: Array) -> Outcome:
        count = len(parameters)
        status = np.zeros(count, dtype=np.int8)
        messages = [""] * count
        curves = len(self.specimen.curves)
        objective = np.empty((count, curves))
        values: dict[str, Array] = {"objective": objective} if self.scored else {}
        values |= {f"rmse_{name}": np.empty((count, curves)) for name in self.specimen.noise}
        values |= {f"summary_{output.name}": np.empty((count, curves)) for output in self._can.outputs}
        for column, curve in enumerate(self.specimen.curves):
            keep = kept_points(curve.protocol, self.points_per_curve)
            compared = self.simulator.compare(self.model, self.specimen, curve, parameters, keep)
            objective[:, column] = compared.rmse_N
            if levels := self.specimen.noise:
                errors = {name: compared.rmse_N if name == FORCE else compared.rmse[name] for name in levels}
                for name, error in errors.items():
                    values[f"rmse_{name}"][:, column] = error
                objective[:, column] = np.sum([error / levels[name] for name, error in errors.items()], axis=0)
            values |= {self._field(name, curve.name): course for name, course in compared.outputs.items()}
            for name, summary in compared.summaries.items():
                values[f"summary_{name}"][:, column] = summary
            if self._can.force is not None:
                values[f"force_{curve.name}"] = compared.force_N
            for row in np.flatnonzero((compared.status > 0) & (status == 0)):
                status[row] = compared.status[row]
                messages[row] = f"{curve.name}: {compared.messages[row]}"
        return Outcome(values, status, tuple(messages) if status.any() else ())

    @property
    def _can(self) -> Capabilities:
        return self.simulator.capabilities

    @property
    def restarts(self) -> bool:
        """Whether a row that is interrupted goes on where it was."""
        return self._can.restarts

    @property
    def scored(self) -> bool:
        """Whether there are measured forces, and simulated ones to compare with them."""
        return self.specimen.measured and self._can.force is not None

    @property
    def several(self) -> bool:
        """Whether more than the force is compared; the objective has no unit then."""
        return len(self.specimen.noise) > 1

    @property
    def unit(self) -> str:
        """The unit of the objective."""
        return "1" if self.several else "N"

    def units(self) -> dict[str, str]:
        """The units of the quantities that are compared, the force first."""
        known = {output.name: output.unit for output in self._can.outputs}
        return {FORCE: "N"} | {name: known[name] for name in self.specimen.others}

    def series(self) -> tuple[Series, ...]:
        """What is compared, one quantity after the other, and each along every protocol."""
        found = []
        for name in self.units():
            for curve in self.specimen.curves:
                field = f"force_{curve.name}" if name == FORCE else self._field(name, curve.name)
                values = curve.force_N if name == FORCE else curve.others[name]
                level = self.specimen.noise.get(name, 1.0)
                found.append(Series(name, curve.name, field, curve.protocol.time_s, values, level))
        return tuple(found)

    def parts(self, values: Mapping[str, Array]) -> Array:
        """The parts of the objective ``[..., s]``, one for each of :meth:`series`, from fields of the store."""
        if not self.several:
            return values["objective"]
        levels = self.specimen.noise
        return np.concatenate([values[f"rmse_{name}"] / levels[name] for name in levels], axis=-1)

    def _field(self, output: str, protocol: str) -> str:
        """The name of an output's curve in the store; that of the force is the same for every simulator."""
        return f"force_{protocol}" if output == self._can.force else f"{output}_{protocol}"

    def courses(self, protocol: str) -> dict[str, str]:
        """Fields of the store that hold points along a protocol, and what each is of (``force``, or an output)."""
        found = {f"force_{protocol}": "force"} if self._can.force is not None else {}
        return {self._field(output.name, protocol): output.name for output in self._can.outputs} | found

    def table(self) -> TableSpec:
        """The store's table for this evaluation."""
        names = [curve.name for curve in self.specimen.curves]
        histories = np.array([curve.protocol.digest for curve in self.specimen.curves], dtype=object)
        coordinates = [
            Coordinate("protocol", "protocol", np.array(names, dtype=object)),
            Coordinate(HISTORY, "protocol", histories),
        ]
        fields = [Field("objective", ("protocol",), "N", "root mean square error of the force")] if self.scored else []
        if self.several and self.scored:
            fields = [Field("objective", ("protocol",), "1", "sum over the quantities of RMSE over noise level")]
            for name, unit in self.units().items():
                fields.append(Field(f"rmse_{name}", ("protocol",), unit, f"root mean square error of {name}"))
        outputs = self._can.outputs
        for output in outputs:
            words = f"{output.summary} of {output.name} over the protocol"
            fields.append(Field(f"summary_{output.name}", ("protocol",), output.unit, words))
        for curve in self.specimen.curves:
            keep = kept_points(curve.protocol, self.points_per_curve)
            dim = f"time_{curve.name}"
            history = curve.protocol
            coordinates += [
                Coordinate(dim, dim, history.time_s[keep], "s"),
                Coordinate(f"displacement_{curve.name}", dim, history.displacement_mm[keep], "mm"),
            ]
            if curve.measured:
                coordinates.append(Coordinate(f"measured_{curve.name}", dim, curve.force_N[keep], "N"))
            for name, unit in self.units().items():
                if name in curve.others:
                    seen = curve.others[name][keep]
                    coordinates.append(Coordinate(f"measured_{name}_{curve.name}", dim, seen, unit))
            if self._can.force is not None:
                fields.append(Field(f"force_{curve.name}", (dim,), "N", f"simulated force, {curve.name}"))
            named = [(self._field(output.name, curve.name), output) for output in outputs]
            others = [(name, output) for name, output in named if name != f"force_{curve.name}"]
            fields += [Field(name, (dim,), one.unit, f"{one.name}, {curve.name}") for name, one in others]
        return TableSpec(
            title=f"{self.specimen.name} {self.simulator.name}",
            identity=self.identity(),
            parameters=self.model.names,
            units=tuple(parameter.unit for parameter in self.model.parameters),
            fields=tuple(fields),
            coordinates=tuple(coordinates),
        )

    def identity(self) -> dict[str, Any]:
        """All that the outcome depends on, except the parameters."""
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
    the logarithm of the time since it last moved, where relaxation happens. First and last row are among them. Where
    more than the force was measured, but not at every row, the nearest rows are taken at which it was.
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
    inner = np.searchsorted(along, targets[1:-1])
    if protocol.seen is not None:
        inner = _nearest(inner, protocol.seen)
    keep = np.unique(np.concatenate([[0], inner, [rows - 1]]))
    if protocol.seen is not None:
        left = np.setdiff1d(protocol.seen, keep)
        keep = np.union1d(keep, _spread(left, min(left.size, count - keep.size)))
    missing = count - keep.size  # a jump can contain several targets
    if missing > 0:
        keep = np.union1d(keep, _spread(np.setdiff1d(np.arange(rows), keep), missing))
    return keep


def _spread(rows: Array, count: int) -> Array:
    """``count`` of ``rows``, evenly spread."""
    return rows[np.linspace(0, rows.size - 1, count).astype(int)]


def _nearest(rows: Array, seen: Array) -> Array:
    """Of ``seen`` ``[s]`` (increasing), the nearest to each of ``rows``."""
    after = np.clip(np.searchsorted(seen, rows), 1, seen.size - 1)
    return np.where(rows - seen[after - 1] <= seen[after] - rows, seen[after - 1], seen[after])
