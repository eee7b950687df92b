"""Measurement files of LabVIEW (``.lvm``): segments of channels that tell their units and times, as rows of a table.

A file begins with a header of keys. Each segment has one of its own, with units and time steps, then titles, then
samples (National Instruments: Specification for the LabVIEW Measurement File). A segment becomes rows of titles with
their units and of numbers, so that segments are read as tables of one file are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.text import number

FIRST, END = "LabVIEW Measurement", "***End_of_Header***"
SEPARATORS = {"Tab": "\t", "Comma": ",", "Semicolon": ";"}
X, CHANNELS, COMMENT = "X_Value", "Channels", "Comment"
Row = tuple[str, ...]
Rows = list[tuple[int, Row]]


@dataclass(frozen=True)
class Layout:
    """How a file is written: between cells, in numbers, and which columns of times it has (``No``, ``One``, ``Multi``).

    ``header``: the rows above the first segment. ``start``: the first line behind them.
    """

    separator: str
    decimal: str
    times: str
    header: Rows
    start: int


def is_labview(lines: Sequence[tuple[int, str]]) -> bool:
    """Whether a text is such a file."""
    return bool(lines) and lines[0][1].strip(" \t,;").startswith(FIRST)


def read_labview(path: Path, lines: Sequence[tuple[int, str]]) -> tuple[Rows, str, str]:
    """The rows of all segments below those of the header, the separator and the decimal mark.

    Raises :class:`BadInput` for a file whose keys make no sense.
    """
    layout = _layout(path, lines)
    rows, first = list(layout.header), None
    split = [(at, tuple(cell.strip() for cell in line.split(layout.separator))) for at, line in lines[layout.start :]]
    place = 0
    while place < len(split):
        if not any(split[place][1]):
            place += 1
            continue
        keys, place = _keys(path, split, place)
        begins = _begins(keys)
        first = begins if first is None else first
        late = (begins - first).total_seconds() if begins and first else 0.0
        end = next((at for at in range(place, len(split)) if not any(split[at][1])), len(split))
        rows += _segment(path, layout, keys, split[place:end], late)
        place = end
    return rows, layout.separator, layout.decimal


def _layout(path: Path, lines: Sequence[tuple[int, str]]) -> Layout:
    place = next((place for place, (_, line) in enumerate(lines) if line.startswith(END)), None)
    if place is None:
        raise BadInput(path, f"has no line {END}", "a whole LabVIEW measurement file")
    told = {}
    for key in ("Separator", "Decimal_Separator", "X_Columns"):
        line = next((line for _, line in lines[:place] if line.startswith(key)), None)
        if line is not None:  # key, separator, value: the separator may be the value, too
            told[key] = line[len(key) + 1 :].rstrip("\t ") or line[len(key) :].strip()
    separator = SEPARATORS.get(told.get("Separator", "Tab").strip(" ,;"))
    decimal, times = told.get("Decimal_Separator", ".")[:1], told.get("X_Columns", "One").strip(" ,;")
    if separator is None or decimal not in (".", ",") or separator == decimal or times not in ("No", "One", "Multi"):
        problem = ", ".join(f"{key} {value}" for key, value in told.items())
        raise BadInput(path, shown(problem), "a LabVIEW measurement file with Separator, Decimal_Separator, X_Columns")
    header = [(at, tuple(cell.strip() for cell in line.split(separator))) for at, line in lines[:place]]
    return Layout(separator, decimal, times, header, place + 1)


def _keys(path: Path, split: Sequence[tuple[int, Row]], place: int) -> tuple[dict[str, Row], int]:
    """The keys of a segment's header and their values, and the place of its titles."""
    keys: dict[str, Row] = {}
    for at in range(place, len(split)):
        key, *values = split[at][1]
        if key == END:
            return keys, at + 1
        keys[key] = tuple(values)
    if CHANNELS in keys:
        raise BadInput(f"{path}: row {split[place][0]}", f"a segment without {END}", "a whole LabVIEW measurement file")
    raise BadInput(f"{path}: row {split[place][0]}", f"{shown(split[place][1][0])} behind an empty line", "a segment")


def _begins(keys: dict[str, Row]) -> datetime | None:
    """When a segment begins; None where it does not tell."""
    try:
        clock, _, fraction = keys["Time"][0].replace(",", ".").partition(".")
        begins = datetime.strptime(f"{keys['Date'][0]} {clock}", "%Y/%m/%d %H:%M:%S")
        return begins.replace(microsecond=int(f"{fraction:0<6.6}"))
    except (KeyError, IndexError, ValueError):
        return None


def _segment(
    path: Path, layout: Layout, keys: dict[str, Row], rows: Sequence[tuple[int, Row]], late: float
) -> Iterator[tuple[int, Row]]:
    """Titles with units, and numbers with times; ``late`` (s): how much later than the first segment it begins."""
    if not rows:
        return
    (at, titles), numbers = rows[0], rows[1:]
    per_channel = 2 if layout.times == "Multi" else 1
    channels = range(1, len(titles), per_channel)
    titled = list(titles)
    for number_of, place in enumerate(channels):
        unit = _value(keys, "Y_Unit_Label", number_of)
        if unit and titles[place] not in ("", COMMENT):
            titled[place] = f"{titles[place]} ({unit})"
    if _value(keys, "X_Dimension", 0) in ("", "Time"):
        unit = _value(keys, "X_Unit_Label", 0) or "s"
        titled = [f"Time ({unit})" if title == X else title for title in titled]
    same = _same_times(numbers, titles) if layout.times == "Multi" else []
    kept = [place for place in range(len(titles)) if place not in same]
    yield at, tuple(titled[place] for place in kept)
    for count, (line, cells) in enumerate(numbers):
        filled = [*cells, *[""] * (len(titles) - len(cells))]
        if layout.times == "No":
            filled[0] = _time(path, layout, keys, count, late)
        yield line, tuple(filled[place] for place in kept)


def _value(keys: dict[str, Row], key: str, number_of: int) -> str:
    values = keys.get(key, ())
    return values[number_of] if number_of < len(values) else ""


def _same_times(numbers: Sequence[tuple[int, Row]], titles: Row) -> list[int]:
    """The columns of times that repeat the first one in each row in which they have any."""
    others = [place for place, title in enumerate(titles) if title == X and place]
    return [place for place in others if all(len(row) <= place or row[place] in ("", row[0]) for _, row in numbers)]


def _time(path: Path, layout: Layout, keys: dict[str, Row], count: int, late: float) -> str:
    """The time of a row that has none: all channels begin at ``X0`` and have a sample every ``Delta_X``."""
    steps, begins = ({_value(keys, key, place) for place in range(len(keys.get(key, ())))} - {""}
                     for key in ("Delta_X", "X0"))  # fmt: skip
    step = number(next(iter(steps), ""), layout.decimal)
    begin = number(next(iter(begins), "0"), layout.decimal)
    if len(steps) != 1 or len(begins) > 1 or not step or begin is None:
        problem = f"Delta_X {', '.join(sorted(steps)) or 'missing'} and no column of times"
        raise BadInput(path, problem, "one Delta_X and one X0 for all channels, or the file saved with times")
    return f"{late + begin + count * step:.10g}".replace(".", layout.decimal)
