"""Cells of a test in which model and measurement can disagree, and how large a disagreement is by chance.

A cell is a part of one curve: the toe, ramp or peak of a loading, the early, middle or late part of a hold, an
unloading, or the valley after it, each with the number of its step or cycle. Its misfit is the sum of the whitened
residuals in it over the root of their number: about standard normal where the model is true, and a little less because
parameters were fitted to the same points. What the fit takes away is taken from the simulated noise, too: residuals of
a fit are the noise without its projection on the derivatives (the parametric bootstrap with refit, linearised at the
fit). The largest misfit over all cells of that noise gives the limit that is crossed by chance in one of twenty tests
of a whole cohort (Westfall and Young 1993, max T).
"""

from dataclasses import dataclass

import numpy as np

from tasks.model import Curve
from tasks.model.phases import Phase, phases
from tasks.simulate import Array

TOE, PEAK = 0.3, 0.1  # parts of the way of a loading: its beginning, and its end
HOLD_PARTS = ("early hold", "middle hold", "late hold")  # thirds of the logarithm of the time
FEWEST = 3  # points of a cell
DRAWS = 20_000


@dataclass(frozen=True, eq=False)
class Cell:
    """Points of a curve (numbers ``[k]``)."""

    protocol: str
    phase: str
    number: int
    points: Array

    @property
    def name(self) -> str:
        return f"{self.protocol}: {self.phase} {self.number}"


def cells(curve: Curve) -> list[Cell]:
    """All cells of a curve that have enough points, in order of time. No point is in two of them."""
    found = []
    taken = 0
    for phase in phases(curve.protocol):
        begin = max(phase.start, taken)  # the corner belongs to the phase before it
        taken = phase.stop
        points = np.arange(begin, phase.stop)
        for name, part in _parts(phase, curve, points):
            if part.size >= FEWEST:
                found.append(Cell(curve.name, name, phase.number, part))
    return found


def _parts(phase: Phase, curve: Curve, points: Array) -> list[tuple[str, Array]]:
    if not points.size:
        return []
    time, moved = curve.protocol.time_s[points], curve.protocol.displacement_mm[points]
    if phase.kind == "hold":
        since = np.log1p((time - time[0]) / max(float(np.median(np.diff(curve.protocol.time_s))), 1e-12))
        third = np.minimum((3 * since / max(since[-1], 1e-12)).astype(int), 2)
        return [(name, points[third == i]) for i, name in enumerate(HOLD_PARTS)]
    way = np.abs(moved - moved[0]) / max(float(np.abs(moved[-1] - moved[0])), 1e-12)
    if phase.kind == "load":
        middle = (way >= TOE) & (way < 1 - PEAK)
        return [("toe", points[way < TOE]), ("ramp", points[middle]), ("peak", points[way >= 1 - PEAK])]
    return [("unload", points[way < 1 - TOE]), ("valley", points[way >= 1 - TOE])]


def misfits(inside: Array, errors: Array) -> Array:
    """Misfit ``[c]`` of cells, from whitened residuals ``errors`` ``[t]``; ``inside`` ``[c, t]``: where they are."""
    found: Array = (inside @ errors) / np.sqrt(inside.sum(axis=1))
    return found


def limit_by_chance(inside: Array, derivatives: Array, chance: float, rng: np.random.Generator) -> float:
    """What the largest of all misfits exceeds with the probability ``chance`` when the model is true.

    ``derivatives`` ``[t, k]`` are those of the whitened residuals at the fit.
    """
    basis, _ = np.linalg.qr(derivatives)
    # noise enters by its sums over cells and along the basis only, which are few, however many points there are
    shares = inside / np.sqrt(inside.sum(axis=1))[:, np.newaxis]
    left = shares - (shares @ basis) @ basis.T
    root = np.linalg.cholesky(left @ left.T + 1e-9 * np.eye(len(left)))
    largest = np.abs(root @ rng.standard_normal((len(left), DRAWS))).max(axis=0)
    return float(np.quantile(largest, 1.0 - chance))
