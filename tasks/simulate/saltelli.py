"""Which parameter sets a sensitivity study evaluates: Saltelli's design (SALib)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import qmc

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model
from sinew.tasks.simulate import Array, dependent
from sinew.tasks.simulate.block import block_of
from sinew.tasks.simulate.inputs import PLAIN, Inputs
from sinew.tasks.simulate.pairing import pairs_of

FEWEST = 32  # base samples of a sequence
MOST_NUMBERS = 2**27  # of a design: a gigabyte
ORDERS = 1  # beside the seeds of a sequence: its orders of correlated parameters


@dataclass(frozen=True, eq=False)
class Design:
    """A Saltelli design over a model's free parameters, or groups of them, called ``names``.

    ``rows`` ``[n, d]`` holds full parameter sets, of which ``free`` are the columns of the free parameters, and
    ``members`` the places of each of ``names`` among these (without any, each is a parameter). ``block`` is the number
    of consecutive rows of one base sample. Base samples come in turn from ``scrambles`` independent scrambled
    sequences. In a ``plain`` design, each is one row. Where parameters depend on each other, there are ``orders``
    ``[base samples, names]``, and a base sample has the rows of :mod:`sinew.tasks.simulate.dependent`.
    """

    names: tuple[str, ...]
    base_samples: int
    second_order: bool
    rows: Array
    free: tuple[int, ...] = ()
    scrambles: int = 1
    members: tuple[tuple[int, ...], ...] = ()
    plain: bool = False
    orders: Array | None = None

    @property
    def scramble(self) -> Array:
        """The number ``[base samples]`` of the sequence that each base sample comes from."""
        return np.arange(self.base_samples) % self.scrambles

    @property
    def block(self) -> int:
        return 1 if self.plain else block_of(len(self.names), self.second_order, self.orders is not None)

    @property
    def free_rows(self) -> Array:
        """The free parameters ``[n, free]`` of every row."""
        return self.rows[:, list(self.free)]

    def features(self) -> Array:
        """What is varied in the first and the last row of each base sample, ``[base samples, 2, names]``.

        NaN for a group of several parameters, which no number stands for.
        """
        rows = self.free_rows.reshape(self.base_samples, self.block, -1)[:, [0, -1]]
        if not self.members:
            return rows
        columns = [rows[..., at[0]] if len(at) == 1 else np.full(rows.shape[:2], np.nan) for at in self.members]
        return np.stack(columns, axis=-1)

    @property
    def problem(self) -> dict[str, Any]:
        """The problem in SALib's sense; its bounds do not matter once the rows are drawn."""
        return {"num_vars": len(self.names), "names": list(self.names), "bounds": [[0, 1]] * len(self.names)}

    def blocks(self, outcomes: Array, whole: Array) -> Array:
        """Outcomes ``[n, m]`` as blocks ``[whole, d + 2, m]`` of A, AB_1 ... AB_d, B; of all rows where inputs depend
        on each other.
        """
        found = outcomes.reshape(self.base_samples, self.block, -1)[whole]
        return found if self.orders is not None else found[:, [*range(len(self.names) + 1), self.block - 1]]

    def first(self, base: int) -> "Design":
        """The design of the first ``base`` samples; its rows are left as they are."""
        return replace(self, base_samples=base, orders=None if self.orders is None else self.orders[:base])


