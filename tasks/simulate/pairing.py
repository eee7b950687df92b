"""Which columns of a Sobol sequence belong to the same parameter in Saltelli's matrices A and B.

Total indices compare a parameter's value in A with its value in B. Some pairs of columns of the sequence fill their
square badly as long as there are few points (Joe and Kuo 2008, SIAM J. Sci. Comput. 30, 2635): with 64 points or fewer,
both values may then have their first digits in common, and estimates from one scramble are a half or twice the truth.
Scrambling changes no such pattern, so pairs are chosen that fill their squares well.
"""

from functools import lru_cache

import numpy as np
from scipy.stats import qmc

from sinew.tasks.simulate import Array

SIZES = range(3, 10)  # powers of two: numbers of points for which squares should be filled


@lru_cache(maxsize=16)
def pairs_of(count: int) -> tuple[tuple[int, int], ...]:
    """A partner for each of ``2 count`` columns of the sequence: the best first, then exchanged while that helps."""
    cost = _gaps(2 * count) ** 2
    found: list[tuple[int, int]] = []
    first, second = np.triu_indices(2 * count, 1)
    free = set(range(2 * count))
    for place in np.argsort(cost[first, second], kind="stable"):
        one, other = int(first[place]), int(second[place])
        if one in free and other in free:
            found.append((one, other))
            free -= {one, other}
    while _exchanged(found, cost):
        pass
    return tuple(found)


def _exchanged(pairs: list[tuple[int, int]], cost: Array) -> bool:
    """Exchange partners, in place, wherever two pairs become better together; whether there were any."""
    changed = False
    for i in range(len(pairs)):
        for j in range(i + 1, len(pairs)):
            (a, b), (c, d) = pairs[i], pairs[j]
            ways = (((a, b), (c, d)), ((a, c), (b, d)), ((a, d), (b, c)))
            sums = [cost[one] + cost[other] for one, other in ways]
            best = int(np.argmin(sums))
            if sums[best] < sums[0] - 1e-9:
                pairs[i], pairs[j] = ways[best]
                changed = True
    return changed


def _gaps(columns: int) -> Array:
    """How badly each two columns ``[c, c]`` fill their square: shares of empty boxes, summed over sizes and shapes.

    2**m points are spread over boxes of all 2**m equal areas and shapes; in the best case each holds one.
    """
    points = qmc.Sobol(columns, scramble=False).random_base2(max(SIZES))
    found = np.zeros((columns, columns))
    for power in SIZES:
        count = 2**power
        for cut in range(1, power):
            across = (points[:count] * 2**cut).astype(int)
            up = (points[:count] * 2 ** (power - cut)).astype(int)
            for one in range(columns):
                filled = np.zeros((columns, count), dtype=bool)
                filled[np.arange(columns), across[:, one, np.newaxis] * 2 ** (power - cut) + up] = True
                found[one] += 1.0 - filled.mean(axis=1)
    return found + found.T
