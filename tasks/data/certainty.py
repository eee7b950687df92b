"""What is only likely in files that were read: it is refused, or a person says that it is right."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import LIKELY, Column
from sinew.tasks.data.names import UNSURE, FileName
from sinew.tasks.data.questions import FOR_ALL_ALIKE, NEITHER
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.specimen_sizes import Ask

ROLES = ("time", "displacement", "force")
MOST_OTHERS = 6  # titles that are told where a column is not the right one


def refuse_doubts(recordings: Sequence[Recording]) -> None:
    """Raises :class:`BadInput` for the first zero, sign, preload or end that only a person can tell, with its option.

    The options that others need are told as well.
    """
    options = dict.fromkeys(doubt.option for recording in recordings for doubt in recording.doubts)
    for recording in recordings:
        for doubt in recording.doubts:
            others = ", ".join(option for option in options if option != doubt.option)
            raise BadInput(recording.path, doubt.text, f"{doubt.remedy}{f'; also open: {others}' if others else ''}")


def refuse_unsure_names(names: Mapping[Path, FileName]) -> None:
    """Raises :class:`BadInput` for the first name of a file that is not certain."""
    for path, name in names.items():
        if name.how == UNSURE:
            raise BadInput(path, "a number may be a specimen's or a trial's", "a name SPECIMEN_PROTOCOL")


@dataclass
class Columns:
    """Titles of columns by role. ``confirmed``: right where they are likely; ``instead``: likely titles that are wrong,
    each with the right one, which goes first where a file has it.
    """

    confirmed: dict[str, dict[str, None]]
    instead: dict[str, dict[str, str]]

    @classmethod
    def of(cls, confirmed: Mapping[str, Sequence[str]], instead: Mapping[str, Mapping[str, str]]) -> "Columns":
        """What earlier answers say."""
        return cls(
            {role: dict.fromkeys(confirmed.get(role, ())) for role in ROLES},
            {role: dict(instead.get(role, {})) for role in ROLES},
        )

    @property
    def told(self) -> tuple[dict[str, tuple[str, ...]], dict[str, dict[str, str]]]:
        """What is kept of both for the next time."""
        confirmed = {role: tuple(titles) for role, titles in self.confirmed.items() if titles}
        return confirmed, {role: titles for role, titles in self.instead.items() if titles}

    def other(self, recording: Recording, ask: Ask | None) -> tuple[str, str] | None:
        """The option for a column that is likely and wrong, and the title of the right one; None where none is.

        Raises :class:`BadInput` where a person says that a column is wrong and no other one is right.
        """
        for column, role in zip(recording.columns, ROLES, strict=True):
            if column.how != LIKELY:
                continue
            right = self.instead[role].get(column.title)
            if right is not None and right not in recording.others:
                if ask is None:
                    problem = f"{shown(column.title)} was said to be no {column.quantity.name}, but {shown(right)}"
                    raise BadInput(recording.path, problem, f"a column of that title, or --{role}-column")
                right = None
            if right is None and ask is not None and column.title not in self.confirmed[role]:
                right = self._asked(recording, column, role, ask)
            if right is not None:
                return f"--{role}-column", right
        return None

    def _asked(self, recording: Recording, column: Column, role: str, ask: Ask) -> str | None:
        """The title of the right column, if a person says that it is another one."""
        titles = recording.others
        listed = ", ".join(map(shown, titles[:MOST_OTHERS]))
        beside = f" (not used: {listed})" if listed else ""
        question = f"{recording.path.name}: {_likely(column)}{beside}; is it right? {FOR_ALL_ALIKE}"
        if ask(question, ("yes", "no")) == "yes":
            self.confirmed[role][column.title] = None
            return None
        question = f"{recording.path.name}: which column is the {column.quantity.name}? {FOR_ALL_ALIKE}"
        right = ask(question, (*titles, NEITHER)) if titles else NEITHER
        if right not in titles:
            problem = f"{shown(column.title)} is not its {column.quantity.name}"
            more = f"; the file also has {listed}" if listed else ""
            raise BadInput(recording.path, problem, f"--{role}-column with a title or number{more}")
        self.instead[role][column.title] = right
        return right

    def refuse_likely(self, recordings: Sequence[Recording]) -> None:
        """Raises :class:`BadInput` for the first column that is only likely, and that nobody has confirmed."""
        for recording in recordings:
            for column, role in zip(recording.columns, ROLES, strict=True):
                if column.how == LIKELY and column.title not in self.confirmed[role]:
                    expected = f"--{role}-column {shown(column.title)} to confirm it"
                    raise BadInput(recording.path, _likely(column), expected)


def _likely(column: Column) -> str:
    return f"{column.quantity.name} from {shown(column.title)} is likely, not certain"
