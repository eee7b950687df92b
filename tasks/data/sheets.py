"""Spreadsheets (.xlsx, .xlsm, .xlsb, .xls, .ods): the cells of their sheets as texts."""

import io
import json
import os
import re
import signal
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sinew.runner.errors import BadInput, one_line
from sinew.runner.files import NotReadable, in_megabytes, open_regular, read_input
from sinew.runner.limits import command
from sinew.runner.zip_end import directory_of
from sinew.tasks.data import sheet_reading

SUFFIXES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
MAX_BYTES = 64 * 2**20
MAX_UNPACKED_BYTES = 512 * 2**20
MAX_MEMBERS, MAX_LIST_BYTES = 20_000, 2**22  # files of an archive, and the list of them
FIRST_BYTES = 4096
_NO_TEXT = re.compile(rb"[\x00-\x08\x0e-\x1f]")
WALL_S = 600.0  # of the process that reads, whose processor time is limited as well


def is_sheet(path: Path) -> bool:
    """Whether a file is a spreadsheet, by its name; LabVIEW and others write tables of text as .xls."""
    suffix = path.suffix.lower()
    return suffix in SUFFIXES and not (suffix == ".xls" and _is_text(path))


def _is_text(path: Path) -> bool:
    """Whether a file begins as a text, and not as a web page either, which some programs write as .xls."""
    if not path.is_file():
        return False
    try:
        with open(open_regular(path, os.O_RDONLY), "rb") as file:
            start = file.read(FIRST_BYTES)
    except (OSError, NotReadable):
        return False  # whoever reads it says why
    return bool(start) and not start.lstrip().startswith(b"<") and not _NO_TEXT.search(start)


@dataclass(frozen=True)
class Hidden:
    """What of a sheet is not shown: all of it (``sheet``), or its ``rows`` and ``columns`` by their numbers, from 1."""

    sheet: bool = False
    rows: frozenset[int] = frozenset()
    columns: frozenset[int] = frozenset()


NOTHING_HIDDEN = Hidden()


@dataclass(frozen=True)
class Sheet:
    """A sheet of a spreadsheet: the texts of its rows, and what of it is hidden."""

    name: str
    rows: list[tuple[str, ...]] = field(default_factory=list)
    hidden: Hidden = NOTHING_HIDDEN


def read_sheets(path: Path) -> Iterator[Sheet]:
    """The sheets. Numbers are written with a point; dates as ISO 8601; empty cells are empty texts.

    Another process reads them, with bounds for time and memory. Raises :class:`BadInput` for files that are too large,
    locked or broken.
    """
    content = read_input(path, MAX_BYTES, f"a spreadsheet of at most {MAX_BYTES / 2**20:,.0f} MB")
    _refuse_large_archive(path, content)
    with tempfile.TemporaryFile() as lines:  # on the disk, as they take as much again as the texts
        try:
            done = subprocess.run(command(sheet_reading.__name__), input=content, stdout=lines,
                                  stderr=subprocess.DEVNULL, timeout=WALL_S, check=False)  # fmt: skip
        except subprocess.TimeoutExpired:
            raise BadInput(path, f"takes more than {WALL_S:g} s", sheet_reading.SMALLER) from None
        del content
        lines.seek(0)
        yield from _sheets(path, map(json.loads, lines) if done.returncode == 0 else [{"wrong": _why(done.returncode)}])


def _sheets(path: Path, lines: Iterable[Any]) -> list[Sheet]:
    """The sheets, from the lines of the process. Raises :class:`BadInput` where they do not end well.

    A text that stands in many cells is kept once.
    """
    sheets: list[Sheet] = []
    texts: dict[str, str] = {}
    for line in lines:
        if isinstance(line, dict) and "sheet" in line:
            rows, columns = (frozenset(line[f"hidden_{what}"]) for what in ("rows", "columns"))
            sheets.append(Sheet(line["sheet"], hidden=Hidden(line["hidden"], rows, columns)))
        elif isinstance(line, list):
            sheets[-1].rows.append(tuple(texts.setdefault(text, text) for text in line))
        elif line is not None:
            raise BadInput(path, one_line(line["wrong"]), line.get("expected", sheet_reading.SMALLER))
    return sheets


def _why(returncode: int) -> str:
    """Why the process ended early: the library ends it when there is no memory, and the kernel when its time is up."""
    return sheet_reading.TIME if -returncode in (signal.SIGXCPU, signal.SIGKILL) else sheet_reading.MEMORY


def _refuse_large_archive(path: Path, content: bytes) -> None:
    """Spreadsheets are archives, except for .xls; one of a few kilobytes can hold gigabytes.

    What is no archive, or a damaged one, is left to the process that reads it.
    """
    file = io.BytesIO(content)
    try:
        count, size = directory_of(file)
        if count > MAX_MEMBERS or size > MAX_LIST_BYTES:  # zipfile believes the second number
            raise BadInput(path, f"an archive of {count:,} files", f"at most {MAX_MEMBERS:,}")
        with zipfile.ZipFile(file) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
    except BadInput:
        raise
    except Exception:  # noqa: BLE001 - what zipfile raises for damaged archives is no closed list
        return
    if size > MAX_UNPACKED_BYTES:
        raise BadInput(path, f"{in_megabytes(size)} when unpacked", f"at most {in_megabytes(MAX_UNPACKED_BYTES)}")
