"""What a table of a test probably is: separator, decimal mark, which column holds what, and in which unit.

For files that nobody described (:mod:`tasks.init`). Structure is guessed and each guess says how sure it is; units are
read or given, never guessed: a wrong unit looks right and costs a lab a year.
"""

import codecs
import csv
import io
import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tasks.export_tables import MAX_EXPORT_BYTES, MM, decoded
from tasks.measurements import HUGE, check_text
from tasks.problems import BadInput, shown

Array = np.ndarray[Any, np.dtype[Any]]

LONGEST_LINE, MOST_COLUMNS, HEADER_LINES = 100_000, 1000, 400
SURE, LIKELY, TOLD = "sure", "likely", "as you said"
_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", "|": "bars", " ": "spaces"}

_TIME = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "min": 60.0}
_TIME |= {"minutes": 60.0, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "h": 3600.0}
_FORCE = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "µN": 1e-6, "μN": 1e-6, "lbf": 4.4482216152605}
_FORCE |= {"kgf": 9.80665, "kp": 9.80665, "gf": 9.80665e-3, "newton": 1.0, "newtons": 1.0}
_STRESS = {"Pa": 1e-6, "kPa": 1e-3, "MPa": 1.0, "GPa": 1e3, "N/mm2": 1.0, "N/mm^2": 1.0, "N/mm²": 1.0}
_PERCENT = {"%": 0.01, "percent": 0.01, "pct": 0.01}
_ONE = {"1": 1.0, "-": 1.0, "mm/mm": 1.0, "m/m": 1.0, "in/in": 1.0}
#: Lower case that cannot be told: millinewton or meganewton, millipascal or megapascal, metre or milli.
_UNCLEAR = {"mn": "mN", "MN": "mN", "mPa": "MPa"}
_LOWER = {"n": "N", "kn": "kN", "kpa": "kPa", "mpa": "MPa", "pa": "Pa", "gpa": "GPa"}


@dataclass(frozen=True)
class Kind:
    """What a column may hold. ``names``: lower case, the better the earlier; ``units`` with factors to ours."""

    what: str
    names: tuple[str, ...]
    units: Mapping[str, float]
    option: str
    needs_unit: bool = True


TIME = Kind("time", ("time", "test time", "elapsed time", "total time", "t", "zeit", "prüfzeit", "temps", "tiempo"),
            _TIME, "--time-unit")  # fmt: skip
DISPLACEMENT = Kind(
    "displacement",
    ("displacement", "disp", "extension", "elongation", "tensile extension", "tensile displacement", "deformation",
     "crosshead displacement", "grip displacement", "stroke", "standardweg", "weg", "traversenweg", "verlängerung",
     "déplacement", "deplacement", "allongement", "desplazamiento", "u", "d", "dl", "δl", "delta l"),
    MM, "--displacement-unit",
)  # fmt: skip
POSITION = Kind("position", ("position", "pos", "crosshead", "crosshead position", "actuator", "digital position"),
                MM, "--displacement-unit")  # fmt: skip
LENGTH = Kind("length", ("length", "gauge length", "len", "länge", "longueur", "l"), MM, "--displacement-unit")
STRAIN = Kind(
    "strain",
    ("strain", "tensile strain", "engineering strain", "nominal strain", "dehnung", "eps", "epsilon", "ε",
     "déformation"),
    _PERCENT | _ONE, "--displacement-unit",
)  # fmt: skip
STRETCH = Kind("stretch", ("stretch", "stretch ratio", "length ratio", "l/l0", "lambda", "λ"), _PERCENT | _ONE,
               "--displacement-unit", needs_unit=False)  # fmt: skip
FORCE = Kind(
    "force",
    ("force", "load", "tensile force", "kraft", "standardkraft", "prüfkraft", "last", "fuerza", "charge", "f", "p",
     "load cell", "axial force", "axial load"),
    _FORCE, "--force-unit",
)  # fmt: skip
STRESS = Kind("stress", ("stress", "tensile stress", "engineering stress", "nominal stress", "spannung", "contrainte",
                         "σ", "sigma"), _STRESS, "--force-unit")  # fmt: skip
