"""Data held out from a fit: whole curves, or the later cycles and steps of each.

An effect that is really there predicts the held-out data; one that merely fits does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinew.tasks.discover.result import Gain
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Protocol
from sinew.tasks.model.phases import phases
from sinew.tasks.simulate import Array

PROTOCOL, LATER, SPECIMEN = "protocol", "later cycles", "specimen"
"""What is held out: a curve; the later cycles and steps of every curve; or a specimen, given others' effect."""


@dataclass(frozen=True, eq=False)
class Split:
    """The data of a fit, and by curve the first held-out point (counted in the whole curve)."""

    kind: str
    seen: Measured
    judged: Mapping[str, int]


def splits(measured: Measured) -> list[Split]:
    """All splits of a specimen's own curves; none where there is one curve with one loading."""
    curves = measured.curves
    possible = []
    if len(curves) > 1:
        for curve in curves:
            others = tuple(one for one in curves if one is not curve)
            possible.append(Split(PROTOCOL, measured.having(others), {curve.name: 0}))
    cuts = {curve.name: cut for curve in curves if (cut := _second_half(curve.protocol)) is not None}
    if cuts:
        earlier = tuple(_until(curve, cuts[curve.name]) if curve.name in cuts else curve for curve in curves)
        possible.append(Split(LATER, measured.having(earlier), cuts))
    return possible


def _second_half(protocol: Protocol) -> int | None:
    """The point at which the later half of a curve's loadings begins; None when it is loaded once."""
    begins = [phase.start for phase in phases(protocol) if phase.kind == "load"]
    return begins[(len(begins) + 1) // 2] if len(begins) > 1 else None


def _until(curve: Curve, stop: int) -> Curve:
    protocol = curve.protocol
    until = Protocol(protocol.name, protocol.time_s[:stop], protocol.displacement_mm[:stop])
    return Curve(until, curve.force_N[:stop], {name: values[:stop] for name, values in curve.others.items()})


def gain(losses: Mapping[str, tuple[Array, Array]], block: int) -> Gain:
    """How much better held-out data are predicted with an effect than without, and the standard error.

    ``losses``: by curve, whitened squared errors ``[quantities, t]`` without and with, NaN where nothing was measured.
    Neighbouring errors are correlated, and so are those of several quantities at the same time, so the standard error
    is that of sums over blocks of ``block`` points.
    """
    gains = [np.nansum(without - having, axis=0) for without, having in losses.values()]
    total = float(sum(one.sum() for one in gains))
    sums = np.concatenate([np.add.reduceat(one, np.arange(0, one.size, block)) for one in gains])
    if sums.size < 2:
        return Gain(total, float("inf"))
    return Gain(total, float(np.sqrt(sums.size) * sums.std(ddof=1)))
