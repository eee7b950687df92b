"""The noise of measured curves, from the curves alone: no model is asked.

Every phase of a curve (a ramp, a hold) gets a smooth course of its own: a cubic spline, of the time on ramps and of its
logarithm in holds, where relaxation is fast at first and slow later. What is left is taken for first-order
autoregressive noise, whose level and correlation are those of the largest restricted likelihood (Patterson and Thompson
1971, Biometrika 58): it accounts for what the splines have taken away, which matters where noise is correlated over
many points or a phase has few.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

from tasks.model import Curve
from tasks.model.phases import Phase, phases
from tasks.simulate import Array

POINTS, MOST = 6, 12  # points for each coefficient of a spline, and how many coefficients a hold may have
LONG = 400  # points of a ramp for which it may have one more
FEWEST = 12  # points of a phase that can tell
ENOUGH = 150  # points in holds
CORRELATIONS = (-0.5, 0.995)
GROWTH = (0.03, 300.0)  # of the level, up to the largest force
CLEARLY = 10.0  # for each specimen: gain in twice the log likelihood from which on growth is believed


@dataclass(frozen=True)
class Noise:
    """Standard deviation ``sd_N`` at rest (N), and ``proportional`` to the force; correlation of neighbouring points.

    NaN where the curves have too few points to tell.
    """

    sd_N: float
    ar1: float
    proportional: float = 0.0

    @property
    def inflation(self) -> float:
        """How many correlated points weigh as much as one that is independent."""
        return (1.0 + self.ar1) / (1.0 - self.ar1)

    def sd_at(self, force_N: Array) -> Array:
        """Standard deviation (N) at forces ``[t]`` (N)."""
        return np.hypot(self.sd_N, self.proportional * force_N)


@dataclass(frozen=True, eq=False)
class _Piece:
    """A phase: forces ``[t]`` (N), splines ``[t, p]``, a first look at the course ``[t]``, time steps in usual ones."""

    hold: bool
    force: Array
    splines: Array
    course: Array
    steps: Array


def noise_of(curve: Curve, beside: Sequence[Curve] = ()) -> Noise:
    """Noise of one curve, the same at every force.

    Where it has fewer than ``ENOUGH`` points in holds, the noise that the curves ``beside`` it (those of its specimen,
    itself among them) have in common: cycles of few points each are no smooth course, and look like noise.
    """
    alone = not beside or _points_in_holds(_pieces(curve)) >= ENOUGH
    return noise_of_all([curve] if alone else beside, proportional=False)


def noise_of_all(curves: Sequence[Curve], *, proportional: bool = True) -> Noise:
    """The noise that curves have in common; ``proportional``: it may grow with the force.

    Where there are ``ENOUGH`` points in holds, ramps are left out: few points to a sharp toe are no smooth course.
    """
    pieces = _chosen(curves)
    if sum(piece.force.size - piece.splines.shape[1] for piece in pieces) < FEWEST:
        return Noise(float("nan"), float("nan"))
    if all(np.ptp(piece.force - piece.course) == 0.0 for piece in pieces):
        return Noise(0.0, 0.0)
    r, (growth,) = _correlation_and_growth([pieces], proportional)
    _, sd = _restricted(pieces, r, growth)
    return Noise(sd, r, sd * growth)


def noise_of_each(groups: Sequence[Sequence[Curve]]) -> list[Noise]:
    """The noise of several specimens from one machine: a level for each, and one correlation.

    Each has its own growth with the force, where growth is clearly seen in all of them together.
    """
    pieces = [_chosen(curves) for curves in groups]
    if any(sum(p.force.size - p.splines.shape[1] for p in each) < FEWEST for each in pieces):
        return [noise_of_all(curves, proportional=False) for curves in groups]
    r, growths = _correlation_and_growth(pieces, proportional=True)
    levels = [_restricted(each, r, growth)[1] for each, growth in zip(pieces, growths, strict=True)]
    return [Noise(sd, r, sd * growth) for sd, growth in zip(levels, growths, strict=True)]


def _correlation_and_growth(groups: Sequence[list[_Piece]], proportional: bool) -> tuple[float, list[float]]:
    """One correlation for groups of phases, and each group's growth in levels per newton (0 where it is not seen)."""

    def correlation(growths: Sequence[float]) -> float:
        def loss(r: float) -> float:
            return sum(_restricted(each, r, growth)[0] for each, growth in zip(groups, growths, strict=True))

        return float(minimize_scalar(loss, bounds=CORRELATIONS, method="bounded").x)

    none = [0.0] * len(groups)
    r = correlation(none)
    if not proportional:
        return r, none
    growths, gain = [], 0.0
    for each in groups:
        largest = max(float(np.abs(piece.course).max()) for piece in each) or 1.0

        def loss(log: float, pieces: list[_Piece] = each, largest: float = largest) -> float:
            return _restricted(pieces, r, float(np.exp(log)) / largest)[0]

        grown = minimize_scalar(loss, bounds=(np.log(GROWTH[0]), np.log(GROWTH[1])), method="bounded")
        growths.append(float(np.exp(grown.x)) / largest)
        gain += _restricted(each, r, 0.0)[0] - float(grown.fun)
    return (correlation(growths), growths) if gain > CLEARLY * len(groups) else (r, none)


