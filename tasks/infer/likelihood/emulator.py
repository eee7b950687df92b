"""A cheap stand-in for the likelihood of one specimen, near its posterior.

Whitened errors change smoothly with the parameters: products of moduli and relaxation strengths enter them exactly to
second order, and times nearly so. So their few principal components are fitted by polynomials of second order in the
parameters. What stands for the sum of squares is then the sum of squares of these polynomials, and what is left out.
Chains are led by the emulator and corrected by the model itself (:mod:`sinew.tasks.infer.likelihood.chains`), so an
error of the emulator costs time, not truth. Where a run of the model takes time, chains stay on the emulator, and their
draws are corrected (:mod:`sinew.tasks.infer.likelihood.correction`).
"""

from dataclasses import dataclass

import numpy as np

from sinew.tasks.infer.likelihood.compiled import polynomials
from sinew.tasks.simulate import Array

COMPONENTS = 40  # of the errors, at most
NEGLIGIBLE = 1e-3  # of a sum of squares: mean contribution of a component that is left out


@dataclass(frozen=True, eq=False)
class Emulator:
    """Polynomials of points ``[k]`` on the unit cube, standardised by ``centre`` and ``scale`` ``[k]``.

    ``coefficients`` ``[1 + k + k (k + 1) / 2, q]`` of ``q`` components; ``rest``: mean square of all others.
    """

    centre: Array
    scale: Array
    coefficients: Array
    rest: float

    def components(self, at: Array) -> Array:
        """The components ``[n, q]`` at points ``[n, k]``."""
        return np.asarray(_terms((at - self.centre) / self.scale) @ self.coefficients)

    def squares(self, at: Array) -> Array:
        """What the sums of squares ``[n]`` at points ``[n, k]`` are taken for."""
        return np.asarray(np.square(self.components(at)).sum(axis=1) + self.rest)

    def slopes(self, at: Array) -> Array:
        """Derivatives ``[k, q]`` of the components at a point ``[k]``."""
        count = self.coefficients.shape[1]
        found, slopes = np.empty(count), np.empty((at.size, count))
        polynomials(self.centre, self.scale, self.coefficients, at, found, slopes)
        return slopes


def _terms(at: Array) -> Array:
    """All products ``[n, 1 + k + k (k + 1) / 2]`` of up to two of the ``k`` coordinates."""
    first, second = np.triu_indices(at.shape[1])
    return np.concatenate([np.ones((len(at), 1)), at, at[:, first] * at[:, second]], axis=1)


def emulator(at: Array, errors: Array, weight: Array) -> Emulator:
    """The emulator of ``errors`` ``[n, g]`` that were computed at points ``[n, k]``, fitted with ``weight`` ``[n]``."""
    weight = weight / weight.mean()
    centre = np.average(at, axis=0, weights=weight)
    scale = np.maximum(np.sqrt(np.average((at - centre) ** 2, axis=0, weights=weight)), 1e-9)
    root = np.sqrt(weight)[:, np.newaxis]
    weighted = root * errors
    variances, directions = np.linalg.eigh(weighted @ weighted.T)
    kept = np.flatnonzero(variances > NEGLIGIBLE * len(at))[-COMPONENTS:]
    components = root**-1 * directions[:, kept] * np.sqrt(variances[kept])
    coefficients = np.linalg.lstsq(root * _terms((at - centre) / scale), root * components, rcond=None)[0]
    rest = np.average(np.square(errors).sum(axis=1) - np.square(components).sum(axis=1), weights=weight)
    return Emulator(centre, scale, coefficients, float(rest))
