"""Where fits of the tissue begin, on the unit cube of the parameters that they vary."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from sinew.tasks.simulate import Array

ALIKE = (("tau_3f", "tau_3m"), ("tau_2f", "tau_2m"))  # pairs with nearly the same effect, which make local minima
FAST, SLOW = 0.05, 0.95  # of a relaxation time's range
TOE, GENTLE = "alpha_f", 0.05


def gentle(names: Sequence[str]) -> Array:
    """The middle of the ranges ``[k]``, with a gentle toe: a fit started with a sharp toe stays there."""
    return np.where(np.array(names) == TOE, GENTLE, 0.5)


def starts(names: Sequence[str], rng: np.random.Generator, count: int) -> list[Array]:
    """``count`` starts ``[k]``: the middle, exchanged relaxation times, and random points."""
    points = [np.full(len(names), 0.5), gentle(names)]
    pairs = [pair for pair in ALIKE if set(pair) <= set(names)]
    chosen = [list(names).index(name) for pair in pairs for name in pair]
    for ends in product(((FAST, SLOW), (SLOW, FAST)), repeat=len(pairs)):
        point = gentle(names)
        point[chosen] = np.concatenate(ends) if ends else []
        points.append(point)
    while len(points) < count:
        points.append(rng.random(len(names)))
    return points[:count]
