"""Can the ranges of a model reach the measured forces, and which parameters do the tests see at all?

Both are answered by a few hundred runs of the embedded simulator along thinned curves, before any work is paid for.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sinew.tasks.model import Curve, Model, Parameter, Protocol, Specimen
from sinew.tasks.model.parameters import scaled
from sinew.tasks.model.phases import phases
from sinew.tasks.simulate import Array, Simulator

POINTS = 2_000  # of a curve, at most
ROWS = 128  # spread over the ranges, besides their corners; a power of two
BASES = 8  # rows around which each parameter is varied alone
LOADS = 0.01  # of the largest simulated force of a specimen: a test with less is at rest
FACTOR = 2.0  # between the measured force and the nearest simulated one, from which on it is out of reach
UNSEEN = 1e-3  # of the largest force: a parameter that changes the force by less over its whole range is not seen


@dataclass(frozen=True)
class Reach:
    """The largest measured force of a curve (N, with its sign), and the forces that the ranges give at that moment.

    ``area_mm2`` makes a nominal stress of them.
    """

    specimen: str
    protocol: str
    measured_N: float
    least_N: float
    most_N: float
    area_mm2: float

    @property
    def largest_N(self) -> float:
        """The largest simulated force in size."""
        return max(abs(self.least_N), abs(self.most_N))

    @property
    def ratios(self) -> tuple[float, float]:
        """The smallest and the largest simulated force over the measured one."""
        low, high = sorted((self.least_N / self.measured_N, self.most_N / self.measured_N))
        return low, high

    @property
    def other_sign(self) -> bool:
        """Whether every simulated force pulls where the measured one pushes, or the other way round."""
        return self.ratios[1] < 0.0

    @property
    def reached(self) -> bool:
        """Whether some simulated force comes within a factor of two of the measured one."""
        low, high = self.ratios
        return high >= 1.0 / FACTOR and low <= FACTOR

    @property
    def possible(self) -> bool:
        """Whether these numbers can come from :func:`reach`; a file may hold others."""
        numbers = (self.measured_N, self.least_N, self.most_N, self.area_mm2)
        return bool(np.isfinite(numbers).all()) and self.measured_N != 0 and self.area_mm2 > 0

    @property
    def at_rest(self) -> bool:
        """Whether no row of the ranges has any force: the test does not move the specimen."""
        return self.largest_N == 0.0

    @property
    def distance(self) -> float:
        """How far the measured force is from the nearest simulated one, as a factor."""
        low, high = self.ratios
        return float("inf") if high <= 0 else max(low, 1.0 / high)

    @property
    def scale(self) -> float:
        """The factor of all moduli that brings the middle of the simulated forces to the measured one."""
        low, high = self.ratios
        return float(1.0 / np.sqrt(max(low, high / 100.0) * high)) if high > 0.0 else 1.0

    @property
    def stresses_MPa(self) -> tuple[float, float, float]:
        """Measured, and the smaller and the larger simulated one in size."""
        near, far = sorted((self.least_N, self.most_N), key=abs)
        return self.measured_N / self.area_mm2, near / self.area_mm2, far / self.area_mm2


def reach(simulator: Simulator, model: Model, specimen: Specimen) -> tuple[Reach, ...]:
    """For each measured curve, what the free parameters of the model can give at the largest measured force.

    Curves that tell nothing are passed over: without any force, without any row that can be simulated, and tests that
    hardly load the specimen where others do.
    """
    rows = spread(model)
    found = []
    for curve in specimen.curves:
        thin = thinned(curve)
        peak, measured = _peak(thin)
        if not curve.measured or measured == 0.0:
            continue
        force = simulator.simulate(model, specimen, thin.protocol, rows).force_N[:, peak]
        force = force[np.isfinite(force)]
        if force.size:
            low, high = float(force.min()), float(force.max())
            found.append(Reach(specimen.name, curve.name, measured, low, high, specimen.area_mm2))
    largest = max((one.largest_N for one in found), default=0.0)
    return tuple(one for one in found if one.largest_N >= LOADS * largest)


def unseen(simulator: Simulator, model: Model, specimens: Sequence[Specimen]) -> tuple[str, ...]:
    """The free parameters that change no force of any test, whatever their value, in the model's order."""
    left = list(model.free)
    bases = np.vstack([model.reference, spread(model)[-BASES:]])
    for specimen in specimens:
        for curve in specimen.curves:
            if not left:
                break
            force = simulator.simulate(model, specimen, thinned(curve).protocol, _varied(model, left, bases)).force_N
            force = force.reshape(len(left), len(bases), 2, -1)
            with np.errstate(invalid="ignore"):
                change = np.abs(force[:, :, 1] - force[:, :, 0]).max(axis=-1)
                largest = np.abs(force).max(axis=(2, 3))
            seen = (change > UNSEEN * largest).any(axis=1)
            left = [parameter for parameter, is_seen in zip(left, seen, strict=True) if not is_seen]
    return tuple(parameter.name for parameter in left)


def _varied(model: Model, parameters: Sequence[Parameter], bases: Array) -> Array:
    """Rows ``[parameters * bases * 2, d]``: each parameter at both ends of its range, the others as in the base."""
    rows = np.tile(bases[np.newaxis, :, np.newaxis], (len(parameters), 1, 2, 1))
    for i, parameter in enumerate(parameters):
        rows[i, :, :, model.names.index(parameter.name)] = (parameter.minimum, parameter.maximum)
    return rows.reshape(-1, bases.shape[1])


def spread(model: Model, count: int = ROWS) -> Array:
    """Rows ``[8 + count, d]``: corners of the ranges (moduli, toe and all others, low or high), then points inside.

    ``count`` is a power of two.
    """
    from scipy.stats.qmc import Sobol  # slow to import

    kinds = np.array([_kind(parameter) for parameter in model.parameters])
    corners = np.array([[bits >> kind & 1 for kind in kinds] for bits in range(8)], dtype=float)
    inside = Sobol(len(kinds), scramble=False).random(count) + 0.5 / count  # its first point is a corner
    nudged = np.clip(corners, 1e-6, 1 - 1e-6)  # an end of a range may be just impossible
    return scaled(model.parameters, np.vstack([nudged, inside]))


def _kind(parameter: Parameter) -> int:
    return 0 if parameter.unit == "MPa" else 1 if parameter.name == "alpha_f" else 2


def thinned(curve: Curve) -> Curve:
    """The curve at some 2,000 points, and at every turn of its displacement; its largest force is among them."""
    time, moved, force = curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N
    if time.size <= POINTS:
        return curve
    turns = [each.start for each in phases(curve.protocol)]
    keep = np.unique([*np.linspace(0, time.size - 1, POINTS).astype(int), *turns, _peak(curve)[0]])
    return Curve(Protocol(curve.name, time[keep], moved[keep]), force[keep])


def _peak(curve: Curve) -> tuple[int, float]:
    """Where the measured force is largest in size, and how large; a single point that stands out does not count."""
    from scipy.ndimage import median_filter  # slow to import

    smooth = median_filter(np.nan_to_num(curve.force_N), 3, mode="nearest")
    at = int(np.abs(smooth).argmax())
    return at, float(smooth[at])
