"""Scores: the scale on which the specimens of a population are normal.

A score z between -3 and 3 stands for the place

    u = (Phi(z) - Phi(-3)) / (Phi(3) - Phi(-3))

of a parameter in its range, Phi being the normal distribution: standard normal scores are uniform over the range. Its
ends are reached, as fits of real specimens often lie on one; a population's scores beyond them stand for the end.
"""

import math
from typing import Any

import numba
import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.simulate import Array

FARTHEST = 3.0
BELOW = float(ndtr(-FARTHEST))
WHOLE = 1.0 - 2.0 * BELOW


def places(scores: Array) -> Array:
    """The places in their ranges, of any shape, where ``scores`` are."""
    return np.asarray((ndtr(np.clip(scores, -FARTHEST, FARTHEST)) - BELOW) / WHOLE)


def scores_of(at: Array) -> Array:
    """The scores of places ``at``, of any shape."""
    return np.asarray(ndtri(BELOW + WHOLE * at))


def density(scores: Array) -> Array:
    """The derivatives of places by ``scores`` within the ends."""
    return np.asarray(np.exp(-0.5 * scores**2) / np.sqrt(2.0 * np.pi) / WHOLE)


def inside(scores: Array) -> Array:
    """Which points ``[n]`` have all their ``scores`` ``[n, k]`` within the ends."""
    return np.asarray((np.abs(scores) <= FARTHEST).all(axis=1))


_compiled: Any = numba.njit(nogil=True, cache=True, error_model="numpy")


@_compiled
def place(score):  # type: ignore[no-untyped-def]
    """The place at a score, and its first and second derivative; beyond the ends on their tangents."""
    within = min(max(score, -FARTHEST), FARTHEST)
    first = math.exp(-0.5 * within * within) / math.sqrt(2.0 * math.pi) / WHOLE
    at = (0.5 * math.erfc(-within * math.sqrt(0.5)) - BELOW) / WHOLE + first * (score - within)
    return at, first, (-within * first if within == score else 0.0)