def scrambles_of(base: int, wanted: int) -> int:
    """How many scrambled sequences ``base`` samples come from: ``wanted``, but with ``FEWEST`` samples of each.

    One rather than two, whose scatter says next to nothing.
    """
    found = min(wanted, base // FEWEST)
    return found if found > 2 else 1


def saltelli(
    model: Model, base: int, second_order: bool, seed: int, scrambles: int = 1, inputs: Inputs = PLAIN
) -> Design:
    """Saltelli's design from scrambled Sobol sequences; the first half of a doubled design is the design itself.

    ``scrambles``: a power of two, at most ``base``. Raises :class:`BadInput` for a design that would fill the memory.
    """
    free, correlated = model.free, bool(inputs.correlations)
    count, columns = base * block_of(len(free), second_order, correlated), len(model.names)
    if not 0 < count * columns <= MOST_NUMBERS or not 0 < scrambles <= base:
        problem = f"{base:,} base samples are {count:,} rows of {columns} parameters"
        raise BadInput("sobol.base_samples", problem, f"at most {MOST_NUMBERS // columns:,} rows")
    names = tuple(parameter.name for parameter in free)
    factors = inputs.factors(names)
    orders = None
    if correlated:
        share, orders = _correlated(inputs, names, base // scrambles, scrambles, seed)
        rows = inputs.values(free, share)
    elif inputs.distributions:
        unit = [[0.0, 1.0]] * len(names)
        share = drawn(names, unit, base, seed, second_order=second_order, scrambles=scrambles, factors=factors)
        rows = inputs.values(free, share)
    else:
        bounds = [[parameter.minimum, parameter.maximum] for parameter in free]
        rows = drawn(names, bounds, base, seed, second_order=second_order, scrambles=scrambles, factors=factors)
    at = tuple(model.names.index(name) for name in names)
    members = tuple(factors.values())
    full = model.full(names, rows)
    return Design(tuple(factors), base, second_order, full, at, scrambles, members, orders=orders)


def drawn(
    names: Sequence[str],
    bounds: Sequence[Sequence[float]],
    base: int,
    seed: int,
    *,
    second_order: bool,
    scrambles: int,
    factors: Mapping[str, tuple[int, ...]] | None = None,
) -> Array:
    """The rows ``[n, free]`` of a design: base samples of each sequence in turn. One sequence is SALib's.

    ``factors``: what moves as one, by its name; every parameter alone without it.
    """
    moves = factors or {name: (at,) for at, name in enumerate(names)}
    if scrambles == 1:
        import SALib.sample.sobol as salib_sample

        problem: dict[str, Any] = {
            "num_vars": len(names), "names": list(names), "bounds": [list(each) for each in bounds]
        }  # fmt: skip
        if len(moves) < len(names):
            group = {at: title for title, places in moves.items() for at in places}
            problem["groups"] = [group[at] for at in range(len(names))]
        return np.asarray(salib_sample.sample(problem, base, calc_second_order=second_order, scramble=True, seed=seed))
    own = np.array([np.isin(np.arange(len(names)), places) for places in moves.values()])
    sequences = [_sequence(own, base // scrambles, second_order, (seed, number)) for number in range(scrambles)]
    low, high = np.array(bounds, dtype=float).T
    return np.asarray(low + (high - low) * np.stack(sequences, axis=1).reshape(-1, len(names)))


def _correlated(inputs: Inputs, names: Sequence[str], count: int, scrambles: int, seed: int) -> tuple[Array, Array]:
    """Places in the distributions ``[n, free]`` of a design of correlated parameters, and its orders."""
    correlation, factors = inputs.of_scores(names), list(inputs.factors(names).values())
    sequences, orders = [], []
    for number in range(scrambles):
        orders.append(dependent.orders_of(len(factors), count, (seed, number, ORDERS)))
        halves = _halves(len(names), count, (seed, number))
        sequences.append(dependent.rows_of(*halves, correlation, factors, orders[-1]))
    every = np.stack(sequences, axis=1).reshape(-1, len(names))
    return every, np.stack(orders, axis=1).reshape(-1, len(factors))


def _sequence(own: Array, count: int, second_order: bool, seed: tuple[int, int]) -> Array:
    """The blocks ``[count, block, size]`` of one scrambled sequence, in SALib's order, on the unit cube.

    ``own`` ``[factors, size]``: which parameters move as one.
    """
    a, b = _halves(own.shape[1], count, seed)
    a_with_b = np.where(own, b[:, np.newaxis], a[:, np.newaxis])
    b_with_a = [np.where(own, a[:, np.newaxis], b[:, np.newaxis])] if second_order else []
    return np.concatenate([a[:, np.newaxis], a_with_b, *b_with_a, b[:, np.newaxis]], axis=1)


def _halves(size: int, count: int, seed: tuple[int, int]) -> tuple[Array, Array]:
    """The points A and B ``[count, size]`` of one scrambled sequence.

    Which parameter has which pair of columns is drawn, so that a pair that fills its square badly meets another
    parameter in each sequence.
    """
    rng = np.random.default_rng(seed)
    pairs = np.array(pairs_of(size))[rng.permutation(size)]
    points = qmc.Sobol(2 * size, scramble=True, seed=rng).random(count)
    return points[:, pairs[:, 0]], points[:, pairs[:, 1]]