MOTIONS, LOADS = (DISPLACEMENT, LENGTH, POSITION, STRETCH, STRAIN), (FORCE, STRESS)
TIME_UNITS = tuple(_TIME)
MOTION_UNITS = (*MM, *_PERCENT, *_ONE)
LOAD_UNITS = (*_FORCE, *_STRESS)


@dataclass(frozen=True)
class Hints:
    """What a person said: names (or numbers, from 1) of columns, and units, where a file does not tell."""

    time_column: str | None = None
    displacement_column: str | None = None
    force_column: str | None = None
    time_unit: str | None = None
    displacement_unit: str | None = None
    force_unit: str | None = None


class UnitUnknown(BadInput):
    """A unit that only a person can say. ``option`` is the one that says it, ``choices`` are what it may be."""

    def __init__(self, where: str, what: str, option: str, choices: Sequence[str]) -> None:
        super().__init__(where, f"no unit of the {what} can be found", f"{option}, one of {', '.join(choices)}")
        self.option, self.choices, self.what = option, tuple(choices), what


@dataclass(frozen=True)
class Column:
    """A column of a file and what it is taken for. ``unit`` is as in the file; ``how``: how sure that is."""

    kind: Kind
    place: int
    title: str
    unit: str
    factor: float
    how: str


@dataclass(frozen=True, eq=False)
class Guess:
    """``numbers`` ``[t, 3]``: time (s), motion (mm, or 1 for strain and stretch) and load (N, or MPa for stress).

    ``first`` is the row of the file that the numbers begin in; ``header``: the rows above the titles of columns, as
    text; ``left_out``: titles of columns that were not taken.
    """

    numbers: Array
    columns: tuple[Column, Column, Column]
    separator: str
    decimal: str
    first: int
    header: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def guess(path: Path, hints: Hints) -> Guess:
    """What a file probably is. Raises :class:`BadInput`: :class:`UnitUnknown` for a unit that it does not tell."""
    lines = _lines(path)
    separator, decimal, first = _layout(path, lines)
    rows = [_cells(line, separator) for line in lines[first:]]
    titles, units_row, above = _titles(lines, first, separator)
    if any(_is_number(cell, decimal) for cell in titles):
        broken = next((cell for cell in titles if not _is_number(cell, decimal)), "")
        raise BadInput(
            f"{path}: row {first}", f"{shown(broken)} among numbers", "names of columns above rows of numbers"
        )
    width = _width(rows[0])
    names = [*titles[:width], *[""] * (width - len(titles))]
    by_number = all(
        (hint or "").isdigit() for hint in (hints.time_column, hints.displacement_column, hints.force_column)
    )
    if titles and _width(titles) != width and not by_number:
        problem = f"{_width(titles)} names above {width} columns of numbers"
        expected = "as many; commas cannot separate columns and be decimal marks at the same time"
        raise BadInput(f"{path}: row {first + 1}", problem, expected)
    units_row = units_row[:width]
    columns = (
        _column(path, first, names, units_row, (TIME,), hints.time_column, hints.time_unit),
        _column(path, first, names, units_row, MOTIONS, hints.displacement_column, hints.displacement_unit),
        _column(path, first, names, units_row, LOADS, hints.force_column, hints.force_unit),
    )
    places = [column.place for column in columns]
    if len(set(places)) < 3:
        raise BadInput(
            path, "one column is taken for two things", "three columns; name them by --time-column and the like"
        )
    numbers = _numbers(path, rows, first, columns, decimal) * [column.factor for column in columns]
    if len(numbers) < 3:
        raise BadInput(path, f"{len(numbers)} rows of numbers", "at least 3")
    left_out = tuple(name.strip() for i, name in enumerate(names) if i not in places and name.strip())
    header = tuple(" ".join(" ".join(_cells(line, separator)).split()) for line in above)
    return Guess(numbers, columns, separator, decimal, first + 1, header, left_out)


