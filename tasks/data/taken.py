"""What each file is taken for, as one table that a person can check before anything is asked or written."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import Column
from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.exports import Reading
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Inspection, inspect
from sinew.tasks.data.quantities import BASE_UNITS, DISPLACEMENT, FORCE, STRAIN, STRETCH
from sinew.tasks.data.rates import rate_words
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.signs import NEGATE
from sinew.tasks.data.sizes import SIZES
from sinew.tasks.data.specimen_sizes import Sizes
from sinew.tasks.data.told import as_told

TITLES = ("file", "time", "displacement", "force", "size", "offset, preload", "peak", "sign", "loaded at")
UNKNOWN = "?"


def _row(found: Inspection, hints: Hints) -> tuple[str, ...]:
    """A cell for each of ``TITLES``, in s, mm, N or MPa. Of several tests, the numbers are those of the first.

    Offset and preload are the first motion and load, as ``hints`` count them.
    """
    several = f" ({found.specimens} tests)" if found.specimens > 1 else ""
    time, motion, load = found.columns
    columns = _column(time), _column(motion, DISPLACEMENT.name), _column(load, FORCE.name)
    test = as_told(found.recordings[0], hints) if found.recordings else None
    first, peak = found.first[1:], found.peak
    if test is not None:
        first = float(test.numbers[0, 1]), float(test.numbers[0, 2])
        peak = float(test.numbers[np.argmax(np.abs(test.numbers[:, 2])), 2])
    return (
        f"{found.path.name}{several}",
        *columns,
        _sizes(found),
        f"{_number(first[0], motion)}, {_number(first[1], load)}",
        _number(peak, load),
        UNKNOWN if test is None else _sign(test),
        UNKNOWN if test is None else _rate(test, found.sizes["length"]),
    )


def _refused(path: Path, error: BadInput) -> tuple[str, ...]:
    """The same for a file that cannot be read: the reason stands in the second cell."""
    return path.name, error.problem, *[""] * (len(TITLES) - 2)


def _column(column: Column | None, usual: str = "") -> str:
    if column is None:
        return UNKNOWN
    kind = "" if column.quantity.name == usual or not usual else f"{column.quantity.name}: "
    title, unit = column.title or f"column {column.place + 1}", column.unit or UNKNOWN
    told = f"({unit})" in title or f"[{unit}]" in title
    return f"{kind}{title}" if told else f"{kind}{title} in {unit}"


def _sizes(found: Inspection) -> str:
    cells = [UNKNOWN if found.sizes[size] is None else f"{found.sizes[size]:.4g}" for size in SIZES]
    area = found.sizes["area"]
    if cells[1:] == [UNKNOWN, UNKNOWN] and area is not None:
        return f"{cells[0]} mm, {area:.4g} mm2"
    return f"{' x '.join(cells)} mm"


def _number(value: float | None, column: Column | None) -> str:
    if value is None or column is None:
        return UNKNOWN
    if not column.unit and not column.quantity.bare:
        return f"{value:.4g} {UNKNOWN}"
    return f"{value:.4g} {BASE_UNITS.get(column.quantity.name, '')}".strip()


def _sign(test: Recording) -> str:
    if any(doubt.option == NEGATE for doubt in test.doubts):
        return UNKNOWN
    return "compression" if float(np.median(test.numbers[:, 2])) < 0 else "tension"


def _rate(test: Recording, length_mm: float | None) -> str:
    """The strain rate, or the speed where nobody knows the gauge length."""
    relative = test.motion.quantity in (STRAIN, STRETCH)
    length = 1.0 if relative else length_mm
    try:
        curve = curve_of(test, Bar(length or math.inf, 1.0, 1.0), "test")
    except BadInput:
        return UNKNOWN
    return rate_words(curve.protocol, length) or UNKNOWN


def look_at(paths: Sequence[Path], hints: Hints, sizes: Sizes) -> dict[Path, Inspection | BadInput]:
    """What each file is taken for, with what a person says, or why it cannot be read."""
    found: dict[Path, Inspection | BadInput] = {}
    for path in paths:
        try:
            one = inspect(path, Reading(length_mm=sizes.length_mm, hints=hints))
        except BadInput as error:
            found[path] = error
            continue
        given = {"width": sizes.width_mm, "thickness": sizes.thickness_mm}
        found[path] = replace(one, sizes=one.sizes | {size: mm for size, mm in given.items() if mm is not None})
    return found


def rows_of(found: Mapping[Path, Inspection | BadInput], hints: Hints) -> list[tuple[str, ...]]:
    """The table: a row with a cell for each of ``TITLES`` for each file."""
    return [_refused(path, one) if isinstance(one, BadInput) else _row(one, hints) for path, one in found.items()]


def usable(found: Mapping[Path, Inspection | BadInput]) -> dict[Path, tuple[Recording, ...]]:
    """The tests of the files that need no answer to be read."""
    return {
        path: one.recordings
        for path, one in found.items()
        if not isinstance(one, BadInput) and not any(c.alike for test in one.recordings for c in test.columns)
        if one.recordings
    }
