"""Measurement files of LabVIEW (``.lvm``): segments of channels that tell their units and times, as rows of a table.

A file begins with a header of keys. Each segment has one of its own, with units and time steps, then titles, then
samples (National Instruments: Specification for the LabVIEW Measurement File). A segment becomes rows of titles with
their units and of numbers, so that segments are read as tables of one file are.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units
from sinew.tasks.data.text import number

FIRST, END = "LabVIEW Measurement", "***End_of_Header***"
SPECIAL, END_SPECIAL = "***Start_Special***", "***End_Special***"  # around what only some program understands
SEPARATORS = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}
X, CHANNELS, COMMENT = "X_Value", "Channels", "Comment"
ALWAYS = ("Samples", "Date", "Time", "X0", "Delta_X")  # keys that tell something of each channel
TOGETHER, AT_ONCE_S = 0.5, 0.01  # of a time step, or without one: channels that begin less apart begin together
TOGETHER_EXPECTED = "channels that are recorded together, or a file for each"
Row = tuple[str, ...]
Rows = list[tuple[int, Row]]


@dataclass(frozen=True)
class _Layout:
    """How a file is written: between cells, in numbers, and which columns of times it has (``No``, ``One``, ``Multi``).

    ``header``: the rows above the first segment. ``start``: the first line behind them.
    """

    path: Path
    separator: str
    decimal: str
    times: str
    header: Rows
    start: int


@dataclass(frozen=True)
class _Segment:
    """The ``keys`` of a segment, each with the cells behind it, its ``titles`` in row ``at``, and its ``rows``."""

    keys: Mapping[str, Row]
    at: int
    titles: Row
    rows: Rows


def is_labview(lines: Sequence[tuple[int, str]]) -> bool:
    """Whether a text is such a file."""
    return bool(lines) and lines[0][1].strip(" \t,;").startswith(FIRST)


def read_labview(path: Path, lines: Sequence[tuple[int, str]]) -> tuple[Rows, str, str]:
    """The rows of all segments below those of the header, the separator and the decimal mark.

    Raises :class:`BadInput` for a file whose keys make no sense.
    """
    lines = list(_without_special(lines))
    layout = _layout(path, lines)
    rows, last = list(layout.header), -1.0
    titles: Row = ()
    begun: datetime | None = None  # the first segment
    for segment in _segments(layout, lines):
        begins, titled = _begins(layout, segment), _titled(layout, segment)
        begun = begun if titles else begins
        late = (begins - begun).total_seconds() if begins and begun else 0.0
        kept, filled = _filled(layout, segment, late, last)
        now = tuple(titled[place] for place in kept)
        if titles not in ((), now):
            problem = f"a segment of {shown(', '.join(now), 80)}, but {shown(', '.join(titles), 80)} above"
            raise BadInput(f"{path}: row {segment.at}", problem, "segments with the same channels and units in a file")
        titles = now
        rows += [(segment.at, now), *((at, tuple(row[place] for place in kept)) for at, row in filled)]
        last = next((time for _, row in reversed(filled) if (time := number(row[0], layout.decimal)) is not None), last)
    return rows, layout.separator, layout.decimal


def _layout(path: Path, lines: Sequence[tuple[int, str]]) -> _Layout:
    end = next((place for place, (_, line) in enumerate(lines) if line.startswith(END)), None)
    if end is None:
        raise BadInput(path, f"has no line {END}", "a whole LabVIEW measurement file")
    told = {}
    for _, line in lines[:end]:
        for key in ("Separator", "Decimal_Separator", "X_Columns"):
            if re.match(rf"{key}(?!\w)", line):  # key, separator, value: the separator may be the value, too
                told[key] = line[len(key) + 1 :].rstrip("\t ") or line[len(key) :].strip()
    separator = SEPARATORS.get(told.get("Separator", "Tab").strip(" ,;"))
    decimal, times = told.get("Decimal_Separator", ".")[:1], told.get("X_Columns", "One").strip(" ,;")
    if separator is None or decimal not in (".", ",") or separator == decimal or times not in ("No", "One", "Multi"):
        problem = ", ".join(f"{key} {value}" for key, value in told.items())
        raise BadInput(path, shown(problem), "a LabVIEW measurement file with Separator, Decimal_Separator, X_Columns")
    header = [(at, tuple(cell.strip() for cell in line.split(separator))) for at, line in lines[:end]]
    return _Layout(path, separator, decimal, times, header, end + 1)


def _without_special(lines: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    inside = False
    for at, line in lines:
        inside = inside or line.startswith(SPECIAL)
        if not inside:
            yield at, line
        inside = inside and not line.startswith(END_SPECIAL)


def _segments(layout: _Layout, lines: Sequence[tuple[int, str]]) -> Iterator[_Segment]:
    """The segments of a file, each behind an empty line."""
    split = [(at, tuple(cell.strip() for cell in line.split(layout.separator))) for at, line in lines[layout.start :]]
    place = 0
    while place < len(split):
        at, row = split[place]
        if not any(row):
            place += 1
            continue
        if row[0] != CHANNELS:
            problem = f"{shown(' '.join(row).strip(), 60)} behind an empty line or the header"
            expected = f"a segment, which begins with {CHANNELS}, or no empty line within the samples"
            raise BadInput(f"{layout.path}: row {at}", problem, expected)
        end = next((one for one in range(place, len(split)) if split[one][1][0] == END), len(split))
        keys = {row[0]: row[1:] for _, row in split[place:end]}
        place = end + 1
        stop = next((one for one in range(place, len(split)) if not any(split[one][1])), len(split))
        if place >= stop:
            raise BadInput(f"{layout.path}: row {at}", f"a segment without {END} and titles", "a whole file")
        title_row, titles = split[place]
        if titles[0] != X:
            raise BadInput(f"{layout.path}: row {title_row}", f"{shown(titles[0])} as first title", X)
        yield _Segment(keys, title_row, titles, [_row(each, len(titles)) for each in split[place + 1 : stop]])
        place = stop


def _row(row: tuple[int, Row], width: int) -> tuple[int, Row]:
    at, cells = row
    return at, (*cells, *[""] * (width - len(cells)))


def _values(layout: _Layout, segment: _Segment, key: str) -> dict[int, str]:
    """What a key tells of each channel, by the place of its column.

    With a column of times for each channel, there is an empty cell for each of these, or there is none for any.
    """
    told = segment.keys.get(key, ())
    step = 2 if layout.times == "Multi" else 1
    places = [place for place in range(1, len(segment.titles), step) if segment.titles[place] != COMMENT]
    spaced = step == 2 and any(len(row) > 1 and not row[1] for row in map(segment.keys.get, ALWAYS) if row)
    at = {place: place - 1 if spaced else number_of for number_of, place in enumerate(places)}
    return {place: told[index] for place, index in at.items() if index < len(told)}


def _titled(layout: _Layout, segment: _Segment) -> list[str]:
    """The titles with their units."""
    titled = list(segment.titles)
    for place, unit in _values(layout, segment, "Y_Unit_Label").items():
        titled[place] = f"{segment.titles[place]} ({unit})" if unit else segment.titles[place]
    if set(_values(layout, segment, "X_Dimension").values()) <= {"", "Time"}:
        titled = [f"Time ({_time_unit(layout, segment)})" if title == X else title for title in titled]
    return titled


def _time_unit(layout: _Layout, segment: _Segment) -> str:
    return next(filter(None, _values(layout, segment, "X_Unit_Label").values()), "s")


def _begins(layout: _Layout, segment: _Segment) -> datetime | None:
    """When a segment begins; None where it does not tell. Raises :class:`BadInput` for channels that begin apart."""
    dates, clocks = (_values(layout, segment, key) for key in ("Date", "Time"))
    found = (_moment(dates.get(place, ""), clock) for place, clock in clocks.items())
    moments = [moment for moment in found if moment is not None]
    if not moments:
        return None
    steps, factor = _numbers(layout, segment, "Delta_X"), units.factor(units.TIME, _time_unit(layout, segment))
    apart = (max(moments) - min(moments)).total_seconds()
    if apart > (TOGETHER * min(steps) * (factor or 1.0) if steps else AT_ONCE_S):
        problem = f"a segment whose channels begin {apart:g} s apart"
        raise BadInput(f"{layout.path}: row {segment.at}", problem, TOGETHER_EXPECTED)
    return min(moments)


def _moment(date: str, clock: str) -> datetime | None:
    whole, _, fraction = clock.replace(",", ".").partition(".")
    try:
        return datetime.strptime(f"{date} {whole}", "%Y/%m/%d %H:%M:%S").replace(microsecond=int(f"{fraction:0<6.6}"))
    except ValueError:
        return None


def _numbers(layout: _Layout, segment: _Segment, key: str) -> set[float]:
    found = (number(value, layout.decimal) for value in _values(layout, segment, key).values() if value)
    return {value for value in found if value is not None}


def _filled(layout: _Layout, segment: _Segment, late: float, last: float) -> tuple[list[int], Rows]:
    """The places of the columns that count, and rows with times.

    Where times start again, at or before the ``last`` one of the segment before, the delay of the segment since the
    first one, ``late`` (s), is added.
    """
    titles = segment.titles
    clocks = [place for place, title in enumerate(titles) if title == X] if layout.times == "Multi" else [0]
    kept = [place for place in range(len(titles)) if place not in clocks[1:]]
    if layout.times == "No":
        begin, step = _regular(layout, segment)
        times: list[float | None] = [begin + count * step for count in range(len(segment.rows))]
    else:
        if layout.times == "One":
            _regular(layout, segment, told=False)
        told = (_one_time(layout, at, [row[place] for place in clocks]) for at, row in segment.rows)
        times = [number(cell, layout.decimal) for cell in told]
    first = next((time for time in times if time is not None), 0.0)
    factor = units.factor(units.TIME, _time_unit(layout, segment))
    offset = late / factor if late > 0.0 and factor and first <= last else 0.0
    if layout.times == "One" and not offset:
        return kept, segment.rows  # with whatever stands in place of a time
    cells = ["" if time is None else f"{time + offset:.15g}".replace(".", layout.decimal) for time in times]
    return kept, [(at, (cell, *row[1:])) for cell, (at, row) in zip(cells, segment.rows, strict=True)]


def _one_time(layout: _Layout, at: int, cells: Sequence[str]) -> str:
    """The time of a row, which all of its channels have that have any. Raises :class:`BadInput`."""
    told = dict.fromkeys(filter(None, cells))
    if len(told) > 1:
        problem = f"channels at different times, {' and '.join(told)}"
        raise BadInput(f"{layout.path}: row {at}", problem, TOGETHER_EXPECTED)
    return next(iter(told), "")


def _regular(layout: _Layout, segment: _Segment, *, told: bool = True) -> tuple[float, float]:
    """The first time and the time step of all channels of a segment, which must be ``told`` where it has no times.

    Raises :class:`BadInput`.
    """
    begins, steps = _numbers(layout, segment, "X0") or {0.0}, _numbers(layout, segment, "Delta_X")
    if len(begins) != 1 or len(steps) > 1 or (told and not min(steps, default=0.0) > 0.0):
        both = (f"{key} {', '.join(_values(layout, segment, key).values())}" for key in ("X0", "Delta_X"))
        expected = "one X0 and one Delta_X above 0 for all channels, or a column of times for each (X_Columns Multi)"
        raise BadInput(f"{layout.path}: row {segment.at}", " and ".join(both), expected)
    return min(begins), min(steps, default=0.0)
