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
from typing import Any

import numba
import numpy as np
from scipy.optimize import least_squares

from sinew.tasks.infer.likelihood.emulator import Emulator, polynomials
from sinew.tasks.infer.likelihood.scores import FARTHEST, density, place, places
from sinew.tasks.simulate import Array

OUTSIDE = 2.0 * FARTHEST  # score that a path may come to before it is turned back
ITERATIONS, TOLERANCE = 12, 1e-7  # of finding scores
JITTER = 1e-3  # of variances, most of which are about 1
RETURNED = 1e-6  # difference of scores that went there and back

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

    @property
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


_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc"})


@_compiled
def around(known, scores, at):  # type: ignore[no-untyped-def]
    """Derivatives ``[k, k]`` of coordinates (second) by scores (first); writes the coordinates ``at`` the scores."""
    centre, scale, _, of_scores, terms, _ = known
    size = scores.size
    unit, stretch, slopes = np.empty(size), np.empty(size), np.empty((size, size))
    for j in range(size):
        unit[j], stretch[j], _ = place(scores[j])
    polynomials(centre, scale, terms, unit, at, slopes)
    for a in range(size):
        for b in range(size):
            at[b] += scores[a] * of_scores[a, b]
            slopes[a, b] = slopes[a, b] * stretch[a] + of_scores[a, b]
    return slopes


@_compiled
def scores_at(known, wanted, scores, at, slopes):  # type: ignore[no-untyped-def]
    """Change ``scores`` into those at coordinates ``wanted``, with coordinates ``at`` and derivatives ``slopes`` there.

    Newton's method; tells whether scores were found within ``OUTSIDE``.
    """
    for _ in range(ITERATIONS):
        scores += np.linalg.solve(slopes.T.copy(), wanted - at)
        if not np.abs(scores).max() < OUTSIDE:
            return False
        slopes[:] = around(known, scores, at)
        if np.abs(wanted - at).max() < TOLERANCE:
            return True
    return False


@_compiled
def moved(known, here, at, slopes, wanted):  # type: ignore[no-untyped-def]
    """Move from scores ``here``, with coordinates ``at`` and derivatives ``slopes`` there, to coordinates ``wanted``.

    All three are overwritten. Tells whether they can be used: not where the way back does not lead to where it began,
    as chains may only go where they could come back from.
    """
    before, origin = here.copy(), at.copy()
    if not scores_at(known, wanted, here, at, slopes):
        return False
    back = here.copy()
    if not scores_at(known, origin, back, at.copy(), slopes.copy()):
        return False
    return np.abs(back - before).max() < RETURNED


@_compiled
def displaced(known, begin, steps, ends, volumes):  # type: ignore[no-untyped-def]
    """Move scores ``begin`` ``[n, k]`` by ``steps`` ``[n, k]`` of coordinates.

    Writes the scores ``ends`` and ``volumes`` ``[n]``: how much the logarithm of the volume grew, NaN where
    ``ends`` cannot be used.
    """
    size = begin.shape[1]
    at = np.empty(size)
    for n in range(len(begin)):
        ends[n], volumes[n] = begin[n], np.nan
        slopes = around(known, begin[n], at)
        before = np.linalg.slogdet(slopes)[1]
        if moved(known, ends[n], at, slopes, at + steps[n]):
            volumes[n] = np.linalg.slogdet(slopes)[1] - before


@_compiled
def _slide(known, wanted, number, direction, scores, at, slopes):  # type: ignore[no-untyped-def]
    """Change all ``scores`` but ``number`` so that coordinates are ``wanted``, up to a multiple of ``direction``.

    Newton's method. ``slopes`` become the derivatives of coordinates, with the direction in place of those by
    ``number``; tells whether scores were found.
    """
    multiple = 0.0
    for _ in range(ITERATIONS):
        slopes[:] = around(known, scores, at)
        slopes[number] = direction
        apart = wanted + multiple * direction - at
        if np.abs(apart).max() < TOLERANCE:
            return True
        step = np.linalg.solve(slopes.T.copy(), apart)
        multiple -= step[number]
        step[number] = 0.0
        scores += step
        if not np.abs(scores).max() < OUTSIDE:
            return False
    return False


@_compiled
def slid(known, begin, number, wanted, direction, ends, volumes):  # type: ignore[no-untyped-def]
    """Move scores ``begin`` ``[n, k]`` along a ``direction`` ``[k]`` of coordinates to where one score is ``wanted``.

    That is the score of parameter ``number``, ``wanted`` ``[n]``. Writes the scores ``ends``, and ``volumes`` ``[n]``:
    the logarithm of how much the map stretches all but that score; NaN where ``ends`` cannot be used.
    """
    size = begin.shape[1]
    at, there = np.empty(size), np.empty(size)
    before, after = np.empty((size, size)), np.empty((size, size))
    for n in range(len(begin)):
        volumes[n] = np.nan
        start = around(known, begin[n], at)
        start[number] = direction
        origin, ends[n] = at.copy(), begin[n]
        ends[n, number] = wanted[n]
        if not _slide(known, origin, number, direction, ends[n], at, after):
            continue
        there[:] = ends[n]
        there[number] = begin[n, number]
        if not _slide(known, at.copy(), number, direction, there, at, before):
            continue
        if np.abs(there - begin[n]).max() < RETURNED:
            volumes[n] = np.linalg.slogdet(start)[1] - np.linalg.slogdet(after)[1]
