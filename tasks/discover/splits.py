"""What a fit has not seen: whole curves, or the later cycles and steps of each.

An effect that is there predicts what was left out; one that only fits does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tasks.discover.measured import Measured
from tasks.model import Curve, Protocol
from tasks.model.phases import phases
from tasks.simulate import Array

PROTOCOL, LATER, SPECIMEN = "protocol", "later cycles", "specimen"
"""Kinds: a curve is left out; the later cycles and steps of every curve are; the effect comes from other specimens."""


@dataclass(frozen=True, eq=False)
class Split:
    """What a fit sees, and by curve the first point (of the whole curve) of what it does not see."""

    kind: str
    seen: Measured
    judged: Mapping[str, int]


def splits(measured: Measured) -> list[Split]:
    """All splits of a specimen's own curves; none where there is one curve with one loading."""
    curves = measured.curves
    found = []
    if len(curves) > 1:
        for curve in curves:
            others = tuple(one for one in curves if one is not curve)
            found.append(Split(PROTOCOL, _with(measured, others), {curve.name: 0}))
    cuts = {curve.name: cut for curve in curves if (cut := _second_half(curve.protocol)) is not None}
    if cuts:
        earlier = tuple(_until(curve, cuts[curve.name]) if curve.name in cuts else curve for curve in curves)
        found.append(Split(LATER, _with(measured, earlier), cuts))
    return found


def _with(measured: Measured, curves: tuple[Curve, ...]) -> Measured:
    return Measured(replace(measured.specimen, curves=curves), measured.noise)


def _second_half(protocol: Protocol) -> int | None:
    """The point at which the later half of a curve's loadings begins; None when it is loaded once."""
    begins = [phase.start for phase in phases(protocol) if phase.kind == "load"]
    return begins[(len(begins) + 1) // 2] if len(begins) > 1 else None


def _until(curve: Curve, stop: int) -> Curve:
    protocol = curve.protocol
    return Curve(Protocol(protocol.name, protocol.time_s[:stop], protocol.displacement_mm[:stop]), curve.force_N[:stop])


def gain(losses: Mapping[str, tuple[Array, Array]], block: int) -> tuple[float, float]:
    """How much better what was left out is predicted with an effect than without, and its standard error.

    ``losses``: by curve, whitened squared errors ``[t]`` without and with. Errors that follow each other depend on
    each other, so the standard error is that of sums over blocks of ``block`` points.
    """
    gains = [without - having for without, having in losses.values()]
    total = float(sum(one.sum() for one in gains))
    sums = np.concatenate([np.add.reduceat(one, np.arange(0, one.size, block)) for one in gains])
    if sums.size < 2:
        return total, float("inf")
    return total, float(np.sqrt(sums.size) * sums.std(ddof=1))
