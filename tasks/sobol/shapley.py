"""Indices of parameters that depend on each other, from the rows of :mod:`sinew.tasks.simulate.dependent`.

======  ==========================================================================================================
index   part of the variance
======  ==========================================================================================================
S1      expected reduction if the parameter were known, with what is learned about those that correlate with it
ST      expected remainder if all other parameters were known. It can be smaller than S1
Sh      Shapley effect: what the parameter adds to the variance of those before it, averaged over all orders (Owen 2014,
        SIAM/ASA J. Uncertain. Quantif. 2, 245; Song, Nelson and Staum 2016, ibid. 4, 1060). Shapley effects sum to 1;
        estimates are negative by sampling error only
======  ==========================================================================================================

If y' is the outcome with some parameters drawn anew, the expected variance due to them is E(y - y')^2 / 2. Each base
sample has an order in which its parameters are drawn anew, one more at a time; what each adds is its effect there.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]


def terms(blocks: Array, orders: Array) -> Iterator[tuple[Array, Array, Array]]:
    """Of each parameter what each base sample adds ``[n, m]`` to S1, ST and Sh, in units of the outcomes squared.

    ``blocks`` ``[n, block, m]``: outcomes less their mean; ``orders`` ``[n, d]``. All terms of Sh together are
    (A - B)^2 / 2.
    """
    n, d = orders.shape
    a, b = blocks[:, 0], blocks[:, -1]
    base, along = np.arange(n), _along(orders, blocks.shape[1])
    for j in range(d):
        others_anew, anew = blocks[:, 1 + d + j], blocks[:, 1 + j]
        place = np.argmax(orders == j, axis=1)
        before, after = blocks[base, along[base, place]], blocks[base, along[base, place + 1]]
        yield a * (others_anew - b), 0.5 * (a - anew) ** 2, (before - after) * (a - 0.5 * (before + after))


def _along(orders: Array, block: int) -> Array:
    """Which row of its block ``[n, d + 1]`` has the first 0, 1, ... d of each order drawn anew."""
    n, d = orders.shape
    found = np.zeros((n, d + 1), dtype=int)
    found[:, 2 : d - 1] = 1 + 2 * d + np.arange(max(0, d - 3))
    if d > 2:
        found[:, d - 1] = 1 + d + orders[:, -1]  # all but the last
    found[:, 1] = 1 + orders[:, 0]
    found[:, d] = block - 1
    return found
