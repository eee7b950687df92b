"""What lines beside a table tell of its columns: ``Force unit: kN``, ``Load scale factor: 1000``."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from sinew.runner.errors import shown
from sinew.tasks.data import units, words
from sinew.tasks.data.heads import Row, joined
from sinew.tasks.data.sizes import narrow
from sinew.tasks.data.titles import name_and_unit

_LONGEST_LINE = 100  # characters
_UNITS = r"(?:units?|einheit|unité|unidad|unità)"
_UNIT_LINE = re.compile(
    rf"(?:(?P<name>\D+?)[ _-]*{_UNITS}|{_UNITS} of (?P<of>\D+?))[:= (\[]+(?P<unit>[^\s()\[\]:=]+)[)\]]?(?: ?\(.*\))?",
    re.IGNORECASE,
)
ROLES: Mapping[str, tuple[str, ...]] = {
    "time": words.TIME,
    "motion": (*words.DISPLACEMENT, *words.POSITION),
    "load": words.FORCE,
}
_QUANTITY = "|".join(re.escape(name) for names in ROLES.values() for name in names[:20] if len(name) > 2)
_FACTOR = r"(?:scale|scaling|multipl|factor|faktor|facteur|gain)"
_FACTOR_LINE = re.compile(
    rf"(?=.*\b(?:{_QUANTITY}|calibration)\b)(?=.*{_FACTOR}).*?"
    rf"(?P<value>[-+]?\d[\d.,]*(?: \d{{3}}[\d.,]*)*(?:e[-+]?\d+)?)|"
    rf"(?:{_QUANTITY}) ?\(? ?[x×*] ?(?P<times>\d[\d.,]*)",
    re.IGNORECASE,
)
_ONE = re.compile(r"\+?1(?:[.,]0+)?(?:e[-+]?0+)?", re.IGNORECASE)


def role_of(name: str) -> str:
    """Which of time, motion and load a name of a column is of, else the name itself: ``load`` of ``force``."""
    return next((role for role, names in ROLES.items() if name in names), name)


def units_above(header: Sequence[Row]) -> dict[str, list[str]]:
    """The units that lines above a table tell, by the role of a column or its name: ``Force unit: kN``."""
    found: dict[str, list[str]] = {}
    for row in narrow(header):
        if (told := _unit_in(joined(row))) is not None:
            name, unit = told
            found.setdefault(role_of(name_and_unit(name)[0]), []).append(unit)
    return found


def told_factors(lines: Iterable[str]) -> Iterator[str]:
    """A line for each factor of a column that a line above the table tells and that is not 1: ``Load scale factor``."""
    for line in lines:
        if tells_factor(text := line[:_LONGEST_LINE]):
            yield f"the file gives {shown(text, 60)}; numbers are read as they stand, without it"


def told_bending(texts: Iterable[str]) -> Iterator[str]:
    """A line on the first of several titles and lines that tells of a bending.

    A fixture says nothing where a length is told, too: some programs write all settings that they know of.
    """
    lines = [text[:_LONGEST_LINE] for text in texts]
    sized = any(line.casefold().startswith(words.SIZES["length"]) for line in lines)
    telling = words.BENDING if sized else (*words.BENDING, *words.BENDING_FIXTURES)
    for text in lines:
        if any(word in text.casefold() for word in telling):
            yield (
                f"a bending test, by {shown(text, 60)}: sinew takes each specimen as a bar that is pulled, so its "
                "stress is force by cross-section"
            )
            return


def tells_factor(text: str) -> bool:
    """Whether a line tells a factor of a column other than 1."""
    found = _FACTOR_LINE.match(text)
    return found is not None and not _ONE.fullmatch(found["value"] or found["times"])


def tells_unit(text: str) -> bool:
    """Whether a line tells the unit of a column."""
    return _unit_in(text) is not None


def _unit_in(text: str) -> tuple[str, str] | None:
    """The name of a column and the unit that a line tells of it; None for another line."""
    line = _UNIT_LINE.fullmatch(text[:_LONGEST_LINE])
    if line is None or not units.is_unit(line["unit"]):
        return None
    return line["name"] or line["of"], line["unit"]
