"""Scores: the scale on which the specimens of a population are normal.

A score z between -3 and 3 stands for the place

    u = (Phi(z) - Phi(-3)) / (Phi(3) - Phi(-3))

of a parameter in its range, Phi being the normal distribution: standard normal scores are uniform over the range. Its
ends are reached, as fits of real specimens often lie on one; a population's scores beyond them stand for the end.
"""

import numpy as np
from scipy.special import ndtr, ndtri

from sinew.tasks.infer.likelihood.compiled import BELOW, FARTHEST, WHOLE
from sinew.tasks.simulate import Array


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
