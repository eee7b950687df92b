"""How many rows a base sample of a sensitivity study has."""

import numpy as np


def block_of(parameters: int, second_order: bool, correlated: bool = False) -> int:
    """The rows of one base sample of Saltelli's design, or of that of ``correlated`` parameters."""
    if correlated:
        return 2 * parameters + 2 + len(lengths(parameters))
    return (2 if second_order else 1) * parameters + 2


def lengths(parameters: int) -> range:
    """How many correlated parameters the rows between the first and the last of an order draw anew.

    One and all but one are drawn anew by other rows of the base sample.
    """
    return range(2, parameters - 1)


def base_samples(points: int, block: int) -> int:
    """The smallest power of two of base samples of ``block`` rows each that has at least so many ``points``."""
    return int(2 ** max(1, int(np.ceil(np.log2(points / block)))))
