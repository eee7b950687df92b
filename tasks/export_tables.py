"""Tables of exported tests: which columns hold time, motion and load, their units, and the header block above.

Motion is a displacement or a length ratio, load is a force or, where the reader is told its unit, a stress.
"""

import csv
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tasks.measurements import HUGE, check_text
from tasks.problems import BadInput, shown

MAX_EXPORT_BYTES = 512 * 2**20
MM = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "in": 25.4}
_N = {"n": 1.0, "kn": 1000.0, "mn": 1e-3, "lbf": 4.4482216152605, "gf": 9.80665e-3, "kgf": 9.80665}
_S = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0}
_MPA = {"pa": 1e-6, "kpa": 1e-3, "mpa": 1.0, "n/mm2": 1.0, "n/mm^2": 1.0}
_RATIO = {"1": 1.0, "-": 1.0, "mm/mm": 1.0, "m/m": 1.0, "l/l0": 1.0, "%": 0.01}
_SLIPS = {"mn": ("mN",), "mpa": ("MPa", "Mpa", "mpa")}  # a meganewton is no millinewton, nor is a mPa a MPa
SPREADS = ("sd", "std", "se", "sem", "standard deviation", "standard error")

Array = np.ndarray[Any, np.dtype[Any]]
Rows = list[list[str]]


@dataclass(frozen=True)
class Quantity:
    """What a column holds: the names it may have, lower case, and its units with their factors to s, mm, N, MPa or 1.

    ``option`` names the option that gives the unit where the export does not; ``bare``: it needs none.
    """

    name: str
    titles: tuple[str, ...]
    units: Mapping[str, float]
    option: str = ""
    bare: bool = False


TIME = Quantity("time", ("time",), _S, "--time")
DISPLACEMENT = Quantity("displacement", ("extension", "displacement", "tensile extension", "tensile displacement"), MM)
RATIO = Quantity("length ratio", ("l/l0", "l", "stretch", "stretch ratio", "length ratio", "λ"), _RATIO, bare=True)
FORCE = Quantity("force", ("load", "force", "f"), _N)
STRESS = Quantity("stress", ("stress", "tensile stress", "nominal stress", "tension", *FORCE.titles), _MPA, "--stress")


@dataclass(frozen=True, eq=False)
class Table:
    """``numbers`` ``[t, 3]``: time (s), ``motion`` (mm, or 1) and ``load`` (N, or MPa), from row ``first`` of the file.

    ``block``: the cells behind each name of the header block, lower case; ``spreads``: names of columns with the spread
    of a mean, which are not read.
    """

    numbers: Array
    motion: Quantity
    load: Quantity
    first: int
    block: Mapping[str, list[str]]
    spreads: tuple[str, ...]


def read_table(path: Path, *, time: str | None = None, stress: str | None = None) -> Table:
    """The table of an export. ``stress``: the load is a stress of this unit; ``time``: its unit where none is given.

    Raises :class:`BadInput` naming the file and, where there is one, row and column.
    """
    check_text(path, MAX_EXPORT_BYTES)
    text = decoded(path)
    delimiter = ";" if text.count(";") > text.count(",") else ","
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error as error:
        raise BadInput(path, f"not a CSV file ({error})", "an Instron-style export") from None
    load = FORCE if stress is None else STRESS
    at = next((i for i, row in enumerate(rows) if _columns(row, load) is not None), None)
    if at is None:
        if stress is not None:
            raise BadInput(path, "no row with Time, Stretch and Stress", "columns such as Time, L/L0 and F")
        expected = "an Instron-style export with these columns (Stretch for Extension, a stress by --stress kPa)"
        raise BadInput(path, "no row with Time, Extension and Load", expected)
    columns = _columns(rows[at], load)
    assert columns is not None
    given = {TIME.name: time, STRESS.name: stress}
    factors = [_factor(path, at, rows, column, what, given.get(what.name)) for what, column in columns]
    first = at + 2 if _units_below(rows, at) else at + 1
    numbers = _numbers(path, rows, first, columns, delimiter) * factors
    if len(numbers) < 3:
        raise BadInput(path, f"{len(numbers)} rows of numbers", "at least 3")
    spreads = tuple(cell.strip() for cell, title in zip(rows[at], _titles(rows[at]), strict=True) if title in SPREADS)
    return Table(numbers, columns[1][0], load, first + 1, block_of(rows[:at]), spreads)


