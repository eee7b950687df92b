"""Tests that were read without a fault and yet look wrong: a person should check units, columns and sizes."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from sinew.runner.errors import one_line
from sinew.tasks.drawing.blocks import number
from sinew.tasks.model import Specimen

SMALLEST_STRAIN = 1e-4  # no test of tissue moves less
MOST_TIMES = 30.0  # between the peak stresses of specimens of one kind in the same test


def odd_tests(specimens: Sequence[Specimen]) -> Iterator[str]:
    """A line for each test in which next to nothing moves, and for each protocol in which specimens differ too much."""
    peaks: dict[str, dict[str, float]] = defaultdict(dict)
    for one in specimens:
        for curve in one.curves:
            strain = float(np.ptp(curve.protocol.displacement_mm)) / one.length_mm
            if strain < SMALLEST_STRAIN:
                yield one_line(
                    f"look at {one.name}, {curve.name}: its displacement changes by {number(100 * strain)} % of the "
                    "length only; is it the right column, in the right unit?"
                )
            stress = float(np.abs(curve.force_N).max()) / (one.width_mm * one.thickness_mm)
            peaks[curve.name][one.name] = stress
    for protocol, found in peaks.items():
        low, high = min(found, key=found.__getitem__), max(found, key=found.__getitem__)
        if found[high] > MOST_TIMES * found[low]:
            yield one_line(
                f"look at {protocol}: a peak of {number(found[high])} MPa in {high}, but {number(found[low])} MPa in "
                f"{low}; are the units of force and size the same?"
            )
