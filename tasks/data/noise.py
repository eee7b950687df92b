"""The noise of measured curves, estimated from the curves alone, without a model of the tissue.

In each phase of a curve (a ramp or a hold), a cubic spline follows the smooth course of the force. On ramps it is a
function of time, in holds of the logarithm of time, because relaxation is fast at first and slow later. The remainder,
but for spikes, is taken for first-order autoregressive noise. Its level and correlation maximise the restricted
likelihood (Patterson and Thompson 1971, Biometrika 58), which accounts for what the splines remove. That matters where
noise is correlated over many points or a phase has few of them. What follows a break is left out: no spline follows it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import sparse

from sinew.runner.errors import BadInput
from sinew.tasks.data.breaks import break_of
from sinew.tasks.drawing.blocks import listed
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.phases import Phase, phases
from sinew.tasks.simulate import Array

POINTS_PER_COEFFICIENT = 6  # of a spline
MOST_COEFFICIENTS = 12  # of a hold; ramps may have one more for every POINTS_PER_EXTRA points
POINTS_PER_EXTRA = 400
FEWEST_POINTS = 12  # of a phase that is used, and of the remainder that noise is estimated from
NOTHING = 1e-100  # N: squares of errors in units of less are no numbers
ENOUGH_IN_HOLDS = 150  # points; ramps are left out then
CORRELATION_BOUNDS = (-0.5, 0.995)
SUSPECT = 0.9  # correlation from which on finer splines are tried
FINER = (2, 4, 8, 16)  # times as many coefficients, as far as the points allow
MOST_SPLINES = 400  # coefficients of a phase: their normal equations are solved dozens of times
DEPENDENT = 1e-6  # what a spline adds to the others, squared and relative to the largest, where points do not tell it
SPIKE = 6.0  # standard deviations from the course of its phase, from which on a point is a spike
MOST_SPIKES = 0.05  # of the points of a phase
SPIKE_ROUNDS = 20
GROWTH_BOUNDS = (0.03, 300.0)  # growth of the noise up to the largest force, as a multiple of its level at rest
GROWTH_GAIN = 10.0  # gain in twice the log likelihood, for each specimen, from which on growth is accepted


@dataclass(frozen=True)
class Noise:
    """Standard deviation ``sd_N`` at rest (N), correlation ``ar1`` of neighbouring points, and growth with the force.

    ``proportional``: standard deviation per newton of force, added in quadrature. NaN where the curves have too few
    points. ``of_others``: it is that of other specimens for this reason.
    """

    sd_N: float
    ar1: float
    proportional: float = 0.0
    of_others: bool = False

    @property
    def inflation(self) -> float:
        """How many correlated points carry as much information as one independent point."""
        return (1.0 + self.ar1) / (1.0 - self.ar1)

    def sd_at(self, force_N: Array) -> Array:
        """Standard deviation (N) at forces ``[t]`` (N)."""
        return np.hypot(self.sd_N, self.proportional * force_N)


@dataclass(frozen=True, eq=False)
class _Piece:
    """A phase of a curve with ``t`` points.

    ``force`` ``[t]`` (N), ``splines`` ``[t, p]``: the basis, ``course`` ``[t]`` (N): the fit by ordinary least squares,
    ``time`` ``[t]``: in multiples of the curve's median step.
    """

    hold: bool
    force: Array
    splines: sparse.csr_array
    course: Array
    time: Array


def refuse_none(noise: Noise, where: Path) -> None:
    """Raises :class:`BadInput` for curves in which no noise can be seen: misfit is told in times of it."""
    if not noise.sd_N > NOTHING:
        expected = (
            "measured curves" if noise.sd_N <= NOTHING else "curves of more points, of this specimen or another one"
        )
        raise BadInput(where, "no noise can be seen in its curves", expected)


def noise_of(curve: Curve, beside: Sequence[Curve] = ()) -> Noise:
    """The noise of one curve, of one level at every force.

    ``beside``: all curves of its specimen, itself included. If the curve has fewer than ``ENOUGH_IN_HOLDS`` points in
    holds, the noise is that of these curves together: cycles of few points have no smooth course, and look like noise.
    """
    alone = not beside or _points_in_holds(_pieces(_until_break(curve))) >= ENOUGH_IN_HOLDS
    return noise_of_all([curve] if alone else beside, proportional=False)


def noise_of_all(curves: Sequence[Curve], *, proportional: bool = True) -> Noise:
    """The noise that curves have in common. ``proportional``: it may grow with the force.

    If holds have ``ENOUGH_IN_HOLDS`` points, ramps are left out: a sharp toe of few points has no smooth course.
    """
    pieces = _chosen(curves)
    if _too_few(pieces):
        return Noise(float("nan"), float("nan"))
    if _smooth(pieces):
        return Noise(0.0, 0.0)
    r, (growth,) = _correlation_and_growth([pieces], proportional)
    _, sd = _restricted(pieces, r, growth)
    return Noise(sd, r, sd * growth)


def noise_of_each(groups: Sequence[Sequence[Curve]]) -> list[Noise]:
    """The noise of several specimens measured by one machine: one correlation, and a level for each specimen.

    Each specimen has its own growth with the force if growth improves the likelihood of all together by
    ``GROWTH_GAIN`` for each. Specimens of too few points get the median of the others; NaN where no specimen has
    enough.
    """
    pieces = {number: _chosen(curves) for number, curves in enumerate(groups)}
    enough = {number: each for number, each in pieces.items() if not _too_few(each)}
    rough = {number: each for number, each in enough.items() if not _smooth(each)}
    r, growths = _correlation_and_growth(list(rough.values()), proportional=True) if rough else (0.0, [])
    levels = [_restricted(each, r, growth)[1] for each, growth in zip(rough.values(), growths, strict=True)]
    found = {number: Noise(sd, r, sd * growth) for number, sd, growth in zip(rough, levels, growths, strict=True)}
    found = {number: found.get(number, Noise(0.0, 0.0)) for number in enough}
    others = [found[number] for number in rough] or [Noise(float("nan"), float("nan"))]
    sd, r, growth = np.median([(one.sd_N, one.ar1, one.proportional) for one in others], axis=0).tolist()
    usual = Noise(sd, r, growth, of_others=True)
    return [found.get(number, usual) for number in pieces]


def correlation_of(groups: Sequence[Sequence[Curve]]) -> float:
    """The correlation of neighbouring points that the noise of all groups of curves has in common.

    0 where no group has enough points to show one.
    """
    pieces = [each for curves in groups if not _too_few(each := _chosen(curves)) and not _smooth(each)]
    return _correlation_and_growth(pieces, proportional=False)[0] if pieces else 0.0


def remark_on_others(specimens: Sequence[Specimen], noise: Sequence[Noise]) -> str:
    """A line on the specimens whose ``noise`` is that of others; empty where there are none."""
    names = [one.name for one, level in zip(specimens, noise, strict=True) if level.of_others]
    return f"too few points to estimate the noise of {listed(names)}; the median of the others is used" if names else ""


def _too_few(pieces: Sequence[_Piece]) -> bool:
    return sum(piece.force.size - piece.splines.shape[1] for piece in pieces) < FEWEST_POINTS


def _smooth(pieces: Sequence[_Piece]) -> bool:
    """Whether nothing is left beside the courses, as of a force that is 0 throughout."""
    return all(np.ptp(piece.force - piece.course) == 0.0 for piece in pieces)


def _correlation_and_growth(groups: Sequence[list[_Piece]], proportional: bool) -> tuple[float, list[float]]:
    """One correlation for all groups of phases, and the growth of each group in levels per newton (0: none)."""
    from scipy.optimize import minimize_scalar  # slow to import

    def correlation(growths: Sequence[float]) -> float:
        def loss(r: float) -> float:
            return sum(_restricted(each, r, growth)[0] for each, growth in zip(groups, growths, strict=True))

        return float(minimize_scalar(loss, bounds=CORRELATION_BOUNDS, method="bounded").x)

    none = [0.0] * len(groups)
    r = correlation(none)
    if not proportional:
        return r, none
    growths, gain = [], 0.0
    for each in groups:
        largest = max(float(np.abs(piece.course).max()) for piece in each) or 1.0

        def loss(log: float, pieces: list[_Piece] = each, largest: float = largest) -> float:
            return _restricted(pieces, r, float(np.exp(log)) / largest)[0]

        grown = minimize_scalar(loss, bounds=(np.log(GROWTH_BOUNDS[0]), np.log(GROWTH_BOUNDS[1])), method="bounded")
        growths.append(float(np.exp(grown.x)) / largest)
        gain += _restricted(each, r, 0.0)[0] - float(grown.fun)
    return (correlation(growths), growths) if gain > GROWTH_GAIN * len(groups) else (r, none)


def _chosen(curves: Sequence[Curve]) -> list[_Piece]:
    """The phases that noise is estimated from, without spikes: holds if they have enough points, else all.

    A course that the splines cannot follow, such as one with a rupture, looks like large noise of a correlation near
    1. Then the splines become finer as long as Schwarz's criterion (1978) gains, on the points that both keep.
    """
    curves = list(map(_until_break, curves))
    coarse = _used(curves, 1)
    kept = [_without_spikes(piece) for piece in coarse]
    for finer in FINER:
        if _criterion(coarse, kept)[1] < SUSPECT:
            break
        fine = _used(curves, finer)
        kept_by_fine = [_without_spikes(piece) for piece in fine]
        both = [a & b for a, b in zip(kept, kept_by_fine, strict=True)]
        if not _criterion(fine, both)[0] < _criterion(coarse, both)[0]:
            break
        coarse, kept = fine, kept_by_fine
    return _some_points(coarse, kept)


def _until_break(curve: Curve) -> Curve:
    """The curve without the forces that follow a break."""
    broken = break_of(curve)
    if broken is None:
        return curve
    rows = np.arange(curve.force_N.size)
    return replace(curve, force_N=np.where(rows > broken[0], np.nan, curve.force_N))


def _used(curves: Sequence[Curve], finer: int) -> list[_Piece]:
    pieces = [piece for curve in curves for piece in _pieces(curve, finer)]
    return [piece for piece in pieces if piece.hold] if _points_in_holds(pieces) >= ENOUGH_IN_HOLDS else pieces


def _criterion(pieces: Sequence[_Piece], kept: Sequence[Array]) -> tuple[float, float]:
    """Schwarz's criterion of the splines together with noise of one correlation, and that correlation.

    ``kept``: which points of each phase count. Infinite, and no correlation, where there are too few.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    chosen = _some_points(pieces, kept)
    points, splines = (sum(piece.splines.shape[axis] for piece in chosen) for axis in (0, 1))
    if points - splines < FEWEST_POINTS:
        return float("inf"), 0.0
    best = minimize_scalar(lambda r: _full(chosen, r), bounds=CORRELATION_BOUNDS, method="bounded")
    return float(best.fun) + splines * float(np.log(points)), float(best.x)


