"""The process that reads a spreadsheet: its bytes on standard input become lines of JSON on standard output.

A spreadsheet of a kilobyte may have two cells so far apart that the rows between them fill the memory, and the library
that reads it then ends its process. So it has one of its own, with limits. Nothing of sinew is imported here.

Each sheet is a line with its name, and a line for each row with a list of its texts. A last line is ``null`` if all is
there, or an object that says what is ``wrong`` and what is ``expected``.

Cells that are formatted as percent hold fractions. They are written as they are shown, 9.97 for 0.0997, and the title
above them gets the unit ``[%]`` where it has none. Numbers that are shown in thousands, or with a unit that the title
does not have, stay as they are, and a person is asked for their unit. Files of the kinds .xls and .xlsb do not tell it
here.
"""

import datetime
import io
import json
import posixpath
import re
import resource
import sys
import zipfile
from collections.abc import Iterator
from typing import IO, Any
from xml.etree.ElementTree import Element

MEMORY_BYTES = 2**31  # of the process
SECONDS = 60  # of a processor; a spreadsheet of the largest size takes less
MAX_SHEETS = 2_000
MAX_CELLS = 4 * 10**6  # of all sheets, with those that are empty
MAX_BYTES = 2**26  # of all texts: a text that is stored once may stand in every cell
EXPECTED = f"at most {MAX_CELLS:,} cells and {MAX_BYTES:,} bytes of text"

MEMORY = f"takes more than {MEMORY_BYTES / 2**30:g} GB"
TIME = f"takes more than {SECONDS} s of a processor"
AS_SAVED = "a spreadsheet as Excel or LibreOffice saves it, without a password"
SMALLER = "a smaller spreadsheet, or the table as CSV"
OF_DOCUMENTS = "{urn:oasis:names:tc:opendocument:xmlns:"  # begin of names that an open document gives a meaning
NO_SIGN = re.compile(r'"[^"]*"|\\.|_.|\*.|\[[^\]]*\]')  # in a number format: shown as it is, or not at all
CONDITION = re.compile(r"\[[<>=]")  # of a section of a format
PERCENT_FORMATS = {9, 10}  # of Excel itself
TITLES_WITHIN = 4  # rows above numbers in which their titles stand
LARGEST = 1e100
UNIT = re.compile(r"\s*[(\[][^)\]]*[)\]]\s*$")  # of a title
IN_PERCENT = re.compile(r"[(\[]\s*%\s*[)\]]|%\s*$|^\s*%")  # a title with this unit
PARTLY = "partly percent"  # the unit of numbers of which only some are formatted as percent
SCALED = "shown in thousands"  # the unit of numbers that are shown divided by a thousand, or by more
PERCENT, THOUSANDS, UNCLEAR = "percent", "thousands", "unclear"  # how a format shows all numbers
WITH = "shown with "  # so it does, with the unit behind this
SHOWN_TEXT = re.compile(r'"([^"]*)"|\\(.)|([0#?.,%]|General|_.|\*.|\[[^\]]*\])')  # parts of a number format
COLUMN = 3  # numbers below each other that are a column
HAS_UNIT = re.compile(r"[^\W\d_]|[%°]")  # a letter
IN_THOUSANDS = re.compile(r"[0#?](,+)(?![0#?,])")  # in a number format: each comma divides by a thousand
REFERENCE = re.compile(r"([A-Z]{1,3})([0-9]{1,7})")  # of a cell
Cells = dict[int, dict[int, str]]  # by row and column, both from 0: how the number is shown


class TooMuch(Exception):
    """More than can be read: of what, and what is expected."""

    def __init__(self, words: str, expected: str = EXPECTED) -> None:
        super().__init__(words)
        self.expected = expected


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.timedelta) and cell >= datetime.timedelta(0):
        minutes, seconds = divmod(cell.seconds, 60)
        part = f".{cell.microseconds:06d}" if cell.microseconds else ""
        return f"{24 * cell.days + minutes // 60}:{minutes % 60:02d}:{seconds:02d}{part}"
    if isinstance(cell, datetime.date | datetime.time):
        return cell.isoformat()
    return str(cell).strip()


