"""What a person has told of files, kept beside the study, so that the same export needs no questions again."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, create_model

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.sizes import LONGEST_MM, SHORTEST_MM
from sinew.tasks.study.settings_file import Section, read_settings, write_settings

HEAD = """\
# What the files did not tell, as it was answered. It is used again by
#   sinew init FILES --out FOLDER --answers {name}
"""
_Millimetres = Annotated[float, Field(ge=SHORTEST_MM, lt=LONGEST_MM)]


class _Sizes(Section):
    length_mm: _Millimetres | None = None
    width_mm: _Millimetres | None = None
    thickness_mm: _Millimetres | None = None


_HINTS: Any = {one.name: (one.type, one.default) for one in fields(Hints)}
_Titles = Annotated[tuple[str, ...], Field(strict=False)]  # YAML has lists
_HINTS |= {f"{name}_column": (str | _Titles | None, None) for name in ("time", "displacement", "force")}
_HINTS["keep_column"] = _Titles | None, None
_Hints = create_model("_Hints", __base__=Section, **_HINTS)


class _Instead(Section):
    time: dict[str, str] = Field(default_factory=dict)
    displacement: dict[str, str] = Field(default_factory=dict)
    force: dict[str, str] = Field(default_factory=dict)


class _Rest(Section):
    answered: Any = None
    confirmed: Any = None
    instead: _Instead = Field(default_factory=_Instead)
    specimens: dict[str, _Sizes] = Field(default_factory=dict)


class _Confirmed(Section):
    time: tuple[str, ...] = Field(default=(), strict=False)
    displacement: tuple[str, ...] = Field(default=(), strict=False)
    force: tuple[str, ...] = Field(default=(), strict=False)


#: ``answers.yaml``: the fields of :class:`Hints` for all files, the same for questions, titles of columns that are
#: right where they are likely, those that are right instead of a likely one, and sizes of each specimen.
_File = create_model(
    "_File",
    __base__=_Rest,
    answered=(_Hints, Field(default_factory=_Hints)),
    confirmed=(_Confirmed, Field(default_factory=_Confirmed)),
    **_HINTS,
)


@dataclass(frozen=True)
class Answers:
    """``hints`` for all files, and sizes (mm) by specimen and name (``length``, ``width``, ``thickness``).

    ``answered``: what holds for files that ask for it, and for no others. ``confirmed``: titles of columns by role
    (``time``, ``displacement``, ``force``), which are right in files where they are likely. ``instead``: by role, the
    right title for each likely one that is wrong.
    """

    hints: Hints = field(default_factory=Hints)
    sizes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    answered: Hints = field(default_factory=Hints)
    confirmed: Mapping[str, Sequence[str]] = field(default_factory=dict)
    instead: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def read_answers(path: Path) -> Answers:
    """The answers that an earlier ``sinew init`` has kept. Raises :class:`BadInput`."""
    found = read_settings(path, _File, "answers")
    sizes = {
        name: {size.removesuffix("_mm"): value for size, value in one.model_dump(exclude_none=True).items()}
        for name, one in found.specimens.items()
    }
    told = found.model_dump()
    hints = Hints(**{name: told[name] for name in _HINTS})
    confirmed, instead = ({k: v for k, v in told[name].items() if v} for name in ("confirmed", "instead"))
    return Answers(hints, sizes, Hints(**told["answered"]), confirmed, instead)


def write_answers(path: Path, answers: Answers) -> None:
    """Keep answers for the next time; nothing is written if there are none."""
    content: dict[str, object] = dict(_told(answers.hints))
    content |= {"answered": answered} if (answered := _told(answers.answered)) else {}
    confirmed = {role: list(titles) for role, titles in answers.confirmed.items()}
    content |= {"confirmed": confirmed} if confirmed else {}
    instead = {role: dict(titles) for role, titles in answers.instead.items()}
    content |= {"instead": instead} if instead else {}
    sizes = {name: {f"{size}_mm": value for size, value in one.items()} for name, one in answers.sizes.items() if one}
    content |= {"specimens": sizes} if sizes else {}
    if content:
        write_settings(path, HEAD.format(name=path.name), content)


def _told(hints: Hints) -> dict[str, object]:
    return {name: value for name, value in asdict(hints).items() if value is not None}


def with_answers(hints: Hints, answers: Hints) -> Hints:
    """``hints``, with what only ``answers`` tell. Times that are told in one way need no other one."""
    timed = hints.timing.given or hints.time_column is not None
    told = {}
    for one in fields(Hints):
        mine, theirs = getattr(hints, one.name), getattr(answers, one.name)
        left = timed and one.name in ("time_column", "rate_hz", "speed", "speed_column")
        told[one.name] = mine if mine is not None or left else theirs
    return Hints(**told)