def _some_points(pieces: Sequence[_Piece], kept: Sequence[Array]) -> list[_Piece]:
    return [
        piece if each.all() else _piece(piece.hold, piece.force[each], piece.splines[each], piece.time[each])
        for piece, each in zip(pieces, kept, strict=True)
    ]


def _points_in_holds(pieces: Sequence[_Piece]) -> int:
    return sum(piece.force.size for piece in pieces if piece.hold)


def _restricted(pieces: Sequence[_Piece], r: float, growth: float) -> tuple[float, float]:
    """-2 log restricted likelihood (up to a constant) at the level that maximises it, and that level (N)."""
    squares, loss, splines, count = _parts(pieces, r, growth)
    count -= sum(piece.splines.shape[1] for piece in pieces)
    variance = max(squares / count, np.finfo(float).tiny)
    return loss + splines + count * float(np.log(variance)), float(np.sqrt(variance))


def _full(pieces: Sequence[_Piece], r: float) -> float:
    """-2 log likelihood (up to a constant) at the splines and the level that maximise it."""
    squares, loss, _, count = _parts(pieces, r, 0.0)
    return loss + count * float(np.log(max(squares / count, np.finfo(float).tiny)))


def _parts(pieces: Sequence[_Piece], r: float, growth: float) -> tuple[float, float, float, int]:
    """The squares of what the splines leave, log determinants of the noise and of the splines, and the points."""
    squares, noise, splines, points = 0.0, 0.0, 0.0, 0
    for piece in pieces:
        sd = np.hypot(1.0, growth * piece.course)
        correlation = np.sign(r) * np.abs(r) ** np.diff(piece.time)
        alone = 1.0 - correlation**2
        whitening = sparse.diags_array(
            [np.concatenate([[1.0], 1.0 / np.sqrt(alone)]) / sd, -correlation / np.sqrt(alone) / sd[:-1]],
            offsets=[0, -1],
            format="csr",
        )
        left, log = _fitted(whitening @ piece.splines, whitening @ (piece.force - piece.course))
        squares += float(left @ left)
        splines += log
        noise += float(np.log(alone).sum()) + 2.0 * float(np.log(sd).sum())
        points += piece.force.size
    return squares, noise, splines, points


