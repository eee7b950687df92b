"""What one test recorded: a file becomes a recording, and a recording of a bar of known size a curve."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import (
    LENGTH,
    LIKELY,
    POSITION,
    STRAIN,
    STRESS,
    STRETCH,
    Column,
    Hints,
    NoColumn,
    is_spread,
    recognise,
)
from sinew.tasks.data.sizes import Size, read_sizes
from sinew.tasks.data.tables import Row, Table, read_tables
from sinew.tasks.data.text import HUGE
from sinew.tasks.model import Curve, Protocol

Array = np.ndarray[Any, np.dtype[Any]]
MOST_STRETCH = 10.0  # a ratio of lengths beyond it is in percent, or a length


@dataclass(frozen=True, eq=False)
class Recording:
    """What the file of one test holds.

    ``numbers`` ``[t, 3]``: time (s), motion (mm, or 1 for strain and stretch) and load (N, or MPa for stress), from row
    ``first`` of the file. ``columns`` says which columns these are, ``left_out`` names the others. ``header`` holds the
    rows above the titles, and ``sizes`` what they tell of the specimen.
    """

    path: Path
    numbers: Array
    columns: tuple[Column, Column, Column]
    first: int
    header: tuple[Row, ...]
    sizes: Mapping[str, Size]
    left_out: tuple[str, ...]

    @property
    def motion(self) -> Column:
        return self.columns[1]

    @property
    def load(self) -> Column:
        return self.columns[2]

    @property
    def spreads(self) -> tuple[str, ...]:
        """Titles of columns with the spread of a mean."""
        return tuple(title for title in self.left_out if is_spread(title))


@dataclass(frozen=True)
class Bar:
    """Gauge length, width and thickness (mm). An infinite length stands for one that nobody knows."""

    length_mm: float
    width_mm: float
    thickness_mm: float


def read_recording(path: Path, hints: Hints, *, first_of_alike: bool = False) -> Recording:
    """The first table of a file that has columns of time, motion and load.

    Of columns with one title, the first counts if ``first_of_alike``, with a remark; else they are refused.

    Raises :class:`BadInput` naming file, row and column: :class:`UnknownUnit` for a unit that the file does not tell.
    """
    missing: NoColumn | None = None
    for table in read_tables(path):
        try:
            columns = recognise(table, hints, first_of_alike=first_of_alike)
        except NoColumn as error:
            missing = missing or error
            continue
        return _recording(table, columns)
    assert missing is not None, "a file without tables is refused by read_tables"
    raise missing


def _recording(table: Table, columns: tuple[Column, Column, Column]) -> Recording:
    rows = _filled(table, columns)
    numbers = np.array([[_number(table, row, column) for column in columns] for row in range(rows)])
    numbers = numbers * [column.factor for column in columns]
    beyond = np.argwhere(~(np.abs(numbers) < HUGE))
    if beyond.size:
        row, column = beyond[0]
        where = f"{table.path}: row {table.rows[row][0]}, {columns[column].title}"
        raise BadInput(where, f"{numbers[row, column]:g}", "a number below 1e100")
    if len(numbers) < 3:
        raise BadInput(table.path, f"{len(numbers)} rows of numbers", "at least 3")
    places = {column.place for column in columns}
    left_out = tuple(title for place, title in enumerate(table.titles) if place not in places and title)
    return Recording(table.path, numbers, columns, table.first, table.header, read_sizes(table.header), left_out)


def _filled(table: Table, columns: Sequence[Column]) -> int:
    """The number of rows up to the last with anything in these columns: the longest of several tests is beside them."""
    rows = len(table.rows)
    while rows and not any(table.rows[rows - 1][1][column.place : column.place + 1] > ("",) for column in columns):
        rows -= 1
    return rows


def _number(table: Table, row: int, column: Column) -> float:
    value = table.number(row, column.place)
    if value is None:
        at, cells = table.rows[row]
        cell = cells[column.place] if column.place < len(cells) else ""
        where = f"{table.path}: row {at}, {column.title or column.quantity.name}"
        mark = "a point" if table.decimal == "." else "a comma"
        raise BadInput(where, shown(cell), f"a finite number with {mark} as decimal mark, like those above")
    return value


def curve_of(recording: Recording, bar: Bar, protocol: str, *, reference: float | None = None) -> Curve:
    """The curve of a bar. Time starts at 0. A stress becomes a force with the cross-section.

    ``reference``: the stretch at zero displacement (default: 1), for a column of stretch only. Raises
    :class:`BadInput` for times that do not increase and for displacements that the gauge length makes impossible.
    """
    time_s, _, load = recording.numbers.T
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        problem = f"{time_s[back[0] + 1]:g} s after {time_s[back[0]]:g} s"
        raise BadInput(f"{recording.path}: row {recording.first + back[0] + 1}, time", problem, "increasing times")
    displacement = _displacement(recording, bar.length_mm, reference)
    stress = recording.load.quantity is STRESS
    force = load * bar.width_mm * bar.thickness_mm if stress else load.copy()
    return Curve(Protocol(protocol, time_s - time_s[0], displacement), force)


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
        where = f"{recording.path}: row {recording.first + wrong[0]}, {quantity.name}"
        expected = f"a length over the reference length, above 0 and at most {MOST_STRETCH:g}"
        raise BadInput(where, f"{motion[wrong[0]]:g}", expected)
    crushed = np.flatnonzero(displacement <= -length_mm)
    if crushed.size:
        where = f"{recording.path}: row {recording.first + crushed[0]}, {quantity.name}"
        problem = f"{displacement[crushed[0]]:g} mm shortens a gauge of {length_mm:g} mm to nothing"
        raise BadInput(where, problem, "another gauge length, unit or column")


def remarks(recording: Recording) -> list[str]:
    """What a person should check in a recording that was understood."""
    found = []
    for column in recording.columns:
        if column.alike:
            others = ", ".join(f"'{title}'" for title in column.alike)
            found.append(f"{column.quantity.name} from column {column.place + 1}; it may be in another: {others}")
    if recording.motion.quantity is POSITION:
        found.append(f"positions, {LIKELY} to count from the first one")
    found += _signs(recording)
    return found


def _signs(recording: Recording) -> list[str]:
    """A remark where the specimen gets shorter or is pushed; positive is tension."""
    motion, force = recording.numbers[:, 1], recording.numbers[:, 2]
    if recording.motion.quantity in (POSITION, LENGTH, STRETCH):
        motion = motion - motion[0]
    shorter, pushed = _below(motion), _below(force)
    if shorter and pushed:
        unless = "unless the machine counts tension as negative"
        fibres = "fibres carry no load then, so this test tells nothing of their parameters"
        return [f"a compression, {unless}: it gets shorter, forces are below 0; {fibres}"]
    if shorter:
        return ["the specimen gets shorter, but forces are above 0; in a compression they should be below 0"]
    if pushed:
        return ["forces are below 0; tension is positive here, so look at the machine's sign"]
    return []


def _below(values: np.ndarray[Any, Any]) -> bool:
    return bool(np.median(values) < 0 and abs(values.min()) > 5 * abs(values.max()))
