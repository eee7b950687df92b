"""What is only likely in files that were read: it is refused, or a person says that it is right."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.columns import LIKELY, Column
from sinew.tasks.data.names import UNSURE, FileName
from sinew.tasks.data.questions import FOR_ALL_ALIKE, NEITHER
from sinew.tasks.data.recordings import Recording
from sinew.tasks.data.specimen_sizes import Ask


class OtherColumn(Exception):
    """A person says that a likely column is not the right one, and that another is.

    ``titles``: those that the column of this ``role`` may have now. ``confirmed``: what was right so far.
    """

    def __init__(self, role: str, titles: tuple[str, ...], confirmed: Mapping[str, tuple[str, ...]]) -> None:
        super().__init__(role)
        self.option, self.titles, self.confirmed = f"--{role}-column", titles, confirmed


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


def confirm_columns(
    recordings: Sequence[Recording], confirmed: Mapping[str, Sequence[str]], ask: Ask | None, *, certain: bool
) -> dict[str, tuple[str, ...]]:
    """Titles of columns that are right where they are likely, by role: those ``confirmed`` before, and the answers.

    Raises :class:`OtherColumn` where another one is right, and :class:`BadInput` where none is and, if all must be
    ``certain``, for a likely one.
    """
    found = {role: dict.fromkeys(confirmed.get(role, ())) for role in ROLES}
    for recording in recordings:
        for column, role in zip(recording.columns, ROLES, strict=True):
            if column.how != LIKELY or column.title in found[role] or (ask is None and not certain):
                continue
            others = ", ".join(map(shown, recording.left_out[:MOST_OTHERS]))
            problem = f"{column.quantity.name} from {shown(column.title)} is likely, not certain"
            remedy = f"--{role}-column with a title or number"
            if ask is None:
                raise BadInput(recording.path, problem, f"--{role}-column {shown(column.title)} to confirm it")
            beside = f" (not used: {others})" if others else ""
            question = f"{recording.path.name}: {problem}{beside}; is it right? {FOR_ALL_ALIKE}"
            if ask(question, ("yes", "no")) == "no":
                if (other := _other_column(recording, column, ask)) is not None:
                    known = (one.columns[ROLES.index(role)].title for one in recordings)
                    titles = tuple(dict.fromkeys((other, *known)))
                    raise OtherColumn(role, titles, _filled(found))
                problem = f"{shown(column.title)} is not its {column.quantity.name}"
                raise BadInput(recording.path, problem, f"{remedy}{f'; the file also has {others}' if others else ''}")
            found[role][column.title] = None
    return _filled(found)


def _other_column(recording: Recording, column: Column, ask: Ask) -> str | None:
    """The title of the column that is the right one; None where there is none."""
    titles = [title for title in recording.left_out if recording.left_out.count(title) == 1]
    if not titles:
        return None
    question = f"{recording.path.name}: which column is the {column.quantity.name}? {FOR_ALL_ALIKE}"
    answer = ask(question, (*titles, NEITHER))
    return answer if answer in titles else None


def _filled(found: Mapping[str, Mapping[str, None]]) -> dict[str, tuple[str, ...]]:
    return {role: tuple(titles) for role, titles in found.items() if titles}