# ---- text


def _lines(path: Path) -> list[str]:
    """The lines of a text file without those at its end that are blank."""
    try:
        with open(path, "rb") as file:
            start = file.read(4)
    except OSError:
        start = b""
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        if path.stat().st_size > MAX_EXPORT_BYTES:
            raise BadInput(path, "too large", f"at most {MAX_EXPORT_BYTES // 2**20} MB")
        try:
            text = path.read_bytes().decode("utf-16")
        except UnicodeDecodeError:
            raise BadInput(path, "not valid UTF-16 text", "a text export") from None
    else:
        check_text(path, MAX_EXPORT_BYTES)
        text = decoded(path)
    lines = re.split(r"\r\n|\n|\r", text)
    while lines and not lines[-1].strip(" \t,;|"):
        lines.pop()
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            raise BadInput(f"{path}: row {number}", f"a line of {len(line):,} characters", "a table, row by row")
        if "\0" in line:
            raise BadInput(f"{path}: row {number}", "not text", "a text export")
    if not lines:
        raise BadInput(path, "holds no text", "a header and numbers")
    return lines


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator), [])]
    except csv.Error:
        return [line]


def _width(cells: Sequence[str]) -> int:
    """How many cells, without empty ones at the end."""
    return max((i for i, cell in enumerate(cells, start=1) if cell.strip()), default=0)


_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")


def _is_number(cell: str, decimal: str) -> bool:
    other = "," if decimal == "." else "."
    return bool(_NUMBER.fullmatch(cell)) and other not in cell


def _layout(path: Path, lines: list[str]) -> tuple[str, str, int]:
    """Separator, decimal mark, and the first line of numbers: of all ways to read it, the one with the longest table.

    Numbers begin where three lines (or all that are left) in a row hold as many numbers, three at the least.
    """
    best: tuple[int, str, str, int] | None = None
    for separator in _SEPARATORS:
        for decimal in ".,":
            if separator == decimal:
                continue
            widths = []
            for line in lines[: HEADER_LINES + 50]:
                cells = _cells(line, separator)
                width = _width(cells)
                widths.append(
                    width if 3 <= width <= MOST_COLUMNS and all(_is_number(c, decimal) for c in cells[:width]) else 0
                )
            start = next((i for i, w in enumerate(widths[:HEADER_LINES]) if w and set(widths[i : i + 3]) == {w}), None)
            if start is None:
                continue
            length = next((i for i, w in enumerate(widths[start:]) if w != widths[start]), len(widths) - start)
            # whole numbers read alike with both marks; a point is what most programs write
            if best is None or length > best[0]:
                best = (length, separator, decimal, start)
    if best is None:
        expected = "three columns or more: time, displacement (or strain) and force (or stress)"
        raise BadInput(path, "no table of numbers with three columns can be found", expected)
    return best[1], best[2], best[3]


def _titles(lines: list[str], first: int, separator: str) -> tuple[list[str], list[str], list[str]]:
    """Names of columns, the row of units below them (or nothing), and the lines above."""
    at = first - 1
    while at >= 0 and not lines[at].strip(" \t,;|"):
        at -= 1
    if at < 0:
        return [], [], []
    cells = _title_cells(lines[at], separator)
    filled = [cell for cell in cells if cell.strip()]
    if at > 0 and filled and all(_looks_like_unit(cell) for cell in filled):
        names = _title_cells(lines[at - 1], separator)
        if any(name.strip() for name in names):
            return names, cells, lines[: at - 1]
    return cells, [], lines[:at]


def _title_cells(line: str, separator: str) -> list[str]:
    if separator != " ":
        return _cells(line, separator)
    line = line.lstrip("#%/ ")
    for separate in ("\t", ";", ",", "|"):  # a header may be separated in another way than numbers below it
        if separate in line:
            return _cells(line, separate)
    return re.findall(r"[^\s(\[]+(?:\s*[(\[][^)\]]*[)\]])?", line)


