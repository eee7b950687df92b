"""From a recording to the curve of a bar of known size: force (N) over displacement (mm) and time (s)."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import LIKELY
from sinew.tasks.data.quantities import LENGTH, POSITION, STRAIN, STRESS, STRETCH
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.sizes import round_in_words
from sinew.tasks.data.sources import source_in_words
from sinew.tasks.model import Curve, Protocol

Array = np.ndarray[Any, np.dtype[Any]]
FAR_FROM_GAUGE = 0.05  # of it: a first length that differs by more
MOST_STRETCH = 10.0  # a ratio of lengths beyond it is in percent, or a length


@dataclass(frozen=True)
class Bar:
    """Gauge length, width and thickness (mm). An infinite length stands for one that nobody knows."""

    length_mm: float
    width_mm: float
    thickness_mm: float

    @property
    def area_mm2(self) -> float:
        return self.width_mm * self.thickness_mm


def check_times(recording: Recording) -> None:
    """Raises :class:`BadInput` for times that do not increase."""
    time_s = recording.numbers[:, 0]
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        problem = f"{time_s[back[0] + 1]:g} s after {time_s[back[0]]:g} s"
        where = f"{recording.path}: row {recording.rows[back[0] + 1]}, time"
        raise BadInput(where, problem, f"increasing times{recording.remedy}")


def curve_of(recording: Recording, bar: Bar, protocol: str, *, reference: float | None = None) -> Curve:
    """The curve of a bar. Time starts at 0. A stress becomes a force with the cross-section.

    ``reference``: the stretch at zero displacement (default: 1), for a column of stretch only. Raises
    :class:`BadInput` for times that do not increase and for displacements that the gauge length makes impossible.
    """
    check_times(recording)
    time_s, _, load = recording.numbers.T
    displacement = _displacement(recording, bar.length_mm, reference)
    stress = recording.load.quantity is STRESS
    force = load * bar.width_mm * bar.thickness_mm if stress else load.copy()
    further = dict(recording.further.values)
    told = round_in_words(recording.sizes, bar.width_mm)
    what = (*(column.in_words for column in recording.columns), *recording.notes, *([told] if told else []))
    source = source_in_words(recording.path, recording.test, what)
    return Curve(Protocol(protocol, time_s - time_s[0], displacement), force, further, source)


def _displacement(recording: Recording, length_mm: float, reference: float | None) -> Array:
    """Displacement ``[t]`` (mm) from the reference."""
    motion, quantity = recording.numbers[:, 1], recording.motion.quantity
    if reference is not None and quantity is not STRETCH:
        raise BadInput(recording.path, f"holds {quantity.name}s, which --reference does not apply to", "a stretch")
    displacement: Array = motion.copy()
    if quantity is STRAIN:
        displacement = motion * length_mm
    elif quantity is STRETCH:
        displacement = (motion / (reference or 1.0) - 1.0) * length_mm
    elif quantity is LENGTH:
        displacement = motion - length_mm
    elif quantity is POSITION:
        displacement = motion - motion[0]
    _check_displacement(recording, displacement, length_mm)
    return displacement


def _check_displacement(recording: Recording, displacement: Array, length_mm: float) -> None:
    motion, quantity = recording.numbers[:, 1], recording.motion.quantity
    wrong = np.flatnonzero((motion > MOST_STRETCH) | (motion <= 0)) if quantity is STRETCH else np.empty(0, int)
    if wrong.size:
        where = f"{recording.path}: row {recording.rows[wrong[0]]}, {quantity.name}"
        expected = f"a length over the reference length, above 0 and at most {MOST_STRETCH:g}"
        raise BadInput(where, f"{motion[wrong[0]]:g}", expected)
    crushed = np.flatnonzero(displacement <= -length_mm)
    if crushed.size:
        where = f"{recording.path}: row {recording.rows[crushed[0]]}, {quantity.name}"
        problem = f"{displacement[crushed[0]]:g} mm leaves nothing of a gauge length of {length_mm:g} mm"
        raise BadInput(where, problem, "another gauge length, unit or column")


def begins_elsewhere(recording: Recording, length_mm: float | None) -> Iterator[str]:
    """A remark where current lengths begin far from the gauge length: the test would begin at a strain."""
    first = float(recording.numbers[0, 1])
    if recording.motion.quantity is LENGTH and length_mm and abs(first - length_mm) > FAR_FROM_GAUGE * length_mm:
        strain = 100.0 * (first / length_mm - 1.0)
        yield f"its lengths begin at {first:g} mm, a strain of {strain:.3g} % of the gauge length, {length_mm:g} mm"


def first_length_in_words(recording: Recording) -> str:
    """A remark on the length in the first row, where that serves as gauge length."""
    return f"gauge length {recording.numbers[0, 1]:g} mm, {LIKELY}: the length in the first row"
