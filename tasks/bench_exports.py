"""Raw exports of testing machines (Instron Bluehill CSV) to curves: quoted numbers, a header block, a row of units."""

import csv
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tasks.measurements import HUGE, NAME, check_text, refuse_duplicates
from tasks.model import Curve, Protocol, Specimen
from tasks.problems import BadInput, shown

MAX_EXPORT_BYTES = 512 * 2**20
_MM = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "µm": 1e-3, "μm": 1e-3, "in": 25.4}
_N = {"n": 1.0, "kn": 1000.0, "mn": 1e-3, "lbf": 4.4482216152605, "gf": 9.80665e-3, "kgf": 9.80665}
_S = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0}
_COLUMNS = (
    ("time", ("time",), _S),
    ("displacement", ("extension", "displacement", "tensile extension", "tensile displacement"), _MM),
    ("force", ("load", "force"), _N),
)


def read_export(path: Path, *, protocol: str | None = None, name: str | None = None, tare: bool = False) -> Specimen:
    """One exported test as a specimen with one curve.

    The header block must give ``Length`` and either ``Diameter`` (a round bar becomes a square one of equal area) or
    ``Width`` and ``Thickness``. The protocol is called ``relaxation`` when the block speaks of a hold, else ``test``.
    ``tare`` subtracts the first force. Time starts at 0. Raises :class:`BadInput` naming the file and row.
    """
    check_text(path, MAX_EXPORT_BYTES)
    text = _decoded(path)
    delimiter = ";" if text.count(";") > text.count(",") else ","
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error as error:
        raise BadInput(path, f"not a CSV file ({error})", "an Instron-style export") from None
    at = next((i for i, row in enumerate(rows) if _columns(row) is not None), None)
    if at is None:
        raise BadInput(path, "no row with Time, Extension and Load", "an Instron-style export with these columns")
    columns = _columns(rows[at])
    assert columns is not None
    factors = [_factor(path, at, rows, column, what) for column, what in zip(columns, _COLUMNS, strict=True)]
    first = at + 2 if at + 1 < len(rows) and _is_units(rows[at + 1]) else at + 1
    numbers = _numbers(path, rows, first, columns, delimiter) * factors
    if len(numbers) < 3:
        raise BadInput(path, f"{len(numbers)} rows of numbers", "at least 3")
    block = _block(rows[:at])
    length, width, thickness = _geometry(path, block)
    time_s, displacement, force = numbers.T
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        row = first + int(back[0]) + 2
        raise BadInput(
            f"{path}: row {row}, time", f"{time_s[back[0] + 1]:g} s after {time_s[back[0]]:g} s", "increasing times"
        )
    if (displacement <= -length).any():
        raise BadInput(path, "an extension that shortens the gauge to nothing", "extensions in the unit that it names")
    held = any("hold" in key for key in block)
    history = Protocol(protocol or ("relaxation" if held else "test"), time_s - time_s[0], displacement)
    curve = Curve(history, force - force[0] if tare else force)
    return Specimen(name or re.sub(r"[^A-Za-z0-9_.+-]+", "_", path.stem), length, width, thickness, (curve,))


def read_exports(paths: Sequence[Path], *, protocol: str | None = None, tare: bool = False) -> list[Specimen]:
    """Several exports, each a specimen named after its file. Raises :class:`BadInput` for two of one name."""
    if protocol is not None and not NAME.fullmatch(protocol):
        raise BadInput("--protocol", shown(protocol), "letters, digits, '_', '-', '+' and '.'")
    specimens = [read_export(path, protocol=protocol, tare=tare) for path in paths]
    for path, specimen in zip(paths, specimens, strict=True):
        if not NAME.fullmatch(specimen.name):
            raise BadInput(path, "a name that cannot be used for a specimen", "a letter or digit in front")
    refuse_duplicates(specimens, {specimen.name: path for path, specimen in zip(paths, specimens, strict=True)})
    return specimens


