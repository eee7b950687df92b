"""Coordinates in which a specimen's posterior is nearly straight, and which have no bounds.

The force of the tissue is linear in the products of a modulus and its relaxation strengths, and a decay depends about
linearly on the logarithm of its time. What the data determine well is such a product, so on the plain parameters the
posterior is a narrow bent ridge, on which chains creep; on the scale of scores it is bent again near a bound. So

========================  ============================================================================================
parameter                 coordinate
========================  ============================================================================================
relaxation strength g     E (low + width w), with its modulus E
relaxation time t         w = log(t / low) / log(high / low) + SOFT score
any other                 w = u + SOFT score
========================  ============================================================================================

where u is the parameter on the unit cube: in the middle of a range the score hardly counts, near a bound it takes over.
For g, w is as in the last row.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from scipy.special import ndtr

from sinew.tasks.model.parameters import Parameter, bounds
from sinew.tasks.simulate import Array

SOFT = 0.04
ITERATIONS = 60  # of a root, at most
TOLERANCE = 1e-12
FARTHEST = 4.0  # score that is looked at: 3e-5 of the range from a bound


@dataclass(frozen=True, eq=False)
class Chart:
    """The coordinates of ``k`` parameters ``low`` + ``width`` u.

    ``modulus`` ``[k]``: for a relaxation strength the place of its modulus, else -1. ``decades`` ``[k]``: for a
    relaxation time the logarithm of high / low, else 0.
    """

    low: Array
    width: Array
    modulus: Array
    decades: Array

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """For compiled code."""
        return self.low, self.width, self.modulus, self.decades

    def coordinates(self, scores: Array) -> Array:
        """``[n, k]`` of ``scores`` ``[n, k]``."""
        found = np.empty_like(scores)
        for row, here in zip(found, scores, strict=True):
            from_scores(*self.arrays, here, row)
        return found

    def slopes(self, scores: Array) -> Array:
        """Derivatives ``[n, k, k]`` of scores (first) by the coordinates (second)."""
        unit, densities = ndtr(scores), density(scores)
        by_scores = np.zeros((*scores.shape, scores.shape[1]))
        for j, modulus in enumerate(self.modulus):
            stretch = densities[:, j]
            soft = stretch + SOFT
            if self.decades[j]:
                soft = stretch * self.width[j] / (self.low[j] + self.width[j] * unit[:, j]) / self.decades[j] + SOFT
            own = self.low[modulus] + self.width[modulus] * unit[:, modulus] if modulus >= 0 else 1.0
            by_scores[:, j, j] = own * soft * (self.width[j] if modulus >= 0 else 1.0)
            if modulus >= 0:
                other = self.width[modulus] * densities[:, modulus]
                by_scores[:, j, modulus] = other * (self.low[j] + self.width[j] * (unit[:, j] + SOFT * scores[:, j]))
        return np.asarray(np.linalg.inv(by_scores))


def chart_of(parameters: Sequence[Parameter]) -> Chart:
    """The chart of the parameters that vary."""
    low, high = bounds(parameters)
    names = [parameter.name for parameter in parameters]
    modulus, decades = np.full(len(names), -1, dtype=np.int64), np.zeros(len(names))
    for j, parameter in enumerate(parameters):
        if parameter.own:
            continue
        if parameter.name.startswith("g_") and (of := f"E_{parameter.name[-1]}") in names:
            modulus[j] = names.index(of)
        if parameter.name.startswith("tau_") and parameter.minimum > 0.0:
            decades[j] = np.log(parameter.maximum / parameter.minimum)
    return Chart(low, high - low, modulus, decades)


def density(scores: Array) -> Array:
    """The derivative of the unit cube by normal scores."""
    return np.asarray(np.exp(-0.5 * scores**2) / np.sqrt(2.0 * np.pi))


_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy")


@_compiled
def on_cube(score):  # type: ignore[no-untyped-def]
    """The point of the unit cube at a normal score, and its derivative: the normal distribution and its density."""
    return 0.5 * math.erfc(-score * math.sqrt(0.5)), math.exp(-0.5 * score * score) / math.sqrt(2.0 * math.pi)


@_compiled
def _soft(low, width, decades, score):  # type: ignore[no-untyped-def]
    """The coordinate w of a score, its first and its second derivative."""
    unit, stretch = on_cube(score)
    bend = -score * stretch
    if decades == 0.0:
        return unit + SOFT * score, stretch + SOFT, bend
    value = low + width * unit
    first = width * stretch / value
    second = width * bend / value - first * first
    return np.log(value / low) / decades + SOFT * score, first / decades + SOFT, second / decades


@_compiled
def _score(low, width, decades, w, guess):  # type: ignore[no-untyped-def]
    """The score whose coordinate is ``w``, from a ``guess`` by Newton's method within bounds that close in."""
    left, right = (w - 1.0) / SOFT, w / SOFT  # as 0 <= w - SOFT score <= 1
    at = min(max(guess, left), right)
    for _ in range(ITERATIONS):
        here, slope, _ = _soft(low, width, decades, at)
        if abs(here - w) < TOLERANCE:
            break
        if here > w:
            right = at
        else:
            left = at
        at -= (here - w) / slope
        if not left < at < right:
            at = 0.5 * (left + right)
    return at


@_compiled
def from_scores(low, width, modulus, decades, scores, at):  # type: ignore[no-untyped-def]
    """Write the coordinates ``at`` a point on the scale of scores."""
    for j in range(at.size):
        at[j] = _soft(low[j], width[j], decades[j], scores[j])[0]
    for j in range(at.size):
        if modulus[j] >= 0:
            m = modulus[j]
            at[j] = (low[m] + width[m] * on_cube(scores[m])[0]) * (low[j] + width[j] * at[j])


@_compiled
def to_scores(low, width, modulus, decades, at, scores):  # type: ignore[no-untyped-def]
    """Write the scores at coordinates ``at``, from those there as a guess; whether all are within ``FARTHEST``."""
    for j in range(at.size):
        if modulus[j] < 0:
            scores[j] = _score(low[j], width[j], decades[j], at[j], scores[j])
    near = True
    for j in range(at.size):
        if modulus[j] >= 0:
            m = modulus[j]
            strength = at[j] / (low[m] + width[m] * on_cube(scores[m])[0])
            scores[j] = _score(low[j], width[j], decades[j], (strength - low[j]) / width[j], scores[j])
        near = near and abs(scores[j]) < FARTHEST
    return near


@_compiled
def pull_back(low, width, modulus, decades, scores, slope):  # type: ignore[no-untyped-def]
    """Turn the ``slope`` of minus a log density on the scale of scores into that in the coordinates, in place.

    Returns what is to be added to minus the log density: the logarithm of the volume.
    """
    volume = 0.0
    size = slope.size
    for j in range(size):
        _, first, second = _soft(low[j], width[j], decades[j], scores[j])
        volume += np.log(first)
        slope[j] += second / first
        if modulus[j] >= 0:
            m = modulus[j]
            unit, stretch = on_cube(scores[m])
            value = low[m] + width[m] * unit
            volume += np.log(value)
            slope[m] += width[m] * stretch / value
    for j in range(size):
        if modulus[j] >= 0:
            m = modulus[j]
            unit, stretch = on_cube(scores[m])
            w, first, _ = _soft(low[j], width[j], decades[j], scores[j])
            slope[j] /= (low[m] + width[m] * unit) * width[j] * first
            slope[m] -= slope[j] * width[m] * stretch * (low[j] + width[j] * w)
    for j in range(size):
        if modulus[j] < 0:
            slope[j] /= _soft(low[j], width[j], decades[j], scores[j])[1]
    return volume
