"""Which parameter sets a sensitivity study evaluates: Saltelli's design (SALib)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.model import Model
from sinew.tasks.simulate import Array

FEWEST = 4  # base samples of a sequence


@dataclass(frozen=True, eq=False)
class Design:
    """A Saltelli design over a model's free parameters.

    ``rows`` ``[n, d]`` holds full parameter sets, of which ``free`` are the columns of the free parameters, ``names``.
    ``block`` is the number of consecutive rows of one base sample. Base samples come in turn from ``scrambles``
    independent scrambled sequences.
    """

    names: tuple[str, ...]
    base_samples: int
    second_order: bool
    rows: Array
    free: tuple[int, ...] = ()
    scrambles: int = 1

    @property
    def scramble(self) -> Array:
        """The number ``[base samples]`` of the sequence that each base sample comes from."""
        return np.arange(self.base_samples) % self.scrambles

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


def scrambles_of(base: int, wanted: int) -> int:
    """How many scrambled sequences ``base`` samples come from: ``wanted``, but with ``FEWEST`` samples of each."""
    return max(1, min(wanted, base // FEWEST))


def saltelli(model: Model, base: int, second_order: bool, seed: int, scrambles: int = 1) -> Design:
    """Saltelli's design from scrambled Sobol sequences; the first half of a doubled design is the design itself.

    ``scrambles``: a power of two, at most ``base``.
    """
    free = model.free
    names = tuple(parameter.name for parameter in free)
    bounds = [[parameter.minimum, parameter.maximum] for parameter in free]
    rows = drawn(names, bounds, base, seed, second_order=second_order, scrambles=scrambles)
    at = tuple(model.names.index(name) for name in names)
    return Design(names, base, second_order, model.full(names, rows), at, scrambles)


def drawn(
    names: Sequence[str], bounds: Sequence[Sequence[float]], base: int, seed: int, *, second_order: bool, scrambles: int
) -> Array:
    """The rows ``[n, free]`` of a design: base samples of each sequence in turn."""
    import SALib.sample.sobol as salib_sample

    problem = {"num_vars": len(names), "names": list(names), "bounds": [list(each) for each in bounds]}
    each = base // scrambles
    sequences = [
        salib_sample.sample(problem, each, calc_second_order=second_order, scramble=True, seed=_seed(seed, number))
        for number in range(scrambles)
    ]
    blocks = np.stack([rows.reshape(each, -1, len(names)) for rows in sequences], axis=1)
    return np.asarray(blocks.reshape(-1, len(names)))


def _seed(seed: int, number: int) -> int:
    """The seed of a sequence; that of the first is the study's own."""
    return seed if number == 0 else int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