def decoded(path: Path) -> str:
    content = path.read_bytes()
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise BadInput(path, "neither UTF-8 nor Windows text", "a text export")


def _titles(row: list[str]) -> list[str]:
    return [re.sub(r"\s*[(\[].*", "", cell, flags=re.DOTALL).strip().lower() for cell in row]


def _columns(row: list[str], load: Quantity) -> list[tuple[Quantity, int]] | None:
    """Time, motion and load with their positions, when this row names them; a displacement goes before a ratio."""
    titles = _titles(row)
    found = []
    for wanted in ((TIME,), (DISPLACEMENT, RATIO), (load,)):
        places = [(what, titles.index(name)) for what in wanted for name in what.titles if name in titles]
        if not places:
            return None
        found.append(places[0])
    return found


def _units_below(rows: Rows, at: int) -> list[str]:
    """The cells of a row of units below the titles; none when there is no such row."""
    cells = rows[at + 1] if at + 1 < len(rows) else []
    filled = [cell.strip() for cell in cells if cell.strip()]
    return cells if filled and all(re.fullmatch(r"[(\[].*[)\]]", cell) for cell in filled) else []


def _factor(path: Path, at: int, rows: Rows, column: int, what: Quantity, given: str | None) -> float:
    """From the unit of a column to ours: in brackets behind its title or in the row below, else the one ``given``."""
    below = _units_below(rows, at)
    where = f"{path}: row {at + 1}, {what.name}"
    units = ", ".join(what.units)
    for cell in (rows[at][column], below[column] if column < len(below) else ""):
        match = re.search(r"[(\[]\s*([^)\]]+?)\s*[)\]]", cell)
        if match:
            unit = match.group(1)
            factor = what.units.get(unit.lower())
            if factor is None or unit not in _SLIPS.get(unit.lower(), (unit,)):
                raise BadInput(where, f"unit {shown(unit)}", f"one of {units}")
            if given is not None and what.units[given.lower()] != factor:
                raise BadInput(where, f"unit {shown(unit)}, but {what.option} says {given}", "one and the same unit")
            return factor
    if given is not None:
        return what.units[given.lower()]
    if what.bare:
        return 1.0
    option = f", or {what.option}" if what.option else ""
    raise BadInput(where, "no unit", f"one of {units} in brackets{option}")


def _numbers(path: Path, rows: Rows, first: int, columns: Sequence[tuple[Quantity, int]], delimiter: str) -> Array:
    end = len(rows)
    while end > first and not any(cell.strip() for cell in rows[end - 1]):
        end -= 1
    table = np.empty((end - first, len(columns)))
    for i in range(first, end):
        for k, (what, column) in enumerate(columns):
            cell = rows[i][column].strip() if column < len(rows[i]) else ""
            number = cell.replace(",", ".") if delimiter == ";" else cell
            try:
                value = float(number) if "_" not in number else math.nan
            except ValueError:
                value = math.nan
            if not abs(value) < HUGE:
                raise BadInput(f"{path}: row {i + 1}, {what.name}", shown(cell), "a finite number")
            table[i - first, k] = value
    return table


def block_of(rows: Rows) -> dict[str, list[str]]:
    """The header block: 'Specimen properties : Length,"14.33",mm' becomes length: ["14.33", "mm"]."""
    return {row[0].rpartition(":")[2].strip().lower(): [cell.strip() for cell in row[1:]] for row in rows if row}
