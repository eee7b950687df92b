"""What a person gets to read when their input is wrong: one line that says where, what, and what was expected."""

from pathlib import Path

from runner.errors import SinewError


class BadInput(SinewError):
    """Input that cannot be used: ``where`` names the file and field or row, ``expected`` says what would be right."""

    def __init__(self, where: str | Path, problem: str, expected: str) -> None:
        super().__init__(_one_line(f"{where}: {problem}; expected {expected}"))


def shown(value: object, width: int = 60) -> str:
    """A value from a file, short and printable enough for an error message."""
    text = repr(value)
    return text if len(text) <= width else f"{text[: width - 3]}..."


def _one_line(text: str) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
