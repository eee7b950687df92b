"""One evaluation for all specimens of a site: a parameter set against each curve, or its first cycle."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sinew.runner.evaluation.batch import Outcome
from sinew.runner.store.schema import STATUSES, Coordinate, Field, TableSpec
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.simulate import Array, Simulator
from sinew.tasks.simulate.evaluation import HISTORY, kept_points

MOVED = 0.2  # share of a curve's displacement range; a smaller reversal is noise


@dataclass(frozen=True, eq=False)
class SiteEvaluation:
    """Relative errors of all curves of ``specimens``, and the simulated forces at kept points of each.

    A curve's relative error is the L2 norm of simulated minus measured force over that of the measured force, over
    every measured point: 0.3 means 30 %. Geometry and displacement histories are each specimen's own.

    What is compared beside the force has relative errors of its own along every curve, behind those of the forces, and
    its simulated points in ``others``, as parts of the root mean square of what was measured.
    """

    model: Model
    specimens: tuple[Specimen, ...]
    simulator: Simulator
    points_per_curve: int | Literal["all"]
    title: str

    def curves(self) -> list[tuple[Specimen, Curve]]:
        """All curves, in the order of the outcome."""
        return [(specimen, curve) for specimen in self.specimens for curve in specimen.curves]

    def others(self) -> list[tuple[Specimen, Curve, str]]:
        """What was measured beside the forces, in the order of the outcome."""
        return [(one, curve, name) for one, curve in self.curves() for name in curve.others]

    def __call__(self, parameters: Array) -> Outcome:
        count = len(parameters)
        status = np.zeros(count, dtype=np.int8)
        messages = [""] * count
        errors, forces = [], []
        errors_of_others, others = [], []
        for specimen, curve in self.curves():
            keep = kept_points(curve.protocol, self.points_per_curve)
            compared = self.simulator.compare(self.model, specimen, curve, parameters, keep)
            errors.append(compared.rmse_N / root_mean_square(curve.force_N))
            forces.append(compared.force_N)
            for name, measured in curve.others.items():
                size = root_mean_square(measured[np.isfinite(measured)])
                errors_of_others.append(compared.rmse[name] / size)
                others.append(compared.outputs[name] / size)
            for row in np.flatnonzero((compared.status > 0) & (status == 0)):
                status[row] = compared.status[row]
                messages[row] = f"{specimen.name} {curve.name}: {compared.messages[row]}"
        errors += errors_of_others
        values = {"relative_error": np.stack(errors, axis=1), "force": np.concatenate(forces, axis=1)}
        if others:
            values["others"] = np.concatenate(others, axis=1)
        return Outcome(values, status, tuple(messages) if status.any() else ())

    def points(self) -> tuple[Array, Array]:
        """For each kept point, the number of its curve and the measured force there (N)."""
        of, measured = [], []
        for number, (_, curve) in enumerate(self.curves()):
            keep = kept_points(curve.protocol, self.points_per_curve)
            of.append(np.full(keep.size, number))
            measured.append(curve.force_N[keep])
        return np.concatenate(of), np.concatenate(measured)

    def curves_of_others(self) -> Array:
        """For each kept point of what was measured beside the forces, the number of its curve in the outcome."""
        kept = [kept_points(curve.protocol, self.points_per_curve).size for _, curve, _ in self.others()]
        first = len(self.curves())
        return np.repeat(np.arange(first, first + len(kept)), kept)

    def points_of_others(self) -> Array:
        """What was measured beside the forces at the kept points, as parts of its root mean square.

        Interpolated where nothing was measured.
        """
        found = [np.empty(0)]
        for _, curve, name in self.others():
            values, time_s = curve.others[name], curve.protocol.time_s
            there = np.isfinite(values)
            keep = kept_points(curve.protocol, self.points_per_curve)
            measured = np.interp(time_s[keep], time_s[there], values[there])
            found.append(measured / root_mean_square(values[there]))
        return np.concatenate(found)

    def _coordinates_of_others(self) -> list[Coordinate]:
        """For each kept point of what was measured beside the forces: its curve, its time, and what was measured."""
        others = self.others()
        if not others:
            return []
        times = [curve.protocol.time_s[kept_points(curve.protocol, self.points_per_curve)] for _, curve, _ in others]
        return [
            Coordinate("curve_of_other_point", "other_point", self.curves_of_others().astype(float), "1"),
            Coordinate("time_of_other_point", "other_point", np.concatenate(times), "s"),
            Coordinate("measured_others", "other_point", self.points_of_others(), "1"),
        ]

    def table(self) -> TableSpec:
        """The store's table for this evaluation."""
        curves = self.curves()
        of, measured = self.points()
        kept = [kept_points(curve.protocol, self.points_per_curve) for _, curve in curves]
        histories = [curve.protocol for _, curve in curves]
        digests = [history.digest for history in histories]
        times = np.concatenate([history.time_s[keep] for history, keep in zip(histories, kept, strict=True)])
        moved = np.concatenate([history.displacement_mm[keep] for history, keep in zip(histories, kept, strict=True)])
        others = self.others()
        labels = [f"{specimen.name} {curve.name}" for specimen, curve in curves]
        labels += [f"{specimen.name} {curve.name} {name}" for specimen, curve, name in others]
        fields = [
            Field("relative_error", ("curve",), "1", "L2 norm of the force's error over that of the force"),
            Field("force", ("point",), "N", "simulated force"),
        ]
        if others:
            fields.append(Field("others", ("other_point",), "1", "simulated over root mean square of the measured"))
        return TableSpec(
            title=f"site {self.title} {self.simulator.name}",
            identity={
                "model": self.model.identity(),
                "specimens": [specimen.identity() for specimen in self.specimens],
                "simulator": self.simulator.identity(),
                "points_per_curve": self.points_per_curve,
                "statuses": list(STATUSES),
            },
            parameters=self.model.names,
            units=tuple(parameter.unit for parameter in self.model.parameters),
            fields=tuple(fields),
            coordinates=(
                *self._coordinates_of_others(),
                Coordinate("curve", "curve", np.array(labels, dtype=object)),
                Coordinate(HISTORY, "curve", np.array(digests + [""] * len(others), dtype=object)),
                Coordinate("curve_of_point", "point", of.astype(float), "1"),
                Coordinate("time", "point", times, "s"),
                Coordinate("displacement", "point", moved, "mm"),
                Coordinate("measured", "point", measured, "N"),
            ),
        )


