"""A design of plain points, each of which is a row of its own: the more of them, the better they fill the ranges."""

import numpy as np
from scipy.stats import qmc

from sinew.tasks.model import Model
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.inputs import Inputs
from sinew.tasks.simulate.saltelli import Design

OWN = 1  # beside the seed, so that no sequence is one of Saltelli's designs


def plain_design(
    model: Model, count: int, seed: int, scrambles: int, inputs: Inputs, version: int = 0
) -> tuple[Design, Array]:
    """``count`` rows over a model's free parameters, and their :func:`shares`."""
    free = model.free
    names = tuple(parameter.name for parameter in free)
    share = shares(len(free), count, seed, scrambles, version)
    factors = inputs.factors(names)
    at = tuple(model.names.index(name) for name in names)
    rows = model.full(names, inputs.values(free, share))
    return Design(tuple(factors), count, False, rows, at, scrambles, tuple(factors.values()), plain=True), share


def shares(size: int, count: int, seed: int, scrambles: int, version: int = 0) -> Array:
    """``[count, size]``: of each parameter's distribution, the part that lies below its value.

    Points come in turn from scrambles of the Sobol sequence; the first of a larger design are those of a smaller one.
    ``version``: which of several designs that have no point in common.
    """
    each = -(-count // scrambles)
    power = int(np.ceil(np.log2(each)))
    sequences = (
        qmc.Sobol(size, scramble=True, seed=np.random.default_rng([seed, OWN, n, version])) for n in range(scrambles)
    )
    points = [sequence.random_base2(power)[:each] for sequence in sequences]
    return np.stack(points, axis=1).reshape(-1, size)[:count]
