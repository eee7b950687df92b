"""Smooth curves over the phases of a test: B-splines over strain in loading and unloading, over log time in holds.

What is smooth within phases may grow or fade from one phase to the next: each spline is there twice, as it is and times
the logarithm of the number of the phase.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline

from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve
from sinew.tasks.model.phases import phases
from sinew.tasks.simulate import Array

KINDS = ("load", "unload", "hold")
COEFFICIENTS, DEGREE = 8, 3  # of the spline of each kind of phase


def ranges_of(pieces: Sequence["Piece"]) -> dict[str, "Range | None"]:
    """Where the phases of each kind were; None for a kind that has no extent."""
    return {kind: range_of(pieces, kind) for kind in KINDS}


@dataclass(frozen=True, eq=False)
class Piece:
    """The points ``[t]`` at which fits ask the model for a curve: number in :data:`KINDS`, place, number of the phase.

    ``place``: strain reached (load, unload), or logarithm of the time (s) since the beginning of the hold. ``phase``
    counts all phases of the curve from 0.
    """

    kind: Array
    place: Array
    number: Array
    phase: Array


def piece_of(measured: Measured, curve: Curve) -> Piece:
    time, moved = curve.protocol.time_s, curve.protocol.displacement_mm
    kind, number, phase = (np.zeros(time.size, dtype=int) for _ in range(3))
    place = moved / measured.specimen.length_mm
    usual = float(np.median(np.diff(time)))
    for order, each in enumerate(phases(curve.protocol)):
        begin = each.start if order == 0 else each.start + 1  # the corner belongs to the phase before it
        points = slice(begin, each.stop)
        kind[points], number[points], phase[points] = KINDS.index(each.kind), each.number, order
        if each.kind == "hold":
            place[points] = np.log(np.maximum(time[points] - time[each.start], usual))
    asked = np.searchsorted(time, measured.thinned[curve.name].protocol.time_s)
    return Piece(kind[asked], place[asked], number[asked], phase[asked])


@dataclass(frozen=True, eq=False)
class Range:
    """Where phases of one kind were; ``numbers`` ``[n, 3]``: the number of each, and its own range."""

    low: float
    high: float
    numbers: Array

    def ends(self, x: float) -> tuple[int, int]:
        """The numbers of the first and the last phase that came to ``x``; of all, where none did."""
        there = self.numbers[(self.numbers[:, 1] <= x) & (x <= self.numbers[:, 2]), 0]
        chosen = there if there.size else self.numbers[:, 0]
        return int(chosen.min()), int(chosen.max())


def range_of(pieces: Sequence[Piece], kind: str) -> Range | None:
    extents = []
    for piece in pieces:
        there = piece.kind == KINDS.index(kind)
        for phase in np.unique(piece.phase[there]):
            points = there & (piece.phase == phase)
            place = piece.place[points]
            extents.append((piece.number[points][0], place.min(), place.max()))
    if not extents:
        return None
    numbers = np.array(extents)
    low, high = float(numbers[:, 1].min()), float(numbers[:, 2].max())
    return Range(low, high, numbers) if high > low else None


def spline_forces(piece: Piece, ranges: Mapping[str, Range | None]) -> Array:
    """What each coefficient does to the force (N) at the points of a curve: ``[t, kinds x 2 x coefficients]``."""
    blocks = []
    for index, kind in enumerate(KINDS):
        block = np.zeros((piece.kind.size, 2 * COEFFICIENTS))
        there, within = piece.kind == index, ranges[kind]
        if within is not None and there.any():
            block[there] = splines_at(piece.place[there], piece.number[there], within)
        blocks.append(block)
    return np.concatenate(blocks, axis=1)


def splines_at(place: Array, number: Array, within: Range) -> Array:
    """Splines ``[t, 2 x coefficients]``: as they are, and times the logarithm of the phase's number."""
    ends = np.linspace(within.low, within.high, COEFFICIENTS - DEGREE + 1)
    knots = np.concatenate([[within.low] * DEGREE, ends, [within.high] * DEGREE])
    plain = BSpline.design_matrix(np.clip(place, within.low, within.high), knots, DEGREE).toarray()
    return np.concatenate([plain, plain * np.log(number)[:, np.newaxis]], axis=1)
