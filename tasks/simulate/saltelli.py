"""Which parameter sets a sensitivity study evaluates: Saltelli's design (SALib)."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.model import Model
from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Design:
    """A Saltelli design over a model's free parameters.

    ``rows`` ``[n, d]`` holds full parameter sets, of which ``free`` are the columns of the free parameters, ``names``.
    ``block`` is the number of consecutive rows of one base sample.
    """

    names: tuple[str, ...]
    base_samples: int
    second_order: bool
    rows: Array
    free: tuple[int, ...] = ()

    @property
    def block(self) -> int:
        return block_of(len(self.names), self.second_order)

    @property
    def free_rows(self) -> Array:
        """The free parameters ``[n, free]`` of every row."""
        return self.rows[:, list(self.free)]

    @property
    def problem(self) -> dict[str, Any]:
        """The problem in SALib's sense; its bounds do not matter once the rows are drawn."""
        return {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0, 1]] * len(self.names)}

    def blocks(self, outcomes: Array, whole: Array) -> Array:
        """Outcomes ``[n, m]`` as blocks ``[whole, d + 2, m]`` of A, AB_1 ... AB_d, B."""
        found = outcomes.reshape(self.base_samples, self.block, -1)[whole]
        return found[:, [*range(len(self.names) + 1), self.block - 1]]


def block_of(parameters: int, second_order: bool) -> int:
    """The rows of one base sample of Saltelli's design."""
    return (2 if second_order else 1) * parameters + 2


def base_samples(points: int, parameters: int, second_order: bool) -> int:
    """The smallest power of two whose Saltelli design has at least ``points`` rows."""
    return int(2 ** max(1, int(np.ceil(np.log2(points / block_of(parameters, second_order))))))


def saltelli(model: Model, base: int, second_order: bool, seed: int) -> Design:
    """Saltelli's design from a scrambled Sobol sequence; the first half of a doubled design is the design itself."""
    import SALib.sample.sobol as salib_sample

    free = model.free
    problem = {
        "num_vars": len(free),
        "names": [parameter.name for parameter in free],
        "bounds": [[parameter.minimum, parameter.maximum] for parameter in free],
    }
    rows = salib_sample.sample(problem, base, calc_second_order=second_order, scramble=True, seed=seed)
    names = tuple(parameter.name for parameter in free)
    at = tuple(model.names.index(name) for name in names)
    return Design(names, base, second_order, model.full(names, rows), at)
