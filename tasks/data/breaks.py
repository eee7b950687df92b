"""Where a specimen breaks: the force is lost while the specimen is still being loaded."""

from typing import Any

import numpy as np

from sinew.tasks.model import Curve
from sinew.tasks.model.phases import phases

FEWEST = 20  # points in which a break can be seen
LOST, WITHIN = 0.25, (0.005, 0.05)  # the part of the peak force that is lost over this part of the displacement
MOST_POINTS = 1000  # among which a break is looked for
SPIKE = 3  # points, of which one alone is no peak
FALLEN = 0.05  # of what is lost: a force that is nearer to the end of a break is behind it
ROUGH = 8.0  # times how far a force is from its median with its neighbours: a smaller fall is noise
STEPS = 3.0  # how much farther a force may rise from one row to the next than in the rows before
Array = np.ndarray[Any, np.dtype[Any]]


def break_of(curve: Curve) -> tuple[int, int] | None:
    """A row of a curve shortly before its break, and one behind it; None where the specimen does not break.

    A break loses ``LOST`` of the peak force while the motion goes on by less than ``WITHIN``, of which the first row is
    where that begins, and the second one where nearly all of it is lost. Both lie in one loading, that of the peak, so
    that neither holds nor unloading count. A spike of one point is none, nor is the noise of a specimen without load.
    """
    from scipy.ndimage import median_filter  # slow to import

    row = np.flatnonzero(np.isfinite(curve.force_N))
    force, moved = curve.force_N[row], curve.protocol.displacement_mm[row]
    if force.size < FEWEST or not np.ptp(moved):
        return None
    smooth = np.abs(median_filter(force, size=SPIKE, mode="nearest"))
    peak = int(np.argmax(smooth))
    rough = ROUGH * float(np.mean(np.abs(np.abs(force) - smooth)))
    for phase in phases(curve.protocol):
        if phase.kind != "load" or not phase.points.start <= row[peak] < phase.points.stop:
            continue
        rows = np.arange(peak, int(np.searchsorted(row, phase.points.stop)))
        rows = rows[:: -(-rows.size // MOST_POINTS) or 1]
        way = np.abs(moved[rows] - moved[peak]) / np.ptp(moved)
        for i, at in enumerate(rows):
            within = rows[i:][(way[i:] - way[i] > WITHIN[0]) & (way[i:] - way[i] < WITHIN[1])]
            if not within.size:
                continue
            end = float(smooth[within].min())
            if smooth[at] - end > max(LOST * smooth[peak], rough):
                behind = within[np.argmax(smooth[within] <= end + FALLEN * (smooth[at] - end))]
                before = _last_before(np.abs(force), int(at))
                return (int(row[before]), int(row[behind])) if before < behind else None
    return None


def _last_before(force: Array, row: int) -> int:
    """The last row from ``row`` on up to which the force rises by its usual steps: the median filter ends one early."""
    usual = STEPS * float(np.abs(np.diff(force[max(row - SPIKE, 0) : row + 1])).max(initial=0.0))
    while row + 1 < force.size and 0.0 <= force[row + 1] - force[row] <= usual:
        row += 1
    return row
