"""Which parameter sets a sensitivity study evaluates: Saltelli's design (SALib)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from sinew.tasks.model import Model
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.pairing import pairs_of

FEWEST = 32  # base samples of a sequence


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
    """How many scrambled sequences ``base`` samples come from: ``wanted``, but with ``FEWEST`` samples of each.

    One rather than two, whose scatter says next to nothing.
    """
    found = min(wanted, base // FEWEST)
    return found if found > 2 else 1


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
    """The rows ``[n, free]`` of a design: base samples of each sequence in turn. One sequence is SALib's."""
    if scrambles == 1:
        import SALib.sample.sobol as salib_sample

        problem = {"num_vars": len(names), "names": list(names), "bounds": [list(each) for each in bounds]}
        return np.asarray(salib_sample.sample(problem, base, calc_second_order=second_order, scramble=True, seed=seed))
    sequences = [_sequence(len(names), base // scrambles, second_order, (seed, number)) for number in range(scrambles)]
    low, high = np.array(bounds, dtype=float).T
    return np.asarray(low + (high - low) * np.stack(sequences, axis=1).reshape(-1, len(names)))


def _sequence(size: int, count: int, second_order: bool, seed: tuple[int, int]) -> Array:
    """The blocks ``[count, block, size]`` of one scrambled sequence, in SALib's order, on the unit cube.

    Which parameter has which pair of columns is drawn, so that a pair that fills its square badly meets another
    parameter in each sequence.
    """
    rng = np.random.default_rng(seed)
    pairs = np.array(pairs_of(size))[rng.permutation(size)]
    points = qmc.Sobol(2 * size, scramble=True, seed=rng).random(count)
    a, b = points[:, pairs[:, 0]], points[:, pairs[:, 1]]
    own = np.eye(size, dtype=bool)
    a_with_b = np.where(own, b[:, np.newaxis], a[:, np.newaxis])
    b_with_a = [np.where(own, a[:, np.newaxis], b[:, np.newaxis])] if second_order else []
    return np.concatenate([a[:, np.newaxis], a_with_b, *b_with_a, b[:, np.newaxis]], axis=1)