def _looks_like_unit(cell: str) -> bool:
    bare = cell.strip().strip("()[]").strip()
    return bare in {*_TIME, *MM, *_FORCE, *_STRESS, *_PERCENT, *_ONE} or bool(
        re.fullmatch(r"[(\[][^)\]]*[)\]]", cell.strip())
    )


# ---- columns


def _plain(title: str) -> tuple[str, str]:
    """Name, lower case, and unit (empty: none) of a title: ``Force (N)``, ``Kraft [kN]``, ``Zeit / s``, ``force_N``."""
    title = unicodedata.normalize("NFC", title).strip().lstrip("#").strip().strip("\"'")
    if found := re.fullmatch(r"(.*?)\s*[(\[]\s*([^()\[\]]*?)\s*[)\]]\s*", title, re.DOTALL):
        return _name(found[1]), found[2]
    every = {*_TIME, *MM, *_FORCE, *_STRESS, *_PERCENT, *_ONE, *_UNCLEAR, *_LOWER}
    if title.lower() in STRETCH.names:
        return title.lower(), ""
    for pattern in (r"(.+?)\s*/\s*(\S+)", r"(.+?)\s*,\s*(\S+)", r"(.+)[_ ]([^\s_]+)", r"(.+?)\s+in\s+(\S+)"):
        if (found := re.fullmatch(pattern, title)) and found[2] in every:
            return _name(found[1]), found[2]
    return _name(title), ""


def _name(text: str) -> str:
    text = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", text)
    return re.sub(r"[\s_.:-]+", " ", text).strip().lower().removesuffix(" in").strip()


def _column(
    path: Path, first: int, titles: Sequence[str], units_row: Sequence[str], kinds: Sequence[Kind], wanted: str | None,
    given: str | None,
) -> Column:  # fmt: skip
    """The column for one of ``kinds``, the first of them first."""
    what = " or ".join(kind.what for kind in kinds) if len(kinds) < 3 else "displacement, length or strain"
    option = {"time": "--time-column", "displacement": "--displacement-column"}.get(kinds[0].what, "--force-column")
    plain = [_plain(title) for title in titles]
    if wanted is not None:
        place = _named_place(path, titles, plain, wanted, option)
        kind, how = next((k for k in kinds if plain[place][0] in k.names), None), TOLD
        kind = kind or _kind_of_unit(kinds, plain[place][1] or _below(units_row, place) or given or "")
        if kind is None:
            raise UnitUnknown(f"{path}: column {shown(wanted)}", what, kinds[0].option, _choices(kinds))
    else:
        found = [
            (number, kind.names.index(name), place, kind)
            for number, kind in enumerate(kinds)
            for place, (name, _) in enumerate(plain)
            if name in kind.names and _possible(kind, plain[place][1] or _below(units_row, place))
        ]
        if not found:
            listed = ", ".join(title.strip() or "(no name)" for title in titles[:12])
            raise BadInput(
                f"{path}: row {first}", f"no column of {what} among {shown(listed, 200)}", f"{option} NAME or NUMBER"
            )
        number, rank, place, kind = min(found, key=lambda one: one[:3])
        alike = [one for one in found if one[:2] == (number, rank)]
        if len(alike) > 1:
            listed = " and ".join(shown(titles[one[2]]) for one in alike)
            raise BadInput(path, f"{listed} may both be the {kind.what}", f"{option} NUMBER, from 1")
        how = SURE if len(found) == 1 and rank < 6 and kind in (TIME, DISPLACEMENT, FORCE) else LIKELY
    unit = plain[place][1] or _below(units_row, place)
    where = f"{path}: {shown(titles[place].strip() or f'column {place + 1}')}"
    factor = _factor(where, kind, unit, given)
    return Column(
        kind, place, titles[place].strip(), unit or given or "1", factor, how if unit or not kind.needs_unit else TOLD
    )


def _choices(kinds: Sequence[Kind]) -> list[str]:
    return list(dict.fromkeys(unit for kind in kinds for unit in kind.units))


