"""What only a person can tell of a file: a question, and the option that answers it."""

from collections.abc import Sequence
from dataclasses import dataclass

from sinew.runner.errors import BadInput

FOR_ALL_ALIKE = "(the answer applies to all files that leave this open)"  # behind a question
NEITHER = "none of them"  # an answer


class Unclear(BadInput):
    """A file that cannot be read without an answer: ``what`` is asked for, and ``which`` one of the ``choices`` it is.

    ``option`` gives the same answer.
    """

    def __init__(
        self, where: str, problem: str, expected: str, *, what: str, which: str, option: str, choices: Sequence[str]
    ) -> None:
        super().__init__(where, problem, expected)
        self.where = where
        self.what, self.which, self.option, self.choices = what, which, option, tuple(choices)

    def question_on(self, file: str) -> str:
        """The question on one file, for a person."""
        return f"{self.what} in {file}: {self.which} {FOR_ALL_ALIKE}"

    def unanswered(self) -> BadInput:
        """The same where nobody can be asked: it says how to see all that the file leaves open."""
        return BadInput(self.where, self.problem, f"{self.expected}; `sinew import --dry-run` lists what is open")


class NoColumn(BadInput):
    """A table that has no title of a quantity that is needed. ``alone``: it has none of any quantity.

    ``question``: which of its columns holds it, where some column may; ``NEITHER`` answers that none does.
    """

    alone = False
    question: Unclear | None = None


class UnknownUnit(Unclear):
    """A unit that only a person can tell. ``option`` is the option that tells it, ``choices`` are its values."""

    def __init__(self, where: str, quantity: str, option: str, choices: Sequence[str], problem: str = "") -> None:
        super().__init__(
            where,
            problem or f"no unit of the {quantity} can be found",
            f"{option}, one of {', '.join(choices)}",
            what=quantity,
            which="which unit?",
            option=option,
            choices=choices,
        )
        self.quantity = quantity


@dataclass(frozen=True)
class Doubt:
    """What is read in the usual way, although it may be meant otherwise: ``text`` says so.

    One of the ``choices`` of ``option`` settles it, and answers the ``question``.
    """

    text: str
    question: str
    option: str
    choices: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}"

    def question_on(self, file: str) -> str:
        """The question on one file, for a person."""
        return f"{file}: {self.text}; {self.question} {FOR_ALL_ALIKE}"

    @property
    def remedy(self) -> str:
        return f"{self.option} {', '.join(self.choices[:-1])} or {self.choices[-1]}"
