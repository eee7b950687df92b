"""A finer stand-in for the likelihood of one specimen than the one that chains walk on, where a run takes time.

Walks need polynomials of second order with derivatives (:mod:`sinew.tasks.infer.likelihood.emulator`). What decides
where chains go may be any function that is quickly computed: here, the principal components of the whitened errors,
each as sparse polynomial chaos of whatever degree it needs (:mod:`sinew.tasks.fitting.chaos`), within the box of the
points that it was trained with.
"""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from sinew.tasks.fitting.chaos import basis, joined, polynomials
from sinew.tasks.infer.likelihood.emulator import NEGLIGIBLE
from sinew.tasks.simulate import Array

COMPONENTS = 30  # of the errors, at most


@dataclass(frozen=True, eq=False)
class FineEmulator:
    """Polynomials with ``exponents`` ``[t, k]`` of places in a box from ``low`` ``[k]`` with ``width`` ``[k]``.

    ``coefficients`` ``[t, q]`` of ``q`` components; ``rest``: mean square of all others.
    """

    low: Array
    width: Array
    exponents: Array
    coefficients: Array
    rest: float

    def squares(self, at: Array) -> Array:
        """What the sums of squares ``[n]`` at points ``[n, k]`` of the unit cube are taken for."""
        components = polynomials((at - self.low) / self.width, self.exponents) @ self.coefficients
        return np.asarray(np.square(components).sum(axis=1) + self.rest)


def fine_emulator(at: Array, errors: Array) -> FineEmulator:
    """The emulator of ``errors`` ``[n, g]`` that were computed at points ``[n, k]`` of the unit cube."""
    with threadpool_limits(1):  # sums in one order, on whatever machine
        low, width = at.min(axis=0), np.maximum(np.ptp(at, axis=0), 1e-9)
        place = (at - low) / width
        scores, sizes, _ = np.linalg.svd(errors, full_matrices=False)
        kept = np.flatnonzero(sizes**2 > NEGLIGIBLE * len(at))[:COMPONENTS]
        components = scores[:, kept] * sizes[kept]
        bases = [basis(place, each) for each in components.T]
        exponents, coefficients = joined(bases, place, components)
        rest = float(np.mean(np.square(errors).sum(axis=1) - np.square(components).sum(axis=1)))
        return FineEmulator(low, width, exponents, coefficients, rest)