def _chosen(curves: Sequence[Curve]) -> list[_Piece]:
    pieces = [piece for curve in curves for piece in _pieces(curve)]
    return [piece for piece in pieces if piece.hold] if _points_in_holds(pieces) >= ENOUGH else pieces


def _points_in_holds(pieces: Sequence[_Piece]) -> int:
    return sum(piece.force.size for piece in pieces if piece.hold)


def _restricted(pieces: Sequence[_Piece], r: float, growth: float) -> tuple[float, float]:
    """-2 log restricted likelihood, up to a constant, at its best level, and that level (N)."""
    squares, loss, count = 0.0, 0.0, 0
    for piece in pieces:
        sd = np.hypot(1.0, growth * piece.course)
        both = np.column_stack([piece.splines, piece.force]) / sd[:, np.newaxis]
        correlation = np.sign(r) * np.abs(r) ** piece.steps
        alone = 1.0 - correlation**2
        both[1:] = (both[1:] - correlation[:, np.newaxis] * both[:-1]) / np.sqrt(alone)[:, np.newaxis]
        upper: Array = np.asarray(np.linalg.qr(both, mode="r"))
        size = piece.splines.shape[1]
        squares += float(np.sum(upper[size:, size] ** 2))
        loss += float(np.log(alone).sum()) + 2.0 * float(np.log(sd).sum())
        loss += 2.0 * float(np.log(np.abs(np.diag(upper[:size, :size]))).sum())
        count += piece.force.size - size
    variance = max(squares / count, np.finfo(float).tiny)
    return loss + count * float(np.log(variance)), float(np.sqrt(variance))


def _pieces(curve: Curve) -> list[_Piece]:
    usual = float(np.median(np.diff(curve.protocol.time_s)))
    found = []
    for phase in phases(curve.protocol):
        force, time = curve.force_N[phase.points], curve.protocol.time_s[phase.points]
        if force.size < FEWEST:
            continue
        splines = _splines(phase, time - time[0], usual)
        fitted, *_ = np.linalg.lstsq(splines, force, rcond=None)
        found.append(_Piece(phase.kind == "hold", force, splines, splines @ fitted, np.diff(time) / usual))
    return found


def _splines(phase: Phase, since: Array, usual: float) -> Array:
    """Cubic B-splines ``[t, p]``."""
    hold = phase.kind == "hold"
    x = np.log1p(since / usual) if hold else since
    count = int(np.clip(since.size // POINTS, 4, MOST if hold else MOST + since.size // LONG))
    inner = np.linspace(0.0, x[-1], count - 2)
    knots = np.concatenate([np.zeros(3), inner, np.full(3, x[-1])])
    matrix: Array = BSpline.design_matrix(x, knots, 3).toarray()
    return matrix[:, np.abs(matrix).max(axis=0) > 1e-9]
