"""The process that reads a spreadsheet: its bytes on standard input become lines of JSON on standard output.

A spreadsheet of a kilobyte may have two cells so far apart that the rows between them fill the memory, and the library
that reads it then ends its process. So it has one of its own, with limits.

Each sheet is a line with its name (``sheet``), whether it is ``hidden``, the numbers of its ``hidden_rows`` and of
its ``hidden_columns``, followed by a line for each row with a list of its texts. A last line is ``null`` if all is
there, or an object that says what is ``wrong`` and what is ``expected``.

Cells that are formatted as percent hold fractions. They are written as they are shown, 9.97 for 0.0997, and the title
above them gets the unit ``[%]`` where it has none. Numbers that are shown in thousands, as others, or with a unit that
the title does not have, stay as they are, and a person is asked for their unit. Errors of formulas are empty cells.
"""

import datetime
import io
import json
import re
import sys
from collections.abc import Iterator
from typing import Any

from sinew.runner.limits import limit
from sinew.tasks.data.number_formats import FAILED, OTHERWISE, PERCENT, THOUSANDS, WITH
from sinew.tasks.data.quoted import unquoted
from sinew.tasks.data.sheet_formats import looks_of
from sinew.tasks.data.sheet_look import MAX_CELLS, Cells, Look, TooMuch

MEMORY_BYTES = 2**31  # of the process
SECONDS = 60  # of a processor; a spreadsheet of the largest size takes less
MAX_SHEETS = 2_000
MAX_BYTES = 2**26  # of all texts: a text that is stored once may stand in every cell
LONGEST_NAME = 300  # of a sheet
MOST_EMPTY = 50_000  # consecutive rows: each takes as much time as one with numbers
EXPECTED = f"at most {MAX_CELLS:,} cells and {MAX_BYTES:,} bytes of text"

MEMORY = f"takes more than {MEMORY_BYTES / 2**30:g} GB"
TIME = f"takes more than {SECONDS} s of a processor"
AS_SAVED = "a spreadsheet as Excel or LibreOffice saves it, without a password"
SMALLER = "a smaller spreadsheet, or the table as CSV"
TITLES_WITHIN = 4  # rows above numbers in which their titles stand
LARGEST = 1e100
UNIT = re.compile(r"\s*[(\[][^)\]]*[)\]]\s*$")  # of a title
IN_PERCENT = re.compile(r"[(\[]\s*%\s*[)\]]|%\s*$|^\s*%")  # a title with this unit
PARTLY = "partly percent"  # the unit of numbers of which only some are formatted as percent
SCALED = "shown in thousands"  # the unit of numbers that are shown divided by a thousand, or by more
CHANGED = "shown as other numbers"  # that of numbers that are shown with another sign or other digits
COLUMN = 3  # numbers below each other that are a column
DURATION = re.compile(r"PT(?:(\d{1,6})H)?(?:(\d{1,6})M)?(?:(\d{1,6}(?:\.\d{1,9})?)S)?")  # in an open document


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.timedelta) and cell >= datetime.timedelta(0):
        minutes, seconds = divmod(cell.seconds, 60)
        part = f".{cell.microseconds:06d}" if cell.microseconds else ""
        return f"{24 * cell.days + minutes // 60}:{minutes % 60:02d}:{seconds:02d}{part}"
    if isinstance(cell, datetime.date | datetime.time):
        return cell.isoformat()
    text = unquoted(str(cell))
    if text.startswith("PT") and len(text) > 2 and (found := DURATION.fullmatch(text)):  # 24 h or more
        h, m, s = (float(part or 0) for part in found.groups())
        return _text(datetime.timedelta(hours=h, minutes=m, seconds=s))
    return text


def lines_of(content: bytes) -> Iterator[dict[str, Any] | list[str]]:
    """What each sheet is called and hides, followed by its rows. Raises what calamine does, and :class:`TooMuch`."""
    from python_calamine import CalamineWorkbook, SheetVisibleEnum  # in this process only

    cells = size = 0
    looks = looks_of(content)
    with CalamineWorkbook.from_filelike(io.BytesIO(content)) as workbook:
        if len(workbook.sheet_names) > MAX_SHEETS:
            raise TooMuch(f"{len(workbook.sheet_names):,} sheets", f"at most {MAX_SHEETS:,} sheets")
        if len(set(workbook.sheet_names)) < len(workbook.sheet_names):
            raise TooMuch("two sheets with the same name", "another name for each")
        visible = {one.name: one.visible == SheetVisibleEnum.Visible for one in workbook.sheets_metadata}
        for name in workbook.sheet_names:
            if len(str(name)) > LONGEST_NAME:
                raise TooMuch(f"a sheet with a name of {len(str(name)):,} characters", f"at most {LONGEST_NAME}")
            look = looks.get(str(name), Look())
            sheet = workbook.get_sheet_by_name(name)
            hidden_rows = sorted(row for row in look.rows if row <= sheet.total_height + 1)
            yield {
                "sheet": str(name),
                "hidden": not visible[name],
                "hidden_rows": hidden_rows,
                "hidden_columns": sorted(column for column in look.columns if column <= sheet.total_width + 1),
            }
            cells += (sheet.total_height + 1) * (sheet.total_width + 1)  # of the last row and column, from 0
            if cells > MAX_CELLS:
                raise TooMuch(f"{cells:,} cells up to the last one that is not empty", EXPECTED)
            empty = 0
            for row in _with_midnights(_as_shown(sheet.to_python(skip_empty_area=False), look.cells)):
                texts = list(map(_text, row))
                empty = 0 if any(texts) else empty + 1
                if empty > MOST_EMPTY:
                    raise TooMuch(f"more than {MOST_EMPTY:,} consecutive empty rows", "a sheet without them")
                size += sum(len(text.encode("utf-8", "replace")) for text in texts)
                if size > MAX_BYTES:
                    raise TooMuch(f"more than {MAX_BYTES:,} bytes of text", EXPECTED)
                yield texts


