"""Spreadsheets (.xlsx, .xlsm, .xlsb, .xls, .ods): the cells of their sheets as texts."""

import datetime
import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput
from sinew.runner.files import read_input

SUFFIXES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
MAX_BYTES = 64 * 2**20
MAX_UNPACKED_BYTES = 512 * 2**20


def is_sheet(path: Path) -> bool:
    """Whether a file is a spreadsheet, by its name."""
    return path.suffix.lower() in SUFFIXES


def read_sheets(path: Path) -> Iterator[tuple[str, list[tuple[str, ...]]]]:
    """Name and rows of each sheet. Numbers are written with a point; dates as ISO 8601; empty cells are empty texts.

    Raises :class:`BadInput` for files that are too large, locked or broken.
    """
    from python_calamine import CalamineError, CalamineWorkbook  # loaded where a spreadsheet is read only

    content = io.BytesIO(read_input(path, MAX_BYTES, f"a spreadsheet of at most {MAX_BYTES / 2**20:,.0f} MB"))
    _refuse_large_archive(path, content)
    try:
        with CalamineWorkbook.from_filelike(content) as workbook:
            for name in workbook.sheet_names:
                rows = workbook.get_sheet_by_name(name).to_python(skip_empty_area=False)
                yield name, [tuple(_text(cell) for cell in row) for row in rows]
    except (CalamineError, OSError, ValueError) as error:
        raise BadInput(path, f"not a spreadsheet that can be read ({error})", "a file without a password") from None


def _refuse_large_archive(path: Path, content: io.BytesIO) -> None:
    """Spreadsheets are archives, except for .xls; one of a few kilobytes can hold gigabytes."""
    try:
        with zipfile.ZipFile(content) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except zipfile.BadZipFile:
        size = 0
    content.seek(0)
    if size > MAX_UNPACKED_BYTES:
        expected = f"at most {MAX_UNPACKED_BYTES / 2**20:,.0f} MB"
        raise BadInput(path, f"{size / 2**20:,.0f} MB when unpacked", expected)


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.date | datetime.time):
        return cell.isoformat()
    return str(cell).strip()
