"""A design for parameters that depend on each other: parts of a row are drawn anew, given what stays.

Dependence is a Gaussian copula: each parameter's place in its distribution has a normal score, and the scores have a
correlation matrix R. A base sample has two independent sets of scores, A and B. Its rows are

    A; A with each parameter drawn anew, given all others; A with all others drawn anew, given the parameter;
    A with ever more parameters drawn anew, in an order of its own; B

(Kucherenko, Tarantola and Annoni 2012, Comput. Phys. Commun. 183, 937; for the order: Goda 2021, Reliab. Eng. Syst.
Saf. 213, 107702). Without correlations, what is drawn anew is taken from B, as in Saltelli's design.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.simulate import Array
from sinew.tasks.simulate.block import lengths

LEAST = 2.0**-40  # part of a distribution: scores stay finite
BASE_SAMPLES_AT_A_TIME = 2**12  # each has matrices of its own


def orders_of(factors: int, count: int, seed: Sequence[int]) -> Array:
    """The order ``[count, factors]`` in which each base sample draws its parameters anew.

    Each stands at each place once in as many base samples as there are parameters. The first orders of more base
    samples are those of fewer.
    """
    rng = np.random.default_rng(seed)
    kinds = np.stack([rng.permutation(factors) for _ in range(-(-count // factors))])
    shifts = (np.arange(factors)[:, np.newaxis] + np.arange(factors)) % factors
    return np.asarray(kinds[:, shifts].reshape(-1, factors)[:count])


def rows_of(a: Array, b: Array, correlation: Array, factors: Sequence[Sequence[int]], orders: Array) -> Array:
    """Places in the distributions ``[count, block, size]`` of all rows.

    ``a``, ``b`` ``[count, size]``: independent places; ``correlation`` ``[size, size]``: of the scores; ``factors``:
    which parameters move as one; ``orders`` ``[count, factors]``.
    """
    starts = range(0, len(a), BASE_SAMPLES_AT_A_TIME)
    parts = (slice(start, start + BASE_SAMPLES_AT_A_TIME) for start in starts)
    return np.concatenate([_rows_of(a[part], b[part], correlation, factors, orders[part]) for part in parts])


def _rows_of(a: Array, b: Array, correlation: Array, factors: Sequence[Sequence[int]], orders: Array) -> Array:
    lower = _lower(correlation[np.newaxis])
    first, anew = (ndtri(np.clip(each, LEAST, 1.0 - LEAST)) for each in (a, b))
    first = _times(lower, first)
    every = np.arange(len(factors))
    # what is drawn anew is so in one order everywhere: rows that differ in one parameter differ in little else then
    kept_first = [
        *((np.append(np.delete(every, j), j)[np.newaxis], every.size - 1) for j in every),
        *((np.append(j, np.delete(every, j))[np.newaxis], 1) for j in every),
        *(
            (np.concatenate([orders[:, length:], np.sort(orders[:, :length], axis=1)], axis=1), every.size - length)
            for length in lengths(every.size)
        ),
    ]
    rows = [_drawn_anew(first, anew, correlation, *_parameters_of(order, factors), kept) for order, kept in kept_first]
    return np.asarray(ndtr(np.stack([first, *rows, _times(lower, anew)], axis=1)))


def _parameters_of(order: Array, factors: Sequence[Sequence[int]]) -> tuple[Array, Array]:
    """The parameters ``[k, size]`` of an order of factors ``[k, factors]``, and which place in it each belongs to."""
    factor = np.empty(sum(map(len, factors)), dtype=int)
    for number, places in enumerate(factors):
        factor[list(places)] = number
    place = np.argsort(order, axis=1)[:, factor]
    parameters = np.argsort(place, axis=1, kind="stable")
    return parameters, np.take_along_axis(place, parameters, axis=1)


def _drawn_anew(scores: Array, anew: Array, correlation: Array, order: Array, places: Array, kept: int) -> Array:
    """``scores`` ``[count, size]`` of which the first ``kept`` places of an order stay; all others are drawn anew.

    ``order`` and ``places`` ``[count or 1, size]``. In that order, scores are L e with independent e: those of what
    stays are what they are.
    """
    lower = _lower(correlation[order[:, :, np.newaxis], order[:, np.newaxis]])
    order, stays = (np.broadcast_to(each, scores.shape) for each in (order, places < kept))
    before = np.take_along_axis(scores, order, axis=1)
    own = np.where(stays, _over(lower, before), np.take_along_axis(anew, order, axis=1))
    found = np.empty_like(scores)
    np.put_along_axis(found, order, np.where(stays, before, _times(lower, own)), axis=1)
    return found


# Libraries of linear algebra round in another way on another processor, and rows are known by their bytes.


def _lower(matrices: Array) -> Array:
    """Cholesky's lower triangles ``[k, size, size]`` of positive definite matrices."""
    left, found = matrices.copy(), np.zeros_like(matrices)
    for j in range(left.shape[1]):
        column = left[:, j:, j] / np.sqrt(left[:, j, j])[:, np.newaxis]
        found[:, j:, j] = column
        left[:, j:, j:] -= column[:, :, np.newaxis] * column[:, np.newaxis]
    return found


def _over(lower: Array, values: Array) -> Array:
    """The solutions ``[n, size]`` of triangular systems, ``lower`` ``[n or 1, size, size]``."""
    left, found = values.copy(), np.empty_like(values)
    for j in range(left.shape[1]):
        found[:, j] = left[:, j] / lower[:, j, j]
        left[:, j:] -= lower[:, j:, j] * found[:, j, np.newaxis]
    return found


def _times(lower: Array, values: Array) -> Array:
    """Products ``[n, size]`` of ``lower`` ``[n or 1, size, size]`` and ``values`` ``[n, size]``."""
    found = np.zeros_like(values)
    for j in range(values.shape[1]):
        found += lower[:, :, j] * values[:, j, np.newaxis]
    return found
