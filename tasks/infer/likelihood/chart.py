"""Coordinates in which a specimen's posterior is nearly a standard normal distribution.

What the curves determine well is a combination of parameters, as the product of a modulus and a relaxation strength,
and the combination changes from place to place: as scores, the posterior is a narrow ridge that bends, on which chains
creep. Most of the bend is one of the parameters and not of the predicted curves (Bates and Watts 1980, J. R. Stat. Soc.
B 42, 1). So the coordinates are predictions: with the components c of the emulator and the scores z,

    F(z) = [c(z), z],    v = Q' F(z),

where the columns of Q span the derivatives of F at its smallest. For components that are linear in the scores the
posterior of v is exactly standard normal (the map of randomise-then-optimise: Bardsley et al. 2014, SIAM J. Sci.
Comput. 36, A1895). Otherwise its volume, det dv/dz, belongs to every density of v.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from sinew.tasks.infer.likelihood.compiled import FARTHEST, around, displaced, slid
from sinew.tasks.infer.likelihood.emulator import Emulator
from sinew.tasks.infer.likelihood.scores import density, places
from sinew.tasks.simulate import Array

JITTER = 1e-3  # of variances, most of which are about 1

Compiled = tuple[Array, Array, Array, Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Chart:
    """Coordinates ``[k]`` of scores ``[k]``, for an emulator of ``q`` components.

    ``frame`` ``[q + k, k]``: orthonormal columns. ``root`` ``[k, k]``: derivatives of coordinates (first) by scores
    (second) at the centre. ``precision`` ``[k, k]``: inverse of the coordinates' covariance, with a standard normal
    prior of the scores.
    """

    known: Emulator
    frame: Array
    root: Array
    precision: Array

    @cached_property
    def compiled(self) -> Compiled:
        """For compiled code."""
        known, size = self.known, self.root.shape[0]
        terms = known.coefficients @ self.frame[:-size]
        first, second = np.triu_indices(size)
        bends = np.zeros((size, size, size))
        bends[first, second] += terms[1 + size :]
        bends[second, first] += terms[1 + size :]
        bends /= known.scale[:, np.newaxis, np.newaxis] * known.scale[:, np.newaxis]
        arrays = (known.centre, known.scale, known.coefficients, self.frame[-size:], terms, bends)
        centre, scale, coefficients, of_scores, terms, bends = (np.ascontiguousarray(one) for one in arrays)
        return centre, scale, coefficients, of_scores, terms, bends

    def coordinates(self, scores: Array) -> Array:
        """``[n, k]`` of ``scores`` ``[n, k]``."""
        found, known = np.empty_like(scores), self.compiled
        for here, row in zip(scores, found, strict=True):
            around(known, here, row)
        return found

    def displaced(self, scores: Array, steps: Array) -> tuple[Array, Array]:
        """The scores ``[n, k]`` that are ``steps`` ``[n, k]`` of coordinates from ``scores``.

        Also how much the logarithm ``[n]`` of the volume grew: NaN where there are no such scores, which are then those
        it began with.
        """
        ends, volumes = np.empty_like(scores), np.empty(len(scores))
        displaced(self.compiled, scores, steps, ends, volumes)
        ends[np.isnan(volumes)] = scores[np.isnan(volumes)]
        return ends, volumes

    def fitted(self, draws: Array) -> "Chart":
        """The same chart with the precision of draws ``[n, k]`` of scores."""
        covariance = np.cov(self.coordinates(draws), rowvar=False).reshape(self.root.shape)
        return replace(self, precision=np.linalg.inv(covariance + JITTER * np.eye(len(covariance))))

    def slid(self, scores: Array, number: int, wanted: Array) -> tuple[Array, Array]:
        """Scores ``[n, k]`` with those of parameter ``number`` ``wanted`` ``[n]``, from ``scores`` ``[n, k]``.

        All others follow as the data have it, along one direction of the coordinates. Also the logarithm ``[n]`` of
        how much the map stretches them: NaN where it leads nowhere, and scores are those it began with.
        """
        along = np.linalg.inv(self.root)[number]
        ends, volumes = np.empty_like(scores), np.empty(len(scores))
        slid(self.compiled, scores, number, wanted, along / np.linalg.norm(along), ends, volumes)
        ends[np.isnan(volumes)] = scores[np.isnan(volumes)]
        return ends, volumes


def chart_of(known: Emulator, start: Array) -> Chart:
    """The chart around the smallest sum of squares of components and scores, looked for from ``start``."""
    size = start.size
    prior = np.eye(size)

    def errors(scores: Array) -> Array:
        return np.concatenate([known.components(places(scores)[np.newaxis])[0], scores])

    def slopes(scores: Array) -> Array:
        return np.concatenate([(known.slopes(places(scores)) * density(scores)[:, np.newaxis]).T, prior])

    bound = FARTHEST
    found = least_squares(errors, np.clip(start, -0.99 * bound, 0.99 * bound), jac=slopes, bounds=(-bound, bound))
    jacobian = slopes(found.x)
    frame, root = np.linalg.qr(jacobian)
    signs = np.sign(np.diag(root))
    frame, root = frame * signs, root * signs[:, np.newaxis]  # volumes are positive at the centre
    return Chart(known, frame, root, np.eye(size))
