"""What a person has told of files, kept beside the study, so that the same export needs no questions again."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated

from pydantic import Field

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.sizes import LONGEST_MM
from sinew.tasks.study.settings_file import Section, read_settings, write_settings

HEAD = """\
# What the files did not tell, as it was answered. It is used again by
#   sinew init FILES --out FOLDER --answers {name}
"""
_Millimetres = Annotated[float, Field(gt=0, lt=LONGEST_MM)]


class _Sizes(Section):
    length_mm: _Millimetres | None = None
    width_mm: _Millimetres | None = None
    thickness_mm: _Millimetres | None = None


class _File(Section):
    """``answers.yaml``: the fields of :class:`Hints`, and the sizes of each specimen."""

    time_column: str | None = None
    displacement_column: str | None = None
    force_column: str | None = None
    time_unit: str | None = None
    displacement_unit: str | None = None
    force_unit: str | None = None
    test_column: str | None = None
    cycle_column: str | None = None
    rate_hz: float | None = None
    speed: float | None = None
    keep_column: list[str] | None = None
    specimens: dict[str, _Sizes] = Field(default_factory=dict)


@dataclass(frozen=True)
class Answers:
    """``hints`` for all files, and sizes (mm) by specimen and name (``length``, ``width``, ``thickness``)."""

    hints: Hints = field(default_factory=Hints)
    sizes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def read_answers(path: Path) -> Answers:
    """The answers that an earlier ``sinew init`` has kept. Raises :class:`BadInput`."""
    found = read_settings(path, _File, "answers")
    sizes = {
        name: {size.removesuffix("_mm"): value for size, value in one.model_dump(exclude_none=True).items()}
        for name, one in found.specimens.items()
    }
    kept = None if found.keep_column is None else tuple(found.keep_column)
    return Answers(Hints(**found.model_dump(exclude={"specimens", "keep_column"}), keep_column=kept), sizes)


def write_answers(path: Path, answers: Answers) -> None:
    """Keep answers for the next time; nothing is written if there are none."""
    content: dict[str, object] = {name: value for name, value in asdict(answers.hints).items() if value is not None}
    sizes = {name: {f"{size}_mm": value for size, value in one.items()} for name, one in answers.sizes.items() if one}
    content |= {"specimens": sizes} if sizes else {}
    if content:
        write_settings(path, HEAD.format(name=path.name), content)


def with_answers(hints: Hints, answers: Hints) -> Hints:
    """``hints``, with what only ``answers`` tell. Times that are told in one way need no other one."""
    timed = hints.timing.given or hints.time_column is not None
    told = {}
    for one in fields(Hints):
        mine, theirs = getattr(hints, one.name), getattr(answers, one.name)
        left = timed and one.name in ("time_column", "rate_hz", "speed")
        told[one.name] = mine if mine is not None or left else theirs
    return Hints(**told)
