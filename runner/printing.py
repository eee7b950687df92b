"""Where the command prints lines. Names and messages come from files of others: nothing in them steers the terminal."""

import sys

from sinew.runner.errors import one_line


def put(words: object, *, error: bool = False) -> None:
    """Print lines on standard output, or on standard error. Characters that are not printable are escaped."""
    print(printable(str(words)), file=sys.stderr if error else sys.stdout, flush=True)


def no_formula(text: str) -> str:
    """Text for a cell of a CSV table, which no spreadsheet takes for a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def printable(text: str) -> str:
    """Text of any number of lines, in which all but printable characters and tabs are escaped."""
    if text.isprintable():
        return text
    return "\n".join("\t".join(map(one_line, line.split("\t"))) for line in text.split("\n"))