def lines_of(content: bytes) -> Iterator[str | list[str]]:
    """The name of each sheet, followed by its rows. Raises what calamine does, and :class:`TooMuch`."""
    from python_calamine import CalamineWorkbook  # in this process only

    cells = size = 0
    formatted = _formatted(content)
    with CalamineWorkbook.from_filelike(io.BytesIO(content)) as workbook:
        if len(workbook.sheet_names) > MAX_SHEETS:
            raise TooMuch(f"{len(workbook.sheet_names):,} sheets", f"at most {MAX_SHEETS:,} sheets")
        if len(set(workbook.sheet_names)) < len(workbook.sheet_names):
            raise TooMuch("two sheets with the same name", "another name for each")
        for name in workbook.sheet_names:
            yield str(name)
            sheet = workbook.get_sheet_by_name(name)
            cells += (sheet.total_height + 1) * (sheet.total_width + 1)  # of the last row and column, from 0
            if cells > MAX_CELLS:
                raise TooMuch(f"{cells:,} cells up to the last one that is not empty")
            for row in _with_midnights(_as_shown(sheet.to_python(skip_empty_area=False), formatted.get(str(name), {}))):
                texts = list(map(_text, row))
                size += sum(len(text.encode("utf-8", "replace")) for text in texts)
                if size > MAX_BYTES:
                    raise TooMuch(f"more than {MAX_BYTES:,} bytes of text")
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
    get a unit that nobody knows, so that a person is asked for it.
    """
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
    if THOUSANDS in ways:
        return SCALED
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


def _shown(code: str) -> str | None:
    """How a format shows numbers: ``PERCENT``, ``THOUSANDS``, ``UNCLEAR`` where it differs or is another; None: as is.

    Where it writes units behind them, ``WITH`` these. The third section is of zero, unless they have conditions.
    """
    count = 3 if CONDITION.search(code) else 2
    sections = [part for part in NO_SIGN.sub("", code).split(";")[:count] if re.search(r"[0#?]|General", part)]
    if any(IN_THOUSANDS.search(part) for part in sections):
        return THOUSANDS
    percents = {part.count("%") for part in sections}
    if percents <= {0}:
        units = sorted({unit for part in code.split(";")[:count] if (unit := _unit(part))})
        return WITH + " or ".join(units) if units else None
    return PERCENT if percents == {1} else UNCLEAR


def _unit(section: str) -> str:
    """The unit that a section of a format writes behind numbers, or nothing."""
    texts, numbers = [""], False
    for quoted, escaped, sign in SHOWN_TEXT.findall(section):
        numbers = numbers or sign in ("0", "#", "?", "General")
        texts.append((quoted or escaped) if numbers else "")
    unit = "".join(texts).strip(" ()[]")
    return unit[:20] if HAS_UNIT.search(unit) else ""


def _formatted(content: bytes) -> dict[str, Cells]:
    """Cells that are shown as other numbers, by the name of the sheet; of a file that is no archive, none."""
    if not content.startswith(b"PK"):
        return {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name.lower(): name for name in archive.namelist()}  # as whoever reads the numbers finds them
        if len(members) < len(archive.namelist()):
            raise TooMuch("two members with the same name", "another name for each")
        if "content.xml" in members:
            return _formatted_of_ods(archive)
        if "xl/workbook.xml" in members:
            return _formatted_of_xlsx(archive, members)
    return {}


def _formatted_of_xlsx(archive: zipfile.ZipFile, members: dict[str, str]) -> dict[str, Cells]:
    if "xl/_rels/workbook.xml.rels" not in members:
        raise TooMuch("its sheets are not found", "a spreadsheet as Excel saves it")
    relations = _elements(archive, members["xl/_rels/workbook.xml.rels"], "Relationship")
    targets = {
        one.get("Id"): posixpath.normpath(posixpath.join("/xl", one.get("Target", ""))).lstrip("/").lower()
        for one in relations
    }
    of_styles = [targets[one.get("Id")] for one in relations if one.get("Type", "").endswith("/styles")]
    style_path = next((path for path in (*of_styles, "xl/styles.xml") if path in members), None)
    if style_path is None and of_styles:
        raise TooMuch("the formats of its cells are not found", "a spreadsheet as Excel saves it")
    styles = _scaling_styles(archive, members[style_path]) if style_path else {}
    if not styles:
        return {}
    found = {}
    for sheet in _elements(archive, members["xl/workbook.xml"], "sheet"):
        link = next((value for key, value in sheet.attrib.items() if _local(key) == "id"), None)
        if (path := targets.get(link)) in members:
            found[sheet.get("name", "")] = _formatted_of_sheet(archive, members[str(path)], styles)
    return found


def _scaling_styles(archive: zipfile.ZipFile, path: str) -> dict[int, str]:
    """How styles of cells, by their numbers, show numbers, where it is not as they are."""
    formats: dict[int, str | None] = dict.fromkeys(PERCENT_FORMATS, PERCENT)
    styles: dict[int, str] = {}
    inside, count = False, 0
    with archive.open(path) as file:
        for event, element in _parsed(file):
            name = _local(element.tag)
            if name == "cellXfs":
                inside = event == "start"
            elif event == "end" and name == "numFmt":
                formats[int(element.get("numFmtId", "0"))] = _shown(element.get("formatCode", ""))
            elif event == "end" and name == "xf" and inside:
                if (shown := formats.get(int(element.get("numFmtId", "0")))) is not None:
                    styles[count] = shown
                count += 1
    return styles


def _formatted_of_sheet(archive: zipfile.ZipFile, path: str, styles: dict[int, str]) -> Cells:
    found: Cells = {}
    row, column = -1, -1
    before = (-1, -1)
    with archive.open(path) as file:
        for event, element in _parsed(file):
            name = _local(element.tag)
            if event == "start" and name == "row":
                row, column = int(element.get("r", str(row + 2))) - 1, -1
            elif event == "start" and name == "c":
                row, column = _place(element.get("r", "")) if element.get("r") else (row, column + 1)
                if (row, column) <= before:
                    raise TooMuch(f"two cells in row {row + 1}, column {column + 1}, or one out of order", "one")
                before = row, column
                if (style := int(element.get("s", "0"))) in styles:
                    found.setdefault(row, {})[column] = styles[style]
            elif event == "end" and name in ("row", "c"):
                element.clear()
    return found


def _place(reference: str) -> tuple[int, int]:
    """Row and column, both from 0, of a cell such as ``AB12``."""
    found = REFERENCE.fullmatch(reference)
    if found is None:
        raise ValueError(f"a cell called {reference[:20]}")
    column = 0
    for letter in found[1]:
        column = 26 * column + ord(letter) - 64
    return int(found[2]) - 1, column - 1


def _formatted_of_ods(archive: zipfile.ZipFile) -> dict[str, Cells]:
    found: dict[str, Cells] = {}
    cells: Cells = {}
    row = column = depth = 0
    with archive.open("content.xml") as file:
        for event, element in _parsed(file):
            name = _local(element.tag)
            about = {_local(key): value for key, value in element.attrib.items() if key.startswith(OF_DOCUMENTS)}
            if name == "number" and float(about.get("display-factor", "1")) != 1.0:
                raise TooMuch("numbers that are shown divided by a factor", "numbers that are shown as they are")
            if name == "table":
                depth += 1 if event == "start" else -1
                if event == "start" and depth == 1:  # not one within a cell
                    cells = found.setdefault(about.get("name", ""), {})
                    row = 0
            elif depth > 1:
                continue
            elif event == "start" and name == "table-row":
                column = 0
            elif event == "end" and name in ("table-cell", "covered-table-cell"):
                many = int(about.get("number-columns-repeated", "1"))
                if about.get("value-type") == "percentage":
                    if many > MAX_CELLS:
                        raise TooMuch(f"{many:,} cells that are the same")
                    cells.setdefault(row, {}).update(dict.fromkeys(range(column, column + many), PERCENT))
                column += many
                element.clear()
            elif event == "end" and name == "table-row":
                many = int(about.get("number-rows-repeated", "1"))
                if row in cells and many > 1:
                    if many * len(cells[row]) > MAX_CELLS:
                        raise TooMuch(f"{many:,} rows that are the same")
                    cells.update((row + i, cells[row]) for i in range(1, many))
                row += many
                element.clear()
    return found


def _elements(archive: zipfile.ZipFile, path: str, name: str) -> list[Element]:
    with archive.open(path) as file:
        return [element for event, element in _parsed(file) if event == "end" and _local(element.tag) == name]


def _parsed(file: IO[bytes]) -> Iterator[tuple[str, Element]]:
    """The elements of a member, each where it begins and where it ends."""
    from defusedxml.ElementTree import iterparse  # in this process only

    yield from iterparse(file, ("start", "end"), forbid_dtd=True)


def _local(name: str) -> str:
    """A name of XML without its namespace."""
    return name.rpartition("}")[2]


def main() -> None:
    """Read one spreadsheet."""
    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_AS, MEMORY_BYTES), (resource.RLIMIT_CPU, SECONDS)):
        hard = resource.getrlimit(kind)[1]
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)  # a limit of the shell may be lower
        resource.setrlimit(kind, (most, most))
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