def _fitted(splines: sparse.csr_array, force: Array) -> tuple[Array, float]:
    """What least squares leave ``[t]``, and the log determinant of the normal equations."""
    from scipy.linalg import cho_factor, cho_solve  # slow to import

    factor = cho_factor((splines.T @ splines).toarray(), lower=True)
    left = force - splines @ cho_solve(factor, splines.T @ force)
    return left, 2.0 * float(np.log(np.diag(factor[0])).sum())


def _pieces(curve: Curve, finer: int = 1) -> list[_Piece]:
    """The phases of a curve that have enough points. ``finer``: how many times as many splines as usual."""
    there = np.isfinite(curve.force_N)  # other quantities than the force may have gaps
    if there.sum() < FEWEST_POINTS:
        return []
    median_step = float(np.median(np.diff(curve.protocol.time_s[there])))
    found = []
    for phase in phases(curve.protocol):
        measured = there[phase.points]
        force, time = curve.force_N[phase.points][measured], curve.protocol.time_s[phase.points][measured]
        if force.size < FEWEST_POINTS:
            continue
        splines = _splines(phase, time - time[0], median_step, finer)
        found.append(_piece(phase.kind == "hold", force, splines, time / median_step))
    return found


def _piece(hold: bool, force: Array, splines: sparse.csr_array, time: Array) -> _Piece:
    """A phase with those of the splines that its points tell apart."""
    from scipy.linalg import qr  # slow to import

    upper, order = qr((splines.T @ splines).toarray(), mode="r", pivoting=True)
    size = np.abs(np.diag(upper))
    splines = splines[:, np.sort(order[size > DEPENDENT * size[0]])]
    return _Piece(hold, force, splines, force - _fitted(splines, force)[0], time)