def _below(units_row: Sequence[str], place: int) -> str:
    return units_row[place].strip().strip("()[]").strip() if place < len(units_row) else ""


def _named_place(path: Path, titles: Sequence[str], plain: Sequence[tuple[str, str]], wanted: str, option: str) -> int:
    exact = [i for i, title in enumerate(titles) if title.strip() == wanted.strip()]
    alike = exact or [i for i, (name, _) in enumerate(plain) if name == _plain(wanted)[0] and name]
    if len(alike) == 1:
        return alike[0]
    if not alike and wanted.isascii() and wanted.isdigit() and len(wanted) < 5 and 1 <= int(wanted) <= len(titles):
        return int(wanted) - 1
    listed = ", ".join(shown(title.strip()) for title in titles[:12])
    problem = f"{shown(wanted)} is no column" if not alike else f"{shown(wanted)} names {len(alike)} columns"
    raise BadInput(f"{path}: {option}", problem, f"a number from 1 to {len(titles)}, or one of {listed}")


def _possible(kind: Kind, unit: str) -> bool:
    """Whether a column with this unit can be of a kind: a length in mm is none of a ratio."""
    return (
        not unit
        or unit in _UNCLEAR
        or _known(kind, unit) is not None
        or not _kind_of_unit((*MOTIONS, *LOADS, TIME), unit)
    )


def _kind_of_unit(kinds: Sequence[Kind], unit: str) -> Kind | None:
    """The kind that a unit belongs to; none for a bare number, which may be a strain or a stretch."""
    return next((kind for kind in kinds if unit not in _ONE and _known(kind, unit) is not None), None)


def _known(kind: Kind, unit: str) -> float | None:
    if unit in kind.units:
        return kind.units[unit]
    if kind in LOADS:  # in lower case, where that has one meaning
        return kind.units.get(_LOWER.get(unit, ""))
    return kind.units.get(unit.lower()) if unit.lower() not in ("m", "ms") else None


def _factor(where: str, kind: Kind, unit: str, given: str | None) -> float:
    if unit in _UNCLEAR and _known(kind, unit) is None and kind in LOADS:
        if given is not None and given.lower() == unit.lower():
            return kind.units[given]
        raise UnitUnknown(f"{where}: the unit {unit} can mean two things", kind.what, kind.option, list(kind.units))
    told = _known(kind, given) if given is not None else None
    if given is not None and told is None:
        raise BadInput(
            where, f"a {kind.what}, but {kind.option} says {shown(given)}", f"one of {', '.join(kind.units)}"
        )
    if unit:
        factor = _known(kind, unit)
        if factor is None:
            raise BadInput(where, f"unit {shown(unit)}", f"one of {', '.join(kind.units)}")
        if told is not None and told != factor:
            raise BadInput(where, f"unit {shown(unit)}, but {kind.option} says {given}", "one and the same unit")
        return factor
    if told is not None:
        return told
    if not kind.needs_unit:
        return 1.0
    raise UnitUnknown(where, kind.what, kind.option, list(kind.units))


def _numbers(path: Path, rows: list[list[str]], first: int, columns: Sequence[Column], decimal: str) -> Array:
    table = np.empty((len(rows), len(columns)))
    for i, cells in enumerate(rows):
        for k, column in enumerate(columns):
            cell = cells[column.place] if column.place < len(cells) else ""
            value = float(cell.replace(",", ".")) if _is_number(cell, decimal) and len(cell) < 400 else math.nan
            if not abs(value) < HUGE:
                mark = "a point" if decimal == "." else "a comma"
                expected = f"a finite number with {mark} as decimal mark, like those above"
                raise BadInput(
                    f"{path}: row {first + i + 1}, {column.title or column.kind.what}", shown(cell), expected
                )
            table[i, k] = value
    return table


def with_hints(hints: Hints, option: str, unit: str) -> Hints:
    """The same hints, and what a person answered for an option."""
    return replace(hints, **{option.removeprefix("--").replace("-", "_"): unit})