def _with_midnights(rows: list[list[Any]]) -> Iterator[list[Any]]:
    """Rows in which a date below a date with a time is one, too: at midnight, the library leaves the time out."""
    timed: set[int] = set()
    for row in rows:
        for place, cell in enumerate(row):
            if isinstance(cell, datetime.datetime):
                timed.add(place)
            elif place in timed and isinstance(cell, datetime.date):
                row[place] = datetime.datetime.combine(cell, datetime.time())
        yield row


# ---- cells that are shown as other numbers than they hold


def _as_shown(rows: list[list[Any]], formatted: Cells) -> list[list[Any]]:
    """Rows whose ``formatted`` cells hold the numbers that are shown, with the unit percent in the titles above them.

    A run of numbers of which only some are formatted so, or that are shown in thousands, stays as it is, and its titles
    get a unit that nobody knows, so that a person is asked for it. A number that stands for an error is an empty cell.
    """
    for at, columns in formatted.items():
        for place, way in columns.items():
            if way == FAILED and at < len(rows) and place < len(rows[at]):
                rows[at][place] = ""
    for place in sorted({place for columns in formatted.values() for place in columns}):
        for run in _runs(rows, place):
            ways = {formatted.get(at, {}).get(place) for at in run}
            titles = _titles(rows, run[0], place)
            if ways == {PERCENT}:
                for at in run:
                    rows[at][place] = _in_percent(rows[at][place])
                if titles and not any(IN_PERCENT.search(rows[at][place]) for at in titles):
                    rows[titles[0]][place] = f"{rows[titles[0]][place].strip()} [%]"
            elif ways != {None} and not _as_titled(ways - {None}, [rows[at][place] for at in titles], len(run)):
                unknown = _unknown(ways)
                for at in titles:
                    rows[at][place] = (IN_PERCENT if unknown == PARTLY else UNIT).sub(f" [{unknown}]", rows[at][place])
                if titles and unknown not in rows[titles[0]][place]:
                    rows[titles[0]][place] = f"{rows[titles[0]][place].strip()} [{unknown}]"
    return rows


def _as_titled(ways: set[str | None], titles: list[str], count: int) -> bool:
    """Whether ``count`` numbers are shown with a unit that stands in the titles above them, too, and no other one does.

    So it is for a few numbers, which are no column: a size without a unit is asked about anyway.
    """
    if not all(str(way).startswith(WITH) for way in ways):
        return False
    if count < COLUMN:
        return True
    units = {_plain(str(way).removeprefix(WITH)) for way in ways}
    inside = {_plain(found[0]) for title in titles if (found := UNIT.search(title))}
    alone = {_plain(title) for title in titles} & units
    return len(units) == 1 and units == inside | alone


def _plain(unit: str) -> str:
    """A unit without brackets and spaces."""
    return unit.strip(" ()[]").replace("²", "2")


def _unknown(ways: set[str | None]) -> str:
    """The unit, which nobody knows, of numbers that are not shown as they are."""
    if THOUSANDS in ways or OTHERWISE in ways:
        return SCALED if THOUSANDS in ways else CHANGED
    return next(iter(sorted(way for way in ways if way and way.startswith(WITH))), PARTLY)


def _in_percent(value: float) -> float:
    """A fraction in percent, without the rounding of the product; numbers beyond all sense stay as they are."""
    return float(f"{100.0 * value:.15g}") if abs(value) < LARGEST else value


def _runs(rows: list[list[Any]], place: int) -> Iterator[list[int]]:
    """Rows of the numbers in a column, run by run; a text ends one, an empty cell does not."""
    run: list[int] = []
    for at, row in enumerate(rows):
        cell = row[place] if place < len(row) else ""
        if isinstance(cell, int | float) and not isinstance(cell, bool):
            run.append(at)
        elif run and str(cell).strip():
            yield run
            run = []
    if run:
        yield run


def _titles(rows: list[list[Any]], first: int, place: int) -> list[int]:
    """The rows of the texts right above row ``first`` of a column, from the top; an empty cell may stand between."""
    found: list[int] = []
    at = first - 1
    while at >= 0 and len(found) < 2 and first - at <= TITLES_WITHIN:
        cell = rows[at][place]
        if isinstance(cell, str) and cell.strip():
            found.insert(0, at)
        elif found or str(cell).strip():
            break
        at -= 1
    return found


def main() -> None:
    """Read one spreadsheet."""
    limit(MEMORY_BYTES, SECONDS)
    end: dict[str, str] | None = None
    try:
        for line in lines_of(sys.stdin.buffer.read()):
            _write(line)
    except TooMuch as too_much:
        end = {"wrong": str(too_much), "expected": too_much.expected}
    except MemoryError:
        end = {"wrong": MEMORY, "expected": SMALLER}
    except BaseException as error:  # noqa: BLE001 - the library's panics are no Exception
        why = str(error) or type(error).__name__
        end = {"wrong": f"not a spreadsheet that can be read ({why[:200]})", "expected": AS_SAVED}
    _write(end)


def _write(line: Any) -> None:
    text = json.dumps(line, ensure_ascii=False)  # an escaped character takes six bytes or twelve
    sys.stdout.buffer.write(text.encode("utf-8", "replace") + b"\n")


if __name__ == "__main__":
    main()
