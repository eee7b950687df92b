"""What no effect explains: a random smooth course of a quantity, whose size is estimated with the parameters.

Every model of tissue is wrong in some smooth way. Judged against noise alone, any effect that follows the error a
little would be certain. So the error has a prior of its own (Kennedy and O'Hagan 2001, J R Stat Soc B 63): three sums
of splines (:mod:`sinew.tasks.fitting.splines`) with normal coefficients of mean zero, each sum with its own
size:

1. the same in all curves of a specimen;
2. the same, growing or fading with the logarithm of the number of the cycle or step;
3. different in each curve.

The sizes are those of the largest evidence (Rasmussen and Williams 2006, Gaussian processes for machine learning,
section 5.4). The evidence also counts how closely the data determine the parameters (Laplace's approximation), so a
candidate with more parameters needs no further penalty.

Where more than the force is compared, each quantity has a discrepancy of its own
(:mod:`sinew.tasks.fitting.discrepancies`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from sinew.tasks.fitting.measured import Measured
from sinew.tasks.fitting.splines import COEFFICIENTS, KINDS, piece_of, ranges_of, spline_forces
from sinew.tasks.model import FORCE
from sinew.tasks.simulate import Array

WIDTH = 12.0  # precision of a parameter that is anywhere on the unit cube
SMALLEST, LARGEST = -4.6, 7.0  # logarithm of a size, in units of the noise


def possible_sizes(sizes: Array) -> bool:
    """Whether log ``sizes`` ``[blocks]`` can be those of a discrepancy."""
    return bool(((sizes >= SMALLEST) & (sizes <= LARGEST)).all())


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """The sums of splines of one quantity of a specimen, whitened.

    ``blocks``: each ``[g, c]``, of unit mean square; ``basis`` ``[g, q]``: orthonormal columns that span all of them;
    ``grams``: of each block, ``[q, q]``.
    """

    blocks: tuple[Array, ...]
    basis: Array
    grams: tuple[Array, ...]

    @classmethod
    def of(cls, blocks: Sequence[Array]) -> "Discrepancy":
        """A discrepancy of these ``blocks``."""
        basis, _ = np.linalg.qr(np.concatenate(blocks, axis=1))
        within = [basis.T @ block for block in blocks]
        return cls(tuple(blocks), basis, tuple(one @ one.T for one in within))

    def evidence(self, sizes: Array, error: Array, slopes: Array) -> float:
        """Minus twice the logarithm of the evidence of whitened residuals ``error`` ``[g]`` at a fit.

        ``sizes`` ``[blocks]`` are logarithms, ``slopes`` ``[g, k]`` the derivatives of the residuals by the parameters
        (unit cube). Constants that all models have in common are left out.
        """
        alone, precision = self.terms(sizes, error, slopes)
        return alone + determined(precision)

    def terms(self, sizes: Array, error: Array, slopes: Array) -> tuple[float, Array]:
        """The evidence but for how closely the parameters are determined, and their precision ``[k, k]``."""
        return self._terms(sizes, *_reduced(self.basis, error, slopes))

    def _terms(self, sizes: Array, error: Array, slopes: Array, beside: float, rest: Array) -> tuple[float, Array]:
        covariance = np.eye(self.basis.shape[1])
        for size, gram in zip(sizes, self.grams, strict=True):
            covariance += np.exp(2.0 * size) * gram
        root = np.linalg.cholesky(covariance)
        white = solve_triangular(root, np.column_stack([error, slopes]), lower=True, check_finite=False)
        precision = rest + white[:, 1:].T @ white[:, 1:]
        return float(beside + white[:, 0] @ white[:, 0] + 2.0 * np.log(np.diag(root)).sum()), precision

    def sized(
        self, error: Array, slopes: Array, begin: Array, iterations: int = 30, others: Array | float = 0.0
    ) -> tuple[Array, float]:
        """The sizes ``[blocks]`` of the largest evidence, found from ``begin``, and that evidence.

        ``others`` ``[k, k]``: the precision that other quantities give the parameters.
        """
        reduced = _reduced(self.basis, error, slopes)

        def evidence(sizes: Array) -> float:
            alone, precision = self._terms(sizes, *reduced)
            return alone + determined(precision + others)

        best = minimize(
            evidence, begin, method="L-BFGS-B",
            bounds=[(SMALLEST, LARGEST)] * len(self.blocks), options={"maxiter": iterations},
        )  # fmt: skip
        return best.x, float(best.fun)

    def directions(self, sizes: Array) -> tuple[Array, Array]:
        """Orthonormal directions ``[g, d]`` of a discrepancy of log ``sizes``.

        And the share ``[d]`` of residuals along each that is to be taken out, so that the rest is white.
        """
        every = np.concatenate([np.exp(size) * one for size, one in zip(sizes, self.blocks, strict=True)], axis=1)
        directions, spreads, _ = np.linalg.svd(every, full_matrices=False)
        return directions, 1.0 - 1.0 / np.sqrt(1.0 + spreads**2)

    def whitening(self, sizes: Array) -> Callable[[Array], Array]:
        """What makes residuals ``[g]``, or slopes ``[g, k]``, of discrepancies of these sizes and noise white."""
        directions, taken = self.directions(sizes)

        def white(vectors: Array) -> Array:
            left: Array = vectors - (directions * taken) @ (directions.T @ vectors)
            return left

        return white


def determined(precision: Array) -> float:
    """What the evidence counts for parameters that the data determine with this ``precision`` ``[k, k]``."""
    return float(np.linalg.slogdet(precision / WIDTH + np.eye(len(precision)))[1])


def _reduced(basis: Array, error: Array, slopes: Array) -> tuple[Array, Array, float, Array]:
    """Residuals and slopes within the basis, the square of the residuals beside it, and the slopes' products there."""
    within, along = basis.T @ error, basis.T @ slopes
    return within, along, float(error @ error - within @ within), slopes.T @ slopes - along.T @ along


def discrepancy_of(measured: Measured, root: Array | None = None, quantity: str = FORCE) -> Discrepancy:
    """The discrepancy of a ``quantity`` of a specimen.

    ``root`` ``[coefficients, coefficients]``: of the covariance of each spline's coefficients; without, these are
    independent.
    """
    curves = measured.curves
    pieces = [piece_of(measured, curve) for curve in curves]
    ranges = ranges_of(pieces)
    white = [
        measured.thinned[curve.name].quantities[quantity].weights @ spline_forces(piece, ranges)
        for curve, piece in zip(curves, pieces, strict=True)
    ]
    grows = np.tile(np.repeat([False, True], COEFFICIENTS), len(KINDS))
    every = np.concatenate(white)
    if root is not None:
        every = np.concatenate(
            [part @ root for part in np.split(every, every.shape[1] // COEFFICIENTS, axis=1)], axis=1
        )
    blocks = [every[:, ~grows], every[:, grows]]
    if len(curves) > 1:
        ends = np.cumsum([0, *(len(one) for one in white)])
        own = np.zeros((len(every), len(curves), int((~grows).sum())))
        for number, (begin, end) in enumerate(pairwise(ends)):
            own[begin:end, number] = every[begin:end, ~grows]
        blocks.append(own.reshape(len(every), -1))
    blocks = [block[:, np.any(block != 0.0, axis=0)] for block in blocks]
    return Discrepancy.of([block / np.sqrt(np.square(block).sum() / len(block)) for block in blocks if block.size])
