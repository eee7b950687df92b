"""Text files: which ones are refused unread, their encodings, and their lines, cells and numbers."""

import codecs
import csv
import os
import re
from collections.abc import Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.files import NotReadable, in_megabytes, open_regular, read_input
from sinew.tasks.data.quoted import unquoted, unwrapped
from sinew.tasks.data.words import FOREIGN

HUGE = 1e100
LONGEST_NUMBER = 400  # characters
CELLS_AT_A_TIME = 4096  # that are looked at together
LONGEST_LINE = 100_000
MAX_LINES, MAX_CELLS = 500_000, 8_000_000  # each takes memory, however short it is
FOREIGN_CELLS = 5_000_000  # of a text with letters beyond Latin-1, each of whose cells takes more memory
MAX_TEXT_BYTES = 64 * 2**20  # reading takes several times as much memory
BINARY = {".pkl", ".pickle", ".p", ".npy", ".npz", ".joblib", ".dill", ".pt", ".mat"}
SEPARATORS = "\t;,|"
#: Of text that is not UTF-8: that of Western Windows first, which can read nearly every file.
ENCODINGS = ("cp1252", "cp1250", "gb18030", "shift_jis", "big5", "euc_kr")
BY_WORDS = ("cp1251", "koi8_r", "cp1253", "cp1254")  # which can read nearly every file, too: only where words are known
_BYTES_WITH_WORDS = 2**20  # where lines with letters that English has not are looked for, which tell an encoding
_LINES_WITH_WORDS = 50  # the most of them
_QUOTED_LINES = 5  # the most lines of one quoted cell
#: Zeros that fill a cell or the end of a file up, as programs in C leave them; and a zero before anything else.
_PADDING = re.compile(r"(?<!\0)\0++(?=[\t\n\r;,| ]|\Z)")
_ZERO_INSIDE = re.compile(rb"\0[^\0\t\n\r;,| ]")
_CONTROL = re.compile(r"[\x01-\x08\x0e-\x1f]")  # what no text holds
_ZEROS, _OTHER_ZEROS = 0.3, 0.05  # at least, of every second byte of UTF-16; and at most, of the others
_LONGEST_CLOCK = 40  # characters
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
_PLAIN = {
    mark: re.compile(rf"(?:[-+]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][-+]?\d+)?\n)*+")
    for mark in ".,"
}
#: A time of day or since the start, with a date in front or not: 0:42:18.87, 2024-05-03 10:22:33, 1:04:08 PM, 12:55.4.
_CLOCK = re.compile(
    r"(?P<date>\d{4}([-/])\d\d\2\d\d[T ]|\d{1,2}[./]\d{1,2}[./]\d{4} )?"
    r"(?:(?P<hours>\d{1,4}):(?P<minutes>[0-5]\d):(?P<seconds>[0-5]\d(?:[.,]\d+)?)(?P<half> ?[AaPp]\.?[Mm]\.?)?"
    r"|(?P<alone>\d{1,3}):(?P<behind>[0-5]\d[.,]\d+))(?:Z|(?P<zone>[+-]\d\d:?\d\d))?"
)
_NO_BREAK = frozenset("\u00a0\u202f")  # spaces, the second one narrow
_SPACED_THOUSANDS = re.compile(r"(?<=\d)[\u00a0\u202f](?=\d{3}(?!\w))")
_THOUSANDS = {".": re.compile(r"[-+]?\d{1,3}(,\d{3})+\.\d+"), ",": re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d+")}

#: Numbers that groups of three digits may be, with marks between them: 1.100 and 1.100.000, but not 0.500.
_GROUPS = {mark: re.compile(rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+") for mark in ".,"}


TDMS = b"TDSm"  # what a binary file of LabVIEW begins with


def check_text(path: Path, max_bytes: int, *, export: bool = False) -> None:
    """Refuse what cannot be a text file of at most ``max_bytes``, before it is read. Raises :class:`BadInput`.

    ``export``: it may be in UTF-16, or padded with zero bytes.
    """
    if path.suffix.lower() in BINARY:
        raise BadInput(path, "pickled and binary data are never read", "a CSV file")
    try:
        size = os.stat(path).st_size
    except OSError as error:
        raise BadInput(path, (error.strerror or "cannot be read").lower(), "a file") from None
    if not path.is_file():
        raise BadInput(path, "not a regular file", "a text file")
    if size == 0:
        raise BadInput(path, "empty", "a header and numbers")
    if size > max_bytes:
        raise BadInput(path, in_megabytes(size), f"at most {max_bytes / 2**20:,.0f} MB")
    try:
        with open(open_regular(path, os.O_RDONLY), "rb") as file:  # it may have become a pipe, which nobody fills
            start = file.read(4096)
    except NotReadable as problem:
        raise BadInput(path, str(problem), "a text file") from None
    except OSError as error:
        raise BadInput(path, (error.strerror or "cannot be read").lower(), "a readable file") from None
    if start.startswith(TDMS):
        raise BadInput(path, "a TDMS file of LabVIEW", "the same saved as text (.lvm) or as a spreadsheet")
    if b"\0" in start and not (export and (_utf16(start) or not _ZERO_INSIDE.search(start))):
        raise BadInput(path, "not a text file", "text in UTF-8")


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without blank lines at its end.

    Raises :class:`BadInput` for files that are no text, too large, or hold a line of more than ``LONGEST_LINE``
    characters.
    """
    check_text(path, MAX_TEXT_BYTES, export=True)
    # Windows programs write \r\r\n where they convert twice
    lines = [part for line in _decoded(path).split("\n") for part in line.rstrip("\r").split("\r")]
    while lines and is_blank(lines[-1]):
        lines.pop()
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            raise BadInput(f"{path}: row {number}", f"a line of {len(line):,} characters", "a table, row by row")
        if "\0" in line:
            raise BadInput(f"{path}: row {number}", "not text", "a text export")
    if not lines:
        raise BadInput(path, "holds no text", "a header and numbers")
    return lines


def _utf16(content: bytes) -> str | None:
    """The kind of UTF-16 that text has, by its mark, or by the zeros in every second byte of digits; None: another."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    start = content[: min(4096, len(content) // 2 * 2)]
    first, second = start[::2].count(0), start[1::2].count(0)
    for encoding, zeros, others in (("utf-16-le", second, first), ("utf-16-be", first, second)):
        if not zeros or zeros < _ZEROS * len(start) / 2 or others > _OTHER_ZEROS * zeros:
            continue
        return None if _CONTROL.search(start.decode(encoding, errors="replace")) else encoding
    return None


def _decoded(path: Path) -> str:
    content = read_input(path, MAX_TEXT_BYTES, "a text export")
    count = _most_cells(content)
    if max(content.count(b"\n"), content.count(b"\r")) > MAX_LINES or count > MAX_CELLS:
        raise BadInput(path, "too many rows or columns", f"at most {MAX_LINES:,} rows and {MAX_CELLS:,} cells")
    text = _text_of(path, content)
    if count > FOREIGN_CELLS and not text.isascii() and max(text) > "\xff":
        raise BadInput(
            path, f"{count:,} cells, with letters beyond Latin-1", f"at most {FOREIGN_CELLS:,} with such letters"
        )
    return text


def _text_of(path: Path, content: bytes) -> str:
    """The text of a file's bytes, in whatever encoding it is."""
    if (encoding := _utf16(content)) is not None:
        try:
            return _PADDING.sub("", content.decode(encoding))
        except UnicodeDecodeError:
            raise BadInput(path, "not valid UTF-16 text", "a text export") from None
    try:
        return _PADDING.sub("", content.decode("utf-8-sig"))
    except UnicodeDecodeError:
        pass
    for encoding in _encodings(content):
        try:
            return _PADDING.sub("", content.decode(encoding))
        except UnicodeDecodeError:
            continue
    raise BadInput(path, "neither UTF-8 nor Windows text", "a text export")


def _most_cells(content: bytes) -> int:
    """How many cells a text holds at most, whatever separates them: neighbouring spaces are one separator."""
    spaces = np.frombuffer(content, np.uint8) == ord(" ")
    return max(*map(content.count, SEPARATORS.encode()), int(np.count_nonzero(spaces[1:] & ~spaces[:-1])))


def _encodings(content: bytes) -> list[str]:
    """The encodings that text may have which is not UTF-8; those first in which most words of exports stand."""
    start = content[:_BYTES_WITH_WORDS]
    lines = [line for line in re.split(rb"[\r\n]", start) if not line.isascii()][:_LINES_WITH_WORDS]

    def words(encoding: str) -> int:
        text = b"\n".join(lines).decode(encoding, errors="replace").lower()
        return sum(word in text for word in FOREIGN)

    return sorted([*ENCODINGS, *filter(words, BY_WORDS)], key=words, reverse=True)


def is_blank(line: str) -> bool:
    """Whether a line holds nothing but separators."""
    return not line.strip(" \t,;|")


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line, stripped. The separator ``" "`` stands for any number of spaces or tabs.

    No-break spaces that mark thousands go away: ``1 000,35`` of French and Polish programs.
    """
    if not _NO_BREAK.isdisjoint(line):
        line = _SPACED_THOUSANDS.sub("", line)
    if separator == " ":
        return line.split()
    if line and separator not in line and '"' not in line:  # as with most separators that are tried
        return [line.strip()]
    try:
        found = next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return [line]
    return list(map(unquoted if '"' in line else str.strip, found))


def records(lines: list[str]) -> list[tuple[int, str]]:
    """Lines with their numbers (from 1). A quoted cell may hold line breaks: its lines become one."""
    found: list[tuple[int, str]] = []
    at = 0
    while at < len(lines):
        count = 1
        if _opens_a_quote(lines[at]):
            count = next((n for n in range(2, _QUOTED_LINES + 1) if _quotes(lines[at : at + n]) % 2 == 0), 1)
        found.append((at + 1, unwrapped("\n".join(lines[at : at + count]))))
        at += count
    return found


def _opens_a_quote(line: str) -> bool:
    """Whether the last quotation mark of a line stands at the beginning of a cell."""
    before, mark, _ = line.rpartition('"')
    filled = before.rstrip()
    return bool(mark) and (not filled or filled[-1] in SEPARATORS or "\t" in before[len(filled) :])


def _quotes(lines: list[str]) -> int:
    return sum(line.count('"') for line in lines)


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal mark, ``"."`` or ``","``; ``1,367.91`` is one with a point.

    A clock time is a number of seconds, with any mark.
    """
    other = "," if decimal == "." else "."
    if other not in cell and _NUMBER.fullmatch(cell):
        return True
    return bool(_THOUSANDS[decimal].fullmatch(cell)) or is_clock(cell)


def tells_mark(cell: str, decimal: str) -> bool | None:
    """Whether a number shows that ``decimal`` is its decimal mark: ``0.5`` and ``12.25`` do, ``1.100`` may be 1100.

    None for a cell without the mark, which tells nothing.
    """
    if decimal not in cell or is_clock(cell) or not is_number(cell, decimal):
        return None
    return not _GROUPS[decimal].fullmatch(cell)


def is_clock(cell: str) -> bool:
    """Whether a cell is a clock time: hours, minutes and seconds, or minutes and seconds with decimals."""
    return ":" in cell and len(cell) < _LONGEST_CLOCK and _clock(cell) is not None


def _clock(cell: str) -> re.Match[str] | None:
    """The parts of a clock time; None for anything else, such as 13 hours in the morning."""
    found = _CLOCK.fullmatch(cell)
    if found is None or not found["half"]:
        return found
    hours, morning = int(found["hours"]), "a" in found["half"].lower()
    return found if (0 if morning else 1) <= hours <= (12 if morning else 23) else None


def days_after(other: str, cell: str) -> int | None:
    """How many days after the date of one clock time that of another one is; 0 where neither has a date.

    None if one of them is no clock time, if only one has a date, and for two dates that may be read in two ways.
    """
    if not (is_clock(cell) and is_clock(other)):
        return None
    one, two = _clock(other), _clock(cell)
    assert one is not None and two is not None, "is_clock has said so"
    if one["date"] == two["date"]:
        return 0
    try:
        before, after = (date.fromisoformat((found["date"] or "")[:10].replace("/", "-")) for found in (one, two))
        return (after - before).days
    except ValueError:
        return None


def seconds_of(clock: str, *, milliseconds: bool = False) -> float:
    """The seconds of a clock time since midnight (of Greenwich, if it has a zone), or since the start.

    A date does not count. ``milliseconds``: the digits behind the seconds count thousandths, without leading zeros.
    """
    found = _clock(clock)
    assert found is not None, "the caller has asked is_clock"
    minutes, seconds = found["minutes"] or found["alone"], found["seconds"] or found["behind"]
    hours = int(found["hours"] or 0)
    if found["half"]:
        hours = hours % 12 + (12 if "p" in found["half"].lower() else 0)
    whole, _, part = seconds.replace(",", ".").partition(".")
    if milliseconds:
        part = part.zfill(3)
    ahead = 0.0
    if found["zone"]:
        ahead = 3600.0 * int(found["zone"][:3]) + 60.0 * int(found["zone"][0] + found["zone"][-2:])
    return 3600.0 * hours - ahead + 60.0 * int(minutes) + float(f"{whole}.{part}")


def milliseconds_unpadded(clocks: Sequence[str]) -> bool:
    """Whether clock times lack the leading zeros of their milliseconds: 12:58.29, 12:58.203 for 58.029 and 58.203 s.

    So it is if times go back as they stand, and do not if these digits count thousandths.
    """
    found = [_clock(clock) for clock in clocks]
    seconds = [one["seconds"] or one["behind"] for one in found if one is not None]
    digits = {len(each.replace(",", ".").partition(".")[2]) for each in seconds}
    if not {1, 2} & digits or max(digits) != 3:
        return False
    plain, counted = ([seconds_of(clock, milliseconds=either) for clock in clocks] for either in (False, True))
    return any(b < a for a, b in pairwise(plain)) and all(a <= b for a, b in pairwise(counted))


def number(cell: str, decimal: str) -> float | None:
    """The number in a cell; None if it is no finite one below ``HUGE``. A clock time is one of seconds."""
    if len(cell) >= LONGEST_NUMBER or not is_number(cell, decimal):
        return None
    if is_clock(cell):
        return seconds_of(cell)
    value = float(cell.replace("," if decimal == "." else ".", "").replace(",", "."))
    return value if abs(value) < HUGE else None


def numbers(cells: Sequence[str], decimal: str) -> list[float | None]:
    """:func:`number` of each of many cells."""
    found: list[float | None] = []
    for start in range(0, len(cells), CELLS_AT_A_TIME):
        part = cells[start : start + CELLS_AT_A_TIME]
        values = [float(cell) for cell in _with_points(part, decimal)] if are_plain(part, decimal) else []
        usual = values and max(values) < HUGE and min(values) > -HUGE and max(map(len, part)) < LONGEST_NUMBER
        found += values if usual else [number(cell, decimal) for cell in part]
    return found


def are_plain(cells: Sequence[str], decimal: str) -> bool:
    """Whether cells are numbers without marks for thousands, and no clock times: one look at all of them together."""
    joined = "\n".join(cells) + "\n"
    return joined.count("\n") == len(cells) and _PLAIN[decimal].fullmatch(joined) is not None


def _with_points(cells: Sequence[str], decimal: str) -> Sequence[str]:
    return cells if decimal == "." else [cell.replace(decimal, ".") for cell in cells]
