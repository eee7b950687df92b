"""What chains of a specimen compute most: compiled, with one number or row after another.

All of it stands in one file: numba compiles a function again when its own file has changed, but not when the file of a
function that it calls has.

``known``: an emulator and a chart, as :attr:`sinew.tasks.infer.likelihood.chart.Chart.compiled` hands them over.
"""

import math
from typing import Any

import numba
import numpy as np

FARTHEST = 3.0  # score of the ends of a range
BELOW = 0.5 * math.erfc(FARTHEST * math.sqrt(0.5))
WHOLE = 1.0 - 2.0 * BELOW
OUTSIDE = 2.0 * FARTHEST  # score that a path may come to before it is turned back
ITERATIONS, TOLERANCE = 12, 1e-7  # of finding scores
RETURNED = 1e-6  # difference of scores that went there and back
STEPS = 7  # of a path

_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy", fastmath={"contract", "reassoc"})


@_compiled
def place(score):  # type: ignore[no-untyped-def]
    """The place at a score, and its first and second derivative; beyond the ends on their tangents."""
    within = min(max(score, -FARTHEST), FARTHEST)
    first = math.exp(-0.5 * within * within) / math.sqrt(2.0 * math.pi) / WHOLE
    at = (0.5 * math.erfc(-within * math.sqrt(0.5)) - BELOW) / WHOLE + first * (score - within)
    return at, first, (-within * first if within == score else 0.0)


@_compiled
def polynomials(centre, scale, coefficients, unit, found, slopes):  # type: ignore[no-untyped-def]
    """Write what polynomials ``[q]`` of second order are ``found`` to be at a point ``unit`` ``[k]``.

    And their derivatives ``slopes`` ``[k, q]`` there.
    """
    size, count = unit.size, found.size
    z = (unit - centre) / scale
    found[:] = coefficients[0]
    row = 1
    for j in range(size):
        for q in range(count):
            slopes[j, q] = coefficients[row, q]
            found[q] += z[j] * coefficients[row, q]
        row += 1
    for i in range(size):
        for j in range(i, size):
            product = z[i] * z[j]
            for q in range(count):
                coefficient = coefficients[row, q]
                found[q] += product * coefficient
                slopes[i, q] += z[j] * coefficient
                slopes[j, q] += z[i] * coefficient
            row += 1
    for j in range(size):
        for q in range(count):
            slopes[j, q] /= scale[j]


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


@_compiled
def _energy(known, power, mean, precision, scores, derivatives, slope):  # type: ignore[no-untyped-def]
    """Minus the log posterior density of coordinates at ``scores``, up to a constant, and its ``slope`` there.

    ``derivatives`` ``[k, k]`` of coordinates by scores.
    """
    centre, scale, coefficients, of_scores, _, bends = known
    size, count = scores.size, coefficients.shape[1]
    unit, stretch, bent, by_scores = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    components, slopes = np.empty(count), np.empty((size, count))
    inverse = np.linalg.inv(derivatives)
    for j in range(size):
        unit[j], stretch[j], bent[j] = place(scores[j])
    polynomials(centre, scale, coefficients, unit, components, slopes)
    squares = 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += precision[i, j] * (scores[j] - mean[j])
        by_scores[i] = total
        squares += total * (scores[i] - mean[i])
    energy = np.linalg.slogdet(derivatives)[1] + (0.5 * power * np.log1p(squares) if power > 0.0 else 0.5 * squares)
    for q in range(count):
        energy += 0.5 * components[q] * components[q]
    for i in range(size):
        if power > 0.0:
            by_scores[i] *= power / (1.0 + squares)
        total = 0.0
        for q in range(count):
            total += slopes[i, q] * components[q]
        volume = 0.0
        for a in range(size):  # the slope of the volume: the trace of the inverse times how derivatives change
            bend = 0.0
            for b in range(size):
                bend += bends[a, i, b] * inverse[b, a]
            total += stretch[a] * bend
        for b in range(size):
            volume += bent[i] / stretch[i] * (derivatives[i, b] - of_scores[i, b]) * inverse[b, i]
        by_scores[i] += stretch[i] * total + volume
    for b in range(size):
        slope[b] = 0.0
        for a in range(size):
            slope[b] += inverse[b, a] * by_scores[a]
    return energy


@_compiled
def _kicked(momentum, root, slope, length):  # type: ignore[no-untyped-def]
    """A momentum changed by a force, which is minus the ``slope`` along the columns of ``root``."""
    return momentum - length * (root.T @ slope)


@_compiled
def _farthest(scores):  # type: ignore[no-untyped-def]
    """The place in ``scores`` of the one that is farthest beyond an end of its range, -1 where none is."""
    found, beyond = -1, FARTHEST
    for j in range(scores.size):
        if abs(scores[j]) > beyond:
            found, beyond = j, abs(scores[j])
    return found


@_compiled
def _turned_back(momentum, root, derivatives, number):  # type: ignore[no-untyped-def]
    """A momentum reflected on the surface of equal scores of parameter ``number`` (Betancourt 2011)."""
    normal = root.T @ np.linalg.inv(derivatives)[:, number].copy()
    return momentum - 2.0 * np.dot(momentum, normal) / np.dot(normal, normal) * normal


@_compiled
def paths(known, power, mean, precision, roots, begin, momenta, lengths, backward, chances):  # type: ignore[no-untyped-def]
    """Where chains come to that ``begin`` ``[c, k]``: see :func:`sinew.tasks.infer.likelihood.walk.walk`.

    Each path has ``momenta`` ``[p, c, k]``, ``lengths`` ``[p, c]`` of its steps, ``backward`` ``[p, c]`` of them in the
    other direction, and ``chances`` ``[p, c, 2, STEPS]``, one for each point, to end there.
    """
    count, chains, size = momenta.shape
    ends = begin.copy()
    start, at, slope = np.empty(size), np.empty(size), np.empty(size)
    for chain in range(chains):
        m, p, root = mean[chain], precision[chain], roots[chain]
        for path in range(count):
            start[:] = ends[chain]
            total, first = 1.0, 0.0
            for way in range(2):
                momentum = momenta[path, chain] if way == 0 else -momenta[path, chain]
                steps = backward[path, chain] if way == 1 else STEPS - backward[path, chain]
                here, length, inside = start.copy(), lengths[path, chain], True
                slopes = around(known, here, at)
                wanted = at.copy()
                energy = _energy(known, power, m, p, here, slopes, slope)
                first = energy + 0.5 * np.sum(momentum * momentum)
                for step in range(steps):
                    if inside:
                        momentum = _kicked(momentum, root, slope, 0.5 * length)
                    wanted += length * (root @ momentum)
                    if not moved(known, here, at, slopes, wanted):
                        break
                    outside = _farthest(here)
                    inside = outside < 0
                    if not inside:
                        momentum = _turned_back(momentum, root, slopes, outside)
                        continue
                    energy = _energy(known, power, m, p, here, slopes, slope)
                    momentum = _kicked(momentum, root, slope, 0.5 * length)
                    weight = np.exp(first - energy - 0.5 * np.sum(momentum * momentum))
                    total += weight
                    if chances[path, chain, way, step] * total < weight:
                        ends[chain] = here
    return ends
