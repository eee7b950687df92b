"""Tests that were read without a fault and yet look wrong: a person should check units, columns and sizes."""

from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from sinew.runner.errors import one_line
from sinew.tasks.data.breaks import FEWEST
from sinew.tasks.data.new_study import NewSpecimen
from sinew.tasks.data.sizes import OFF
from sinew.tasks.drawing.blocks import number
from sinew.tasks.model import Curve, Specimen

SMALLEST_STRAIN = 1e-4  # no test of tissue moves less
LARGEST_START = 0.05  # of the peak force: a force at rest that is larger is an offset, or a preload
LOADED = 0.1  # of the largest force of a specimen: a smaller one has no sign that counts
FAR = 0.2  # how much a strain that a file tells twice may differ
MOST_TIMES = 30.0  # between the peak stresses of specimens of one kind in the same test


def _odd_start(curve: Curve) -> Iterator[str]:
    """A force that does not begin at 0."""
    force, moved = curve.force_N, curve.protocol.displacement_mm
    there = np.isfinite(force)
    force, moved = force[there], moved[there]
    peak = float(np.abs(force).max(initial=0.0))
    if force.size < FEWEST or not np.ptp(moved):
        return
    if abs(force[0]) > LARGEST_START * peak and abs(moved[0]) < LARGEST_START * np.ptp(moved):
        yield (
            f"its force begins at {number(force[0])} N ({number(100 * abs(force[0]) / peak, 2)} % of its peak), "
            "that of the model at 0; if this is an offset, use --zero-force first"
        )


def _opposite_signs(one: Specimen) -> Iterator[str]:
    """Tests that move a specimen in one direction, with loads of opposite signs where it is farthest."""
    signs: dict[tuple[float, float], str] = {}
    largest = max((float(np.nanmax(np.abs(curve.force_N))) for curve in one.curves), default=0.0)
    for curve in one.curves:
        farthest = int(np.argmax(np.abs(curve.protocol.displacement_mm)))
        way, load = curve.protocol.displacement_mm[farthest], curve.force_N[farthest]
        if abs(load) > LOADED * largest:
            signs.setdefault((float(np.sign(way)), float(np.sign(load))), curve.name)
    for (way, load), name in signs.items():
        if load > 0.0 and (other := signs.get((way, -load))) is not None:
            yield one_line(
                f"look at {one.name}: where the displacement is largest, the force of {name} is above 0 and that of "
                f"{other} below; one of them has the wrong sign (--negate force for its file alone)"
            )


def odd_tests(specimens: Sequence[Specimen]) -> Iterator[str]:
    """A line for each test in which next to nothing moves, and for tests that do not go together."""
    peaks: dict[str, dict[str, float]] = defaultdict(dict)
    for one in specimens:
        yield from _opposite_signs(one)
        for curve in one.curves:
            strain = float(np.ptp(curve.protocol.displacement_mm)) / one.length_mm
            if strain < SMALLEST_STRAIN:
                yield one_line(
                    f"look at {one.name}, {curve.name}: its displacement changes by {number(100 * strain)} % of the "
                    "length only; is it the right column, in the right unit?"
                )
            yield from (one_line(f"look at {one.name}, {curve.name}: {line}") for line in _odd_start(curve))
            stress = float(np.abs(curve.force_N).max()) / (one.width_mm * one.thickness_mm)
            peaks[curve.name][one.name] = stress
    for protocol, found in peaks.items():
        low, high = min(found, key=found.__getitem__), max(found, key=found.__getitem__)
        if found[high] > MOST_TIMES * found[low]:
            yield one_line(
                f"look at {protocol}: a peak of {number(found[high])} MPa in {high}, but {number(found[low])} MPa in "
                f"{low}; are the units of force and size the same?"
            )


def contradictions(specimens: Sequence[NewSpecimen]) -> Iterator[str]:
    """A line for each test whose own strains or stresses do not go with the sizes of its specimen."""
    for new in specimens:
        one = new.specimen
        for test, curve in zip(new.tests, one.curves, strict=True):
            said, where = test.recording.repeats, f"look at {one.name}, {curve.name}"
            if said.area_mm2 is not None and not {"width", "thickness"} & set(new.missing):
                title, area = said.area_mm2
                known = one.width_mm * one.thickness_mm
                if abs(area - known) > OFF * known:
                    yield one_line(
                        f"{where}: force over '{title}' is {number(area)} mm2, but width x thickness is "
                        f"{number(known)} mm2; which is the cross-section?"
                    )
            if said.strain is not None and "length" not in new.missing:
                title, strain = said.strain
                moved = float(np.ptp(curve.protocol.displacement_mm)) / one.length_mm
                if not 1.0 - FAR < moved / strain < 1.0 + FAR:
                    yield one_line(
                        f"{where}: '{title}' changes by {number(100 * strain)} %, but displacement over length by "
                        f"{number(100 * moved)} %; which is the strain of the specimen?"
                    )
