"""Cells of a test in which model and measurement can disagree, and how large a disagreement is by chance.

A cell is a part of one curve, or of another quantity along it: the toe, ramp or peak of a loading, the early, middle or
late part of a hold, an unloading, or the valley after it, each with the number of its step or cycle. Its misfit is the
sum of the whitened residuals in it over the root of their number: about standard normal where the model is true, and a
little less because parameters were fitted to the same points. What the fit takes away is taken from the simulated
noise, too: residuals of a fit are the noise without its projection on the derivatives (the parametric bootstrap with
refit, linearised at the fit). The largest misfit over all cells of that noise gives the limit that is crossed by chance
in one of twenty tests of a whole cohort (Westfall and Young 1993, max T).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import Fitted, derivatives, errors
from sinew.tasks.discover.misfit_map import CellMisfit
from sinew.tasks.discover.result import InPlace
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import FORCE, Curve
from sinew.tasks.model.phases import Phase, phases
from sinew.tasks.simulate import Array

TOE, PEAK = 0.3, 0.1  # fractions of a loading: its beginning, and its end
HOLD_PARTS = ("early hold", "middle hold", "late hold")  # thirds of the logarithm of the time
MIN_POINTS = 3  # of a cell
DRAWS = 20_000
AT_ONCE = 20_000_000  # numbers: of many cells, not all draws are in memory together


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
    cells = []
    taken = 0
    for phase in phases(curve.protocol):
        begin = max(phase.start, taken)  # the corner belongs to the phase before it
        taken = phase.stop
        points = np.arange(begin, phase.stop)
        for name, part in _parts(phase, curve, points):
            if part.size >= MIN_POINTS:
                cells.append(Cell(curve.name, name, phase.number, part))
    return cells


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


def misfits(inside: csr_array, errors: Array) -> Array:
    """Misfit ``[c]`` of cells, from whitened residuals ``errors`` ``[t]``; ``inside`` ``[c, t]``: where they are."""
    z: Array = (inside @ errors) / np.sqrt(inside.sum(axis=1))
    return z


def limits_by_chance(
    inside: csr_array, derivatives: Array, chances: Sequence[float], rng: np.random.Generator
) -> list[float]:
    """The limits that the largest of all misfits exceeds with probabilities ``chances`` if the model is true.

    ``derivatives`` ``[t, k]`` are those of the whitened residuals at the fit. No point is in two cells.
    """
    basis, _ = np.linalg.qr(derivatives)
    # only the sums of the noise over cells and along the basis matter; they are few, however many points there are
    along = (inside @ basis) / np.sqrt(inside.sum(axis=1))[:, np.newaxis]
    root = np.linalg.cholesky((1.0 + 1e-9) * np.eye(len(along)) - along @ along.T)
    each = max(AT_ONCE // len(along), 1)
    parts = (rng.standard_normal((len(along), min(each, DRAWS - begun))) for begun in range(0, DRAWS, each))
    largest = np.concatenate([np.abs(root @ part).max(axis=0) for part in parts])
    return [float(np.quantile(largest, 1.0 - chance)) for chance in chances]


def misfit_map(
    measured: Measured, candidate: Candidate, fitted: Fitted, chance: float, far: float, seed: tuple[int, ...]
) -> tuple[CellMisfit, ...]:
    """The misfit in every cell of a specimen, in the unit of its quantity and in units of chance.

    ``limit`` is crossed by chance in some cell with the probability ``chance``, ``sure`` with ``far`` times that.
    """
    every: list[tuple[Cell, str]] = []
    inside: list[Array] = []  # numbers of the errors in each cell
    means: list[float] = []
    white, slopes = derivatives(candidate, measured, fitted.at, measured.curves, errors)
    first = 0
    for curve in measured.curves:
        courses = candidate.courses(measured.specimen, curve.protocol, fitted.at[np.newaxis])
        parts = cells(curve)
        for quantity, rows in measured.rows(curve).items():
            values = curve.force_N if quantity == FORCE else curve.others[quantity]
            for cell in parts:
                points = np.flatnonzero(np.isin(rows, cell.points, assume_unique=True))
                if points.size >= MIN_POINTS:
                    every.append((cell, quantity))
                    inside.append(first + points)
                    means.append(float((values - courses[quantity][0])[rows[points]].mean()))
            first += rows.size
    which = csr_array(
        (np.ones(sum(map(len, inside))), np.concatenate(inside), np.cumsum([0, *map(len, inside)])),
        shape=(len(inside), white.size),
    )
    z = -misfits(which, white)  # measured minus simulated
    limit, sure = limits_by_chance(which, slopes, [chance, far * chance], np.random.default_rng(seed))
    return tuple(
        CellMisfit(cell.protocol, cell.phase, cell.number, float(z[c]), *_mean(means[c], quantity, limit, sure))
        for c, (cell, quantity) in enumerate(every)
    )


def _mean(
    mean: float, quantity: str, limit: float, sure: float
) -> tuple[float, float, float, str | None, float | None]:
    """The last fields of a :class:`CellMisfit`."""
    return (mean, limit, sure, None, None) if quantity == FORCE else (float("nan"), limit, sure, quantity, mean)


def located_part(before: Sequence[Sequence[CellMisfit]], after: Sequence[Sequence[CellMisfit]]) -> InPlace | None:
    """The fraction of the improvement in cells that were beyond chance before, and the fraction of such cells.

    None where there was none.
    """
    gains = [
        (b.z**2 - a.z**2, b.beyond_chance)
        for old, new in zip(before, after, strict=True)
        for b, a in zip(old, new, strict=True)
    ]
    share = sum(located for _, located in gains) / len(gains)
    if not share:
        return None
    better = sum(gain for gain, _ in gains if gain > 0)
    part = sum(gain for gain, located in gains if located and gain > 0) / better if better else 0.0
    return InPlace(float(part), float(share))
