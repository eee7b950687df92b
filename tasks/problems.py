"""What a person gets to read when their input is wrong: one line that says where, what, and what was expected."""

from pathlib import Path

from runner.errors import SinewError


class BadInput(SinewError):
    """Input that cannot be used: ``where`` names the file and field or row, ``expected`` says what would be right."""

    def __init__(self, where: str | Path, problem: str, expected: str) -> None:
        super().__init__(one_line(f"{where}: {problem}; expected {expected}"))


def shown(value: object, width: int = 60) -> str:
    """A value from a file, short and printable enough for an error message."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write out integers of thousands of digits
        text = "a number of thousands of digits"
    return text if len(text) <= width else f"{text[: width - 3]}..."


def one_line(text: str) -> str:
    """Text as one printable line: what cannot be printed is escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
