"""The noise of a measured curve, from the curve alone: no model is asked.

Neighbouring points differ by noise, and by a signal that changes smoothly. Differences over one point and over two,
each less its running mean, give the level and the correlation of an AR(1) process: their variances are
2 s^2 (1 - r) and 2 s^2 (1 - r^2) (difference-based estimators: Hall, Kay and Titterington 1990, Biometrika 77).
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import median_abs_deviation

from tasks.model import Curve
from tasks.simulate import Array

WINDOW = 25
FEWEST = 4 * WINDOW


@dataclass(frozen=True)
class Noise:
    """Standard deviation (N) and correlation of neighbouring points; NaN where a curve has too few points to tell."""

    sd_N: float
    ar1: float

    @property
    def inflation(self) -> float:
        """How many correlated points weigh as much as one that is independent."""
        return (1.0 + self.ar1) / (1.0 - self.ar1)


def noise_of(curve: Curve) -> Noise:
    """Noise of a curve of at least ``FEWEST`` points that is sampled evenly, but for a jump now and then."""
    if curve.force_N.size < FEWEST:
        return Noise(float("nan"), float("nan"))
    one, two = (_variance(curve.force_N[lag:] - curve.force_N[:-lag]) for lag in (1, 2))
    if one == 0.0:
        return Noise(0.0, 0.0)
    ar1 = float(np.clip(two / one - 1.0, -0.9, 0.95))
    return Noise(float(np.sqrt(one / (2.0 * (1.0 - ar1)))), ar1)


def _variance(differences: Array) -> float:
    """Of what is left when the signal's own slope is taken away; ramps' ends and jumps do not count."""
    left = differences - uniform_filter1d(differences, WINDOW, mode="nearest")
    return float(median_abs_deviation(left, scale="normal") ** 2 * WINDOW / (WINDOW - 1))
