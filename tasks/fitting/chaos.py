"""Sparse polynomial chaos: outcomes as sums of few orthonormal polynomials.

Polynomials are products of Legendre's in the place of each parameter between 0 and 1 (for Sobol indices: the share of
its distribution that lies below its value), of limited degree and interaction (hyperbolic truncation). Which of them an
outcome needs is found by least angle regression; how many, and up to which degree, by the smallest leave-one-out error
of ordinary least squares (Blatman and Sudret 2011, J. Comput. Phys. 230, 2345).
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import eval_legendre

from sinew.tasks.fitting.limits import HIGHEST
from sinew.tasks.simulate import Array

NORM = 0.75  # of the exponents in the truncation: the smaller, the fewer interactions
MOST = 1500  # polynomials of a candidate
PART = 0.6  # of the number of rows: polynomials that an outcome may need
WORSE = 2  # degrees in a row that do no better, after which no higher one is tried
DEPENDENT = 1e-8  # part of a polynomial that is no combination of others, at least


@dataclass(frozen=True, eq=False)
class Basis:
    """Polynomials with ``exponents`` ``[t, d]``, the first of them constant, and the highest ``degree`` tried.

    ``unexplained``: part of the outcome's variance, by leave-one-out.
    """

    exponents: Array
    degree: int
    unexplained: float

    def coefficients(self, share: Array, outcomes: Array) -> Array:
        """``[t, ...]`` of outcomes ``[n, ...]`` at ``share`` ``[n, d]``, by least squares."""
        return np.asarray(np.linalg.lstsq(polynomials(share, self.exponents), outcomes, rcond=None)[0])


def exponents_up_to(parameters: int, degree: int) -> Array:
    """All exponents ``[t, parameters]`` whose ``NORM`` is at most the degree, the constant's first."""
    limit = degree**NORM * (1 + 1e-9)
    found: list[tuple[tuple[int, ...], float]] = [((), 0.0)]
    for _ in range(parameters):
        found = [
            ((*before, power), norm + power**NORM)
            for before, norm in found
            for power in range(degree + 1)
            if norm + power**NORM <= limit
        ]
    every = np.array([exponents for exponents, _ in found])
    return every[np.lexsort((*every.T[::-1], every.sum(axis=1)))]


def polynomials(share: Array, exponents: Array) -> Array:
    """The polynomials ``[n, t]`` at ``share`` ``[n, d]``: orthonormal where shares are uniform."""
    degrees = np.arange(exponents.max(initial=0) + 1)
    one = np.stack([np.sqrt(2 * k + 1) * eval_legendre(k, 2 * share - 1) for k in degrees])  # [degrees, n, d]
    found = np.ones((len(share), len(exponents)))
    for j in range(share.shape[1]):
        moving = exponents[:, j] > 0
        found[:, moving] *= one[exponents[moving, j], :, j].T
    return found


def basis(
    share: Array, outcome: Array, degree: int | None = None, *, most: int | None = None, beside: Array | None = None
) -> Basis:
    """The polynomials that an outcome ``[n]`` needs, of the best degree, or a given one; ``most``: how many at most.

    ``beside`` ``[n, k]``: values of functions of the parameters that are fitted together with them, all of them.
    """
    beside = np.empty((len(share), 0)) if beside is None else beside
    best: Basis | None = None
    worse = 0
    for each in (degree,) if degree is not None else range(1, HIGHEST + 1):
        exponents = exponents_up_to(share.shape[1], each)
        if best is not None and len(exponents) > MOST:
            break
        found = _of_degree(share, outcome, exponents, each, most, beside)
        if best is None or found.unexplained < best.unexplained:
            best, worse = found, 0
        else:
            worse += 1
        if worse == WORSE:
            break
    assert best is not None, "at least one degree is tried"
    return best


def joined(bases: Sequence[Basis], share: Array, outcomes: Array) -> tuple[Array, Array]:
    """All polynomials ``[t, d]`` of several outcomes ``[n, q]``, and their coefficients ``[t, q]`` in each."""
    return together([(one.exponents, one.coefficients(share, outcomes[:, j])) for j, one in enumerate(bases)])


def together(sums: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """All polynomials ``[t, d]`` of several sums of them, and their coefficients ``[t, q]`` in each.

    A sum is its exponents ``[t, d]`` and its coefficients ``[t]``.
    """
    exponents, place = np.unique(np.concatenate([of for of, _ in sums]), axis=0, return_inverse=True)
    coefficients = np.zeros((len(exponents), len(sums)))
    ends = np.cumsum([len(of) for of, _ in sums])
    for number, ((of, values), end) in enumerate(zip(sums, ends, strict=True)):
        coefficients[place.ravel()[end - len(of) : end], number] = values
    return exponents, coefficients


def _of_degree(share: Array, outcome: Array, exponents: Array, degree: int, limit: int | None, beside: Array) -> Basis:
    """The first polynomials on the path of least angle regression, as many as have the least error."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.linear_model import lars_path

    values = polynomials(share, exponents)
    count = beside.shape[1]
    most = min(int(PART * len(share)) - count, len(exponents) - 1, limit or len(exponents))
    centred = values[:, 1:] - values[:, 1:].mean(axis=0)
    left = outcome - outcome.mean()
    if count:  # what is beside them is fitted first, so the path is that of what it leaves
        directions, _ = np.linalg.qr(beside - beside.mean(axis=0))
        centred = centred - directions @ (directions.T @ centred)
        left = left - directions @ (directions.T @ left)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # nearly dependent polynomials are dropped, as they should
        standard = left / outcome.std()  # the path ends at a correlation that has a unit
        scaled = centred / np.linalg.norm(centred, axis=0)
        path = lars_path(scaled, standard, Gram="auto", method="lar", max_iter=most)
    order = np.array(path[1], dtype=int) + 1
    errors = _leave_one_out(np.column_stack([beside, values[:, order]]), outcome)[count:]
    best = int(np.argmin(errors)) if errors.size else 0
    chosen = exponents[np.concatenate([[0], order[:best]])]
    return Basis(chosen, degree, float(errors[best]) if errors.size else np.inf)


def _leave_one_out(values: Array, outcome: Array) -> Array:
    """Errors of least squares with a constant and the first 0, 1, ... columns of ``values``, in parts of the variance.

    Corrected for the number of polynomials (Chapelle, Vapnik and Bengio 2002, Mach. Learn. 48, 9).
    """
    count = len(outcome)
    directions, size = np.empty((count, values.shape[1] + 1), order="F"), 1
    directions[:, 0] = 1 / np.sqrt(count)
    left, leverage, variance = outcome - outcome.mean(), np.full(count, 1 / count), outcome.var()
    errors = []
    for column in range(values.shape[1] + 1):
        used = column + 1
        if column:
            new = values[:, column - 1]
            for _ in range(2):  # once more, for what rounding has left
                new = new - directions[:, :size] @ (directions[:, :size].T @ new)
            length = np.linalg.norm(new)
            if length < DEPENDENT * np.linalg.norm(values[:, column - 1]):
                errors.append(np.inf)
                continue
            new = new / length
            directions[:, size], size = new, size + 1
            left, leverage = left - new * (new @ left), leverage + new**2
        if used >= count - 1 or leverage.max() > 1 - DEPENDENT:
            break
        factor = count / (count - used) * (1 + used / count)
        errors.append(factor * np.mean((left / (1 - leverage)) ** 2) / variance)
    return np.array(errors)
