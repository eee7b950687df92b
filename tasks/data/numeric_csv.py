"""CSV files with a header that is known beforehand and nothing but finite numbers below it.

Such files are read strictly: whatever is wrong with a number is reported with its row and column.
"""

import csv
import math
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.text import MAX_TEXT_BYTES, check_text

MAX_ROWS = 4_100_000  # ends of lines, of which Windows writes two for each
LONGEST_HEADER = 120_000  # characters: a thousand names of a hundred; below what Python's csv takes for a cell
WORDS = b"uUsS"  # in true and false, which pandas takes for 1 and 0, and in no number
Array = np.ndarray[Any, np.dtype[Any]]


def read_numbers(
    path: Path, columns: Sequence[str] | None, *, max_bytes: int = MAX_TEXT_BYTES, further: Sequence[str] = ()
) -> Array:
    """Numbers ``[rows, columns]`` of a CSV file with exactly this header (any header when ``columns`` is None).

    ``further``: columns behind these. Their cells may be empty; such numbers are NaN.
    """
    check_text(path, max_bytes)
    header = read_header(path)
    full = _check_rows(path, len(header))
    if columns is not None and header != [*columns, *further]:
        raise BadInput(f"{path}: row 1", f"header {shown(','.join(header))}", f"{','.join(columns)}")
    empty: Any = {len(header) - number: [""] for number in range(1, len(further) + 1)} if further else []
    try:
        if not full or _cells_of_second_row(path) != len(header):  # pandas makes as many columns as that row has
            raise ValueError
        table = pd.read_csv(
            path, encoding="utf-8-sig", dtype=np.float64, skipinitialspace=True, header=None, skiprows=1,
            keep_default_na=False, skip_blank_lines=False,
            na_values=empty,
        ).to_numpy()  # fmt: skip
        given = len(header) - len(further)
        regular = table.shape[1] == len(header) and np.isfinite(table[:, :given]).all()
        regular = regular and not np.isinf(table).any()
    except (ValueError, pd.errors.ParserError, UnicodeDecodeError):
        regular = False
    if not regular:
        table = _read_carefully(path, header, further)
    if not len(table):
        raise BadInput(path, "holds a header but no numbers", "rows of numbers below the header")
    return table


def read_header(path: Path) -> list[str]:
    """The names in the first row of a CSV file. Raises :class:`BadInput` for a row that is too long."""
    with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
        row = file.readline(LONGEST_HEADER + 1)
    if len(row) > LONGEST_HEADER:
        raise BadInput(f"{path}: row 1", f"more than {LONGEST_HEADER:,} characters", "a row of names")
    return [cell.strip() for cell in next(csv.reader([row]), [])]


def _check_rows(path: Path, columns: int) -> bool:
    """Refuse a row that would fill the memory. Raises :class:`BadInput`.

    Returns whether pandas may read it: all rows behind the first have commas for so many columns, as it fills up those
    that are shorter, and no words that it takes for numbers.
    """
    content = np.fromfile(path, np.uint8)
    breaks = (content == ord("\n")) | (content == ord("\r"))
    if (count := np.count_nonzero(breaks)) > MAX_ROWS:
        raise BadInput(path, f"{count:,} rows", f"at most {MAX_ROWS:,}; every second or tenth row will do")
    ends = np.flatnonzero(breaks)
    lengths = np.diff(ends, prepend=-1, append=content.size)
    if (long := np.flatnonzero(lengths > LONGEST_HEADER)).size:
        row = 1 + int(np.count_nonzero(content[ends[: long[0]]] == ord("\n")))
        raise BadInput(f"{path}: row {row}", f"{lengths[long[0]]:,} characters", f"at most {LONGEST_HEADER:,}")
    starts = np.concatenate([[0], ends + 1])[lengths > 1]
    below = content[starts[1] :] if len(starts) > 1 else content[:0]
    if np.isin(below, np.frombuffer(WORDS, np.uint8)).any():
        return False
    commas = np.add.reduceat((content == ord(",")).view(np.uint8), starts, dtype=np.int32)
    return bool((commas[1:] == columns - 1).all())


def _cells_of_second_row(path: Path) -> int:
    """How many cells the first row of numbers has, as pandas reads it; 0 where there is none."""
    with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.reader(file, skipinitialspace=True)
        try:
            next(reader, None)
            return len(next(reader, []))
        except csv.Error:
            return 0


def _read_carefully(path: Path, header: list[str], further: Sequence[str]) -> Array:
    """Read row by row, so that what is wrong can be named."""
    numbers = array("d")
    blank_at = 0
    with open(path, encoding="utf-8-sig", errors="replace", newline="") as file:
        reader = csv.reader(file)
        try:
            next(reader, None)
            for number, cells in enumerate(reader, start=2):
                if not any(cell.strip() for cell in cells):
                    blank_at = blank_at or number
                    continue  # blank lines are fine at the end only
                if blank_at:
                    raise BadInput(f"{path}: row {blank_at}", "a blank row between rows of numbers", "numbers")
                if len(cells) != len(header):
                    raise BadInput(f"{path}: row {number}", f"{len(cells)} cells", f"{len(header)}, as in the header")
                if (plain := _plain(cells)) is not None:
                    numbers.extend(plain)
                    continue
                named = zip(header, cells, strict=True)
                numbers.extend(
                    math.nan if name in further and not cell.strip() else _number(path, number, name, cell)
                    for name, cell in named
                )
        except csv.Error as error:
            raise BadInput(path, f"not a CSV file ({error})", "comma-separated numbers") from None
    return np.array(numbers).reshape(-1, len(header)) if numbers else np.empty((0, len(header)))


def _plain(cells: list[str]) -> list[float] | None:
    """The numbers of a row, None where anything in it must be looked at."""
    try:
        found = list(map(float, cells))
    except ValueError:
        return None
    return found if all(map(math.isfinite, found)) and "_" not in "".join(cells) else None


def _number(path: Path, row: int, column: str, cell: str) -> float:
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadInput(f"{path}: row {row}, {column}", f"{shown(cell.strip())}", "a finite number such as 1.25")
    return value
