"""Noise of simulated measurements: ABC compares like with like only if simulations are noisy as measurements are.

The store keeps the size of a curve's error, not the error itself, which is all that is needed: if r is the simulated
less the measured force at n points, and e the noise, |r + e|^2 = |r|^2 + 2 r e + |e|^2. The noise has the standard
deviation s and the autocorrelation a. |e|^2 has mean n s^2 and variance 2 k n s^4 with k = (1 + a^2) / (1 - a^2). r e
is normal; its variance is k s^2 |r|^2 for the part of r that is the noise of the measured curve, at most n s^2 of
|r|^2, and c s^2 |r|^2 with c = (1 + a) / (1 - a) for the rest, which is smooth.
"""

from dataclasses import dataclass

import numpy as np

from sinew.tasks.data.noise import Noise, noise_of
from sinew.tasks.infer.abc.observations import SiteEvaluation, root_mean_square
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class CurveNoise:
    """The noise of ``c`` curves of ``points`` ``[c]``, of a ``size`` ``[c]`` relative to the curve's root mean square.

    ``smooth`` and ``rough`` ``[c]``: the factors c and k of the module's description.
    """

    size: Array
    points: Array
    smooth: Array
    rough: Array

    def relative_errors(self, errors: Array) -> Array:
        """Relative errors ``[c]`` of noisy simulations, from those of simulations without noise.

        Drawn from numpy's global generator, as all that pyABC draws.
        """
        along, own = np.random.standard_normal((2, errors.size))
        noisy = np.minimum(errors**2, self.size**2)  # of the measured curve itself, which the error holds
        factor = self.smooth * (errors**2 - noisy) + self.rough * noisy
        cross = 2.0 * self.size * np.sqrt(factor / self.points) * along
        squares = self.size**2 * np.maximum(1.0 + np.sqrt(2.0 * self.rough / self.points) * own, 0.0)
        return np.asarray(np.sqrt(np.maximum(errors**2 + cross + squares, 0.0)))


def noise_of_site(evaluation: SiteEvaluation) -> CurveNoise:
    """The noise of all relative errors of an evaluation, as the curves themselves show it.

    That of what was measured beside the forces has one level for all curves of a specimen, and no correlation.
    """
    forces = [(curve, noise_of(curve, one.curves)) for one, curve in evaluation.curves()]
    others = []
    for one, curve, name in evaluation.others():
        there = np.isfinite(curve.others[name])
        time_s, moved = curve.protocol.time_s[there], curve.protocol.displacement_mm[there]
        measured = Curve(Protocol(name, time_s, moved), curve.others[name][there])
        others.append((measured, Noise(one.noise[name], 0.0)))
    return noise_of_curves(forces + others)


def noise_of_curves(curves: list[tuple[Curve, Noise]]) -> CurveNoise:
    """What the noise of each curve does to its relative error: nothing where it is unknown (NaN)."""
    a = np.nan_to_num([noise.ar1 for _, noise in curves])
    sizes = [np.sqrt(np.mean(noise.sd_at(one.force_N) ** 2)) / root_mean_square(one.force_N) for one, noise in curves]
    return CurveNoise(
        size=np.nan_to_num(sizes),
        points=np.array([one.force_N.size for one, _ in curves], dtype=float),
        smooth=(1.0 + a) / (1.0 - a),
        rough=(1.0 + a**2) / (1.0 - a**2),
    )
