"""First order indices from any sample of rows that ran: they hold whatever region of the ranges fails.

Where a region fails, what is left of the ranges is no box: a parameter's value there tells where the others can be.
Estimators that exchange one parameter at a time do not hold then. These do, for rows drawn alike and independently:

    S1 = Var(E(Y | X_j)) / Var(Y)

of the distribution of the rows that ran. E(Y | X_j) is a polynomial of the rank of X_j (as the given-data estimators of
Plischke, Borgonovo and Smith 2013, Eur. J. Oper. Res. 226, 536, use parts). The variance of one such estimate holds its
own error as well. The product of estimates from two independent scrambles does not, so the mean of the products of all
pairs is used. With one sequence, the share is adjusted as R squared is, which is too much for a sequence that is more
even than random rows.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander

from sinew.tasks.simulate.saltelli import Design
from sinew.tasks.sobol.method import Intervals, moderate
from sinew.tasks.sobol.result import KEYS

Array = np.ndarray[Any, Any]
ROWS_PER_TERM, HIGHEST = 8, 8  # rows of a scramble for each term, at least; degree


@dataclass(frozen=True, eq=False)
class Independent:
    """Rows of a design that are independent of each other within a base sample, and ran.

    ``features`` ``[k, d]``: their free parameters; ``at`` ``[k]``: their numbers in the design; ``scramble`` ``[k]``:
    the sequence that each is from.
    """

    features: Array
    at: Array
    scramble: Array


def independent(design: Design, features: Array, ok: Array) -> Independent:
    """The first and the last row of each base sample, where it is ``ok`` ``[n]``.

    ``features`` ``[base samples, 2, d]``: the free parameters of these rows.
    """
    first = np.arange(design.base_samples) * design.block
    at = np.stack([first, first + design.block - 1], axis=1)
    ran = ok[at]
    scramble = np.repeat(design.scramble[:, np.newaxis], 2, axis=1)
    return Independent(features[ran], at[ran], scramble[ran])


def first_order(rows: Independent, outcomes: Array, intervals: Intervals) -> dict[str, Array]:
    """S1 and the half-widths of its intervals ``[d, m]`` for outcomes ``[k, m]``; ST is NaN.

    NaN for outputs that do not vary, and for groups of several parameters.
    """
    outcomes = moderate(outcomes)
    size, count = rows.features.shape[1], outcomes.shape[1]
    found = {key: np.full((size, count), np.nan) for key in KEYS}
    centred = outcomes - outcomes.mean(axis=0)
    variance = np.square(centred).mean(axis=0)
    varies = variance > (1e-12 * np.abs(outcomes).max(axis=0)) ** 2
    there, counts = np.unique(rows.scramble, return_counts=True)
    degree = int(np.clip(counts.min() // ROWS_PER_TERM, 1, HIGHEST))
    factor = intervals.resampled(rows.scramble)[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        for j in range(size):
            if np.isnan(rows.features[:, j]).any():  # a group, which has no order
                continue
            basis = _polynomials(rows.features[:, j], degree)
            if there.size == 1:
                explained = np.square(_terms(basis, centred)).sum(axis=0) / variance
                share = 1.0 - (1.0 - explained) * (len(outcomes) - 1) / (len(outcomes) - 1 - degree)
                found["S1"][j] = np.where(varies, share, np.nan)
                continue
            terms = np.stack([_terms(basis[rows.scramble == each], centred[rows.scramble == each]) for each in there])
            values = [
                _product(terms),
                *(_product(np.delete(terms, left_out, axis=0)) for left_out in range(len(terms))),
            ]
            shares = np.stack(values) / variance
            found["S1"][j] = np.where(varies, shares[0], np.nan)
            found["S1_conf"][j] = np.where(varies, factor * shares[1:].std(axis=0, ddof=1), np.nan)
    return found


def _polynomials(feature: Array, degree: int) -> Array:
    """Polynomials ``[k, degree + 1]`` of the rank of a feature ``[k]``, orthonormal over its rows."""
    place = (2.0 * np.argsort(np.argsort(feature, kind="stable"), kind="stable") + 1.0) / feature.size - 1.0
    return np.asarray(np.linalg.qr(legvander(place, degree))[0] * np.sqrt(feature.size))


def _terms(basis: Array, centred: Array) -> Array:
    """Coefficients ``[degree, m]`` of the polynomials that fit outcomes ``[k, m]``, without the constant."""
    return np.asarray(np.linalg.lstsq(basis, centred, rcond=1e-9)[0][1:])


def _product(terms: Array) -> Array:
    """The mean product ``[m]`` of the terms ``[scrambles, degree, m]`` of all pairs of scrambles."""
    count = len(terms)
    both = np.square(terms.sum(axis=0)).sum(axis=0) - np.square(terms).sum(axis=(0, 1))
    return np.asarray(both / (count * (count - 1)))
