"""Which points of long curves are drawn."""

import numpy as np

from sinew.tasks.model import Protocol
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.evaluation import kept_points


def drawn_points(protocol: Protocol, *curves: Array, count: int) -> Array:
    """Positions, at most ``count``, at which curves ``[t]`` along a protocol look as they do at all points.

    Half of them represent the protocol (:func:`sinew.tasks.simulate.evaluation.kept_points`), so that the start of a
    relaxation is smooth, with the smallest and the largest displacement. The others are the smallest and the largest
    value of each curve within equal intervals of time, so that no peak is cut and no cycle is aliased. NaN is where
    there is no value.
    """
    rows = protocol.time_s.size
    if rows <= count:
        return np.arange(rows)
    moved = protocol.displacement_mm
    keep = [kept_points(protocol, count // 2 - 2), np.array([moved.argmin(), moved.argmax()])]
    intervals = (count - count // 2) // (2 * max(len(curves), 1))
    time = protocol.time_s
    edges = np.searchsorted(time, np.linspace(time[0], time[-1], intervals + 1)[1:-1])
    for curve in curves:
        for part in np.split(np.arange(rows), edges):
            there = part[np.isfinite(curve[part])]
            if there.size:
                values = curve[there]
                keep.append(there[[values.argmin(), values.argmax()]])
    return np.unique(np.concatenate(keep))
