"""The process that reads a spreadsheet: its bytes on standard input become lines of JSON on standard output.

A spreadsheet of a kilobyte may have two cells so far apart that the rows between them fill the memory, and the library
that reads it then ends its process. So it has one of its own, with limits. Nothing of sinew is imported here.

Each sheet is a line with its name, and a line for each row with a list of its texts. A last line is ``null`` if all is
there, or an object that says what is ``wrong`` and what is ``expected``.
"""

import datetime
import io
import json
import resource
import sys
from collections.abc import Iterator
from typing import Any

MEMORY_BYTES = 2**31  # of the process
SECONDS = 60  # of a processor; a spreadsheet of the largest size takes less
MAX_SHEETS = 2_000
MAX_CELLS = 4 * 10**6  # of all sheets, with those that are empty
MAX_BYTES = 2**26  # of all texts: a text that is stored once may stand in every cell
EXPECTED = f"at most {MAX_CELLS:,} cells and {MAX_BYTES:,} bytes of text"

MEMORY = f"takes more than {MEMORY_BYTES / 2**30:g} GB"
TIME = f"takes more than {SECONDS} s of a processor"
SMALLER = "a smaller spreadsheet, or the table as CSV"


class TooMuch(Exception):
    """More than can be read: of what, and what is expected."""

    def __init__(self, words: str, expected: str = EXPECTED) -> None:
        super().__init__(words)
        self.expected = expected


def _text(cell: Any) -> str:
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    if isinstance(cell, datetime.date | datetime.time):
        return cell.isoformat()
    return str(cell).strip()


def lines_of(content: bytes) -> Iterator[str | list[str]]:
    """The name of each sheet, followed by its rows. Raises what calamine does, and :class:`TooMuch`."""
    from python_calamine import CalamineWorkbook  # in this process only

    cells = size = 0
    with CalamineWorkbook.from_filelike(io.BytesIO(content)) as workbook:
        if len(workbook.sheet_names) > MAX_SHEETS:
            raise TooMuch(f"{len(workbook.sheet_names):,} sheets", f"at most {MAX_SHEETS:,} sheets")
        for name in workbook.sheet_names:
            yield str(name)
            sheet = workbook.get_sheet_by_name(name)
            cells += (sheet.total_height + 1) * (sheet.total_width + 1)  # of the last row and column, from 0
            if cells > MAX_CELLS:
                raise TooMuch(f"{cells:,} cells up to the last one that is not empty")
            for row in sheet.to_python(skip_empty_area=False):
                texts = list(map(_text, row))
                size += sum(len(text.encode("utf-8", "replace")) for text in texts)
                if size > MAX_BYTES:
                    raise TooMuch(f"more than {MAX_BYTES:,} bytes of text")
                yield texts


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
        end = {"wrong": f"not a spreadsheet that can be read ({why[:200]})", "expected": "a file without a password"}
    _write(end)


def _write(line: Any) -> None:
    text = json.dumps(line, ensure_ascii=False)  # an escaped character takes six bytes or twelve
    sys.stdout.buffer.write(text.encode("utf-8", "replace") + b"\n")


if __name__ == "__main__":
    main()