def _decoded(path: Path) -> str:
    content = path.read_bytes()
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise BadInput(path, "neither UTF-8 nor Windows text", "a text export")


def _columns(row: list[str]) -> list[int] | None:
    """Positions of time, displacement and force when this row names them."""
    names = [re.sub(r"\s*[(\[].*", "", cell).strip().lower() for cell in row]
    found = []
    for _, accepted, _ in _COLUMNS:
        place = next((names.index(name) for name in accepted if name in names), None)
        if place is None:
            return None
        found.append(place)
    return found


def _is_units(row: list[str]) -> bool:
    cells = [cell.strip() for cell in row if cell.strip()]
    return bool(cells) and all(re.fullmatch(r"[(\[].*[)\]]", cell) for cell in cells)


def _factor(
    path: Path, at: int, rows: list[list[str]], column: int, what: tuple[str, tuple[str, ...], dict[str, float]]
) -> float:
    """From the export's unit to mm, N or s; the unit stands in the name's brackets or in the row below."""
    title, _, units = what
    below = (
        rows[at + 1][column] if at + 1 < len(rows) and _is_units(rows[at + 1]) and column < len(rows[at + 1]) else ""
    )
    for cell in (rows[at][column], below):
        match = re.search(r"[(\[]\s*([^)\]]+?)\s*[)\]]", cell)
        if match:
            unit = match.group(1)
            if unit.lower() == "mn" and unit != "mN":  # a meganewton is not a millinewton
                break
            if unit.lower() in units:
                return units[unit.lower()]
            raise BadInput(f"{path}: row {at + 1}, {title}", f"unit {shown(unit)}", f"one of {', '.join(units)}")
    raise BadInput(f"{path}: row {at + 1}, {title}", "no unit", f"one of {', '.join(units)} in brackets")


def _numbers(path: Path, rows: list[list[str]], first: int, columns: list[int], delimiter: str) -> np.ndarray:
    end = len(rows)
    while end > first and not any(cell.strip() for cell in rows[end - 1]):
        end -= 1
    table = np.empty((end - first, len(columns)))
    for i in range(first, end):
        for k, column in enumerate(columns):
            cell = rows[i][column].strip() if column < len(rows[i]) else ""
            number = cell.replace(",", ".") if delimiter == ";" else cell
            try:
                value = float(number) if "_" not in number else math.nan
            except ValueError:
                value = math.nan
            if not abs(value) < HUGE:
                raise BadInput(f"{path}: row {i + 1}, {_COLUMNS[k][0]}", shown(cell), "a finite number")
            table[i - first, k] = value
    return table


def _block(rows: list[list[str]]) -> dict[str, list[str]]:
    """The header block: 'Specimen properties : Length,"14.33",mm' becomes length: ["14.33", "mm"]."""
    return {row[0].rpartition(":")[2].strip().lower(): [cell.strip() for cell in row[1:]] for row in rows if row}


def _geometry(path: Path, block: dict[str, list[str]]) -> tuple[float, float, float]:
    def size(key: str) -> float:
        if key not in block:
            raise BadInput(f"{path}: {key.capitalize()}", "missing in the header block", "a length with its unit")
        cells = block[key]
        try:
            value = float(cells[0].replace(",", ".")) * _MM[cells[1].lower() if len(cells) > 1 else "mm"]
        except (ValueError, KeyError, IndexError):
            raise BadInput(
                f"{path}: {key.capitalize()}", shown(" ".join(cells)), "a number and a unit such as mm"
            ) from None
        if not 0 < value < 1e4:
            raise BadInput(f"{path}: {key.capitalize()}", f"{value:g} mm", "above 0 and below 10000 mm")
        return value

    length = size("length")
    if "diameter" in block:
        side = round(size("diameter") * math.sqrt(math.pi) / 2, 9)
        return length, side, side
    return length, size("width"), size("thickness")
