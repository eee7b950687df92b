"""What a Sobol study has evaluated of a specimen: rows of the store, with those of cheaper versions of the model."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sinew.runner.store.table import Table
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import SpecimenEvaluation


@dataclass(frozen=True, eq=False)
class Evaluated:
    """A specimen's evaluations: its table in the store and the row ``at`` ``[n]`` of each row of the design.

    ``cheaper``: the same of cheaper versions of the model, each with a design of its own.
    """

    evaluation: SpecimenEvaluation
    table: Table
    at: Array
    cheaper: tuple["Evaluated", ...] = ()

    @property
    def curves(self) -> tuple[Curve, ...]:
        return self.specimen.curves

    def read(self, field: str, columns: slice = slice(None)) -> Array:
        """A field ``[N, ...]`` of the rows of the design, then of those of each cheaper version.

        A version that does not have the field gives its force in its place.
        """
        others = [one.table.read(self._nearest(field, one), one.at, columns) for one in self.cheaper]
        return np.concatenate([self.table.read(field, self.at, columns), *others])

    def _nearest(self, field: str, cheaper: "Evaluated") -> str:
        if field in cheaper.table.fields:
            return field
        return self._forces.get(field, f"summary_{cheaper.evaluation.simulator.capabilities.force}")

    @cached_property
    def _forces(self) -> dict[str, str]:
        """Fields of the force, by those of a course along the same protocol."""
        named = [curve.name for curve in self.specimen.curves]
        return {field: f"force_{name}" for name in named for field in self.evaluation.courses(name)}

    @property
    def specimen(self) -> Specimen:
        return self.evaluation.specimen