def _without_spikes(piece: _Piece) -> Array:
    """Which points ``[t]`` of a phase are not far off its course, by more than any noise explains.

    A machine that starts, stops or turns jerks for some points, and a turn has a corner that no smooth course has.
    At most ``MOST_SPIKES`` of the points are left out; the scale is the median absolute deviation of the others.
    """
    from scipy.linalg import solve  # slow to import

    kept = np.ones(piece.force.size, bool)
    for _ in range(SPIKE_ROUNDS):
        chosen = piece.splines[kept]
        normal = (chosen.T @ chosen).toarray()
        normal[np.diag_indices_from(normal)] += DEPENDENT * normal.max()  # where no point is left below a spline
        off = np.abs(piece.force - piece.splines @ solve(normal, chosen.T @ piece.force[kept], assume_a="pos"))
        limit = max(SPIKE * 1.4826 * float(np.median(off[kept])), float(np.quantile(off, 1.0 - MOST_SPIKES)))
        if np.array_equal(off <= limit, kept):
            break
        kept = off <= limit
    return kept


def _splines(phase: Phase, since: Array, median_step: float, finer: int) -> sparse.csr_array:
    """Cubic B-splines ``[t, p]`` at the times ``since`` (s) the phase began."""
    from scipy.interpolate import BSpline  # slow to import

    hold = phase.kind == "hold"
    x = np.log1p(since / median_step) if hold else since
    usual = MOST_COEFFICIENTS + (0 if hold else since.size // POINTS_PER_EXTRA)
    most = min(finer * usual, MOST_SPLINES)
    count = int(np.clip(since.size // POINTS_PER_COEFFICIENT, 4, most))
    inner = np.linspace(0.0, x[-1], count - 2)
    knots = np.concatenate([np.zeros(3), inner, np.full(3, x[-1])])
    return sparse.csr_array(BSpline.design_matrix(x, knots, 3))