def root_mean_square(force_N: Array) -> float:
    """Root mean square (N); 1 for a curve of zeros, whose errors are then in newton."""
    return float(np.sqrt(np.mean(force_N**2))) or 1.0


def observed(specimen: Specimen, protocols: tuple[str, ...] | None, single_cycle: tuple[str, ...]) -> Specimen:
    """The specimen with the curves that an inference uses: of ``single_cycle`` the first load and unload only.

    ``protocols``: names, or None for all of them.
    """
    curves = [curve for curve in specimen.curves if protocols is None or curve.name in protocols]
    cut = tuple(first_cycle(curve) if curve.name in single_cycle else curve for curve in curves)
    return replace(specimen, curves=cut)


def first_cycle(curve: Curve) -> Curve:
    """The curve up to the end of its first unloading; all of it when it never unloads.

    Without quantities that were not measured there, or are 0 there: no error can be a part of that.
    """
    moved = curve.protocol.displacement_mm
    enough = MOVED * float(np.ptp(moved))
    back = np.flatnonzero(np.maximum.accumulate(moved) - moved > enough)
    if not back.size:
        return curve
    unloading = moved[back[0] :]
    again = np.flatnonzero(unloading - np.minimum.accumulate(unloading) > enough)
    end = back[0] + (int(np.argmin(unloading[: again[0]])) if again.size else unloading.size - 1) + 1
    seen = None if curve.protocol.seen is None else curve.protocol.seen[curve.protocol.seen < end]
    protocol = Protocol(
        curve.name, curve.protocol.time_s[:end], moved[:end], seen if seen is not None and seen.size > 1 else None
    )
    others = {name: values[:end] for name, values in curve.others.items() if np.nan_to_num(values[:end]).any()}
    return Curve(protocol, curve.force_N[:end], others)
