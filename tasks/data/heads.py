"""Which rows above a table hold its titles and its units."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.quantities import OF_A_TEST
from sinew.tasks.data.text import is_number
from sinew.tasks.data.titles import known_within, name_and_unit
from sinew.tasks.data.units import is_other, is_unit

HIGHEST = 5  # rows above the one next to the numbers, in which titles are looked for
NAMED = 2  # of time, motion and load, that a row of titles names where other rows stand below it
Row = tuple[str, ...]
#: "d", "°C" or "mm/min", among units that are known.
_UNKNOWN_UNIT = re.compile(r"[A-Za-z°µ%/²³]{1,3}|[A-Za-z°µ%]{1,3}/[A-Za-z]{1,3}")
#: What a column must be multiplied by, in a row between units and numbers: "x1000", "*0.001", "10^3".
_FACTOR = re.compile(r"[x×*·] ?[-+]?\d[\d.,]*(?:e[-+]?\d+)?|\d[\d.,]* ?[x×*]|10\^[-+]?\d+", re.IGNORECASE)
_SIGNAL = re.compile(r"Sig\d{1,3}\Z")
_SIGNAL_LINES = 450  # at the top of a file, where signals are listed
#: What stands in front of a row of titles and of a row of units, as LabChart and DIAdem write it.
_TITLE_LABELS = (
    "channeltitle", "channel title", "channel name", "channel", "channels", "name", "names", "title", "titles",
    "signal", "signal name", "variable", "kanalname", "kanal", "kanäle", "messgröße", "nom", "nombre", "nome",
)  # fmt: skip
_UNIT_LABELS = ("unitname", "unit", "units", "unit name", "size unit", "einheit", "einheiten", "unité", "unités",
                "unidad", "unidades", "unità", "单位", "単位", "단위")  # fmt: skip

_COMMENT_MARKS = ("#", "%", "//")


@dataclass(frozen=True)
class Head:
    """Titles and units of a table; both may be empty. ``top``: the row of the titles (-1: none)."""

    titles: Row = ()
    units: Row = ()
    top: int = -1


def as_wide(head: Head, rows: Sequence[Row]) -> Head:
    """A head as wide as the first ``rows`` below it.

    An empty title goes in front where these have numbers as names, as R writes them; a mark of a comment in a cell of
    its own, which they lack, goes away.
    """
    first = [row[0].strip('"') if len(row) == len(head.titles) + 1 else "" for row in rows]
    if head.titles and first == [str(number) for number in range(1, len(rows) + 1)] and len(rows) > 1:
        return Head(("", *head.titles), ("", *head.units) if head.units else (), head.top)
    if head.titles and head.titles[0] in _COMMENT_MARKS and all(len(row) == len(head.titles) - 1 for row in rows):
        units = head.units[1:] if len(head.units) == len(head.titles) else head.units
        return Head(head.titles[1:], units, head.top)
    return head


def head_of(rows: Sequence[Row], at: int) -> Head:
    """The head of a table; ``rows`` as titles read, ``at``: the row above its numbers that is not blank (-1: none).

    Titles stand there, or above a row of units. Between titles and numbers may be rows of other texts, such as types
    or names of sensors, if the titles are known ones. Units may also stand above the titles, and numbers beside them.
    """
    while at >= 0 and not any(rows[at]):  # nothing but a mark of a comment, such as "#"
        at -= 1
    if at < 0:
        return Head()
    told = _labelled(rows, at) or _listed(rows, at)
    if told is not None:
        return told
    above = at - 1 if at > 0 and any(rows[at - 1]) else _next_above(rows, at)
    words = _without_numbers(rows[at])
    beside = words != rows[at] and sum(cell not in ("", "1") for cell in words) >= NAMED and is_row_of_units(words)
    if beside and above == at - 1 and len(_names(rows[above])) >= NAMED:
        return Head(rows[above], words, above)
    if is_row_of_units(rows[at]) and above == at - 1 >= 0:
        return Head(rows[above], rows[at], above)
    if above >= 0 and _names(rows[above]) and _covers(rows[above], _units_only(rows[at])) and _may_be_units(rows[at]):
        return Head(rows[above], rows[at], above)
    if above >= 0 and is_row_of_units(rows[above]) and _places(rows[above]) == _places(rows[at]) and _names(rows[at]):
        return Head(rows[at], rows[above], above)
    return _higher(rows, at) or Head(_with_words_above(rows[at], rows[at - 1] if at > 0 else ()), (), at)


def _with_words_above(titles: Row, above: Row) -> Row:
    """Titles, some of which are nothing but a unit in brackets, below the word for it: ``Stress`` above ``[MPa]``."""
    words = (*above, *[""] * (len(titles) - len(above)))
    return tuple(
        f"{word} {title}" if word and is_bracketed(title) and is_unit(title.strip("()[] ")) else title
        for title, word in zip(titles, words, strict=False)
    )


def _units_only(row: Row) -> Row:
    """The row without what is no unit, such as a remark behind the last column."""
    return tuple(cell if is_bracketed(cell) or is_unit(cell) else "" for cell in row)


def _labelled(rows: Sequence[Row], at: int) -> Head | None:
    """Titles and units from rows that say in their first cell what they are; None where they do not."""
    titles, units = -1, -1
    for place in range(at, max(at - HIGHEST, -1), -1):
        label = rows[place][0].rstrip("=: ").casefold() if rows[place] else ""
        if label in _UNIT_LABELS and units < 0:
            units = place
        elif label in _TITLE_LABELS and titles < 0:
            titles = place
        elif not is_label(rows[place]):
            break
    if titles < 0 or units < 0:
        return None
    return Head(("", *rows[titles][1:]), ("", *rows[units][1:]), min(titles, units))


def _listed(rows: Sequence[Row], at: int) -> Head | None:
    """Titles from rows with one each, as DMA and rheometers of TA Instruments list them: ``Sig1  Time (min)``."""
    if rows[at][0].casefold() != "startofdata":
        return None
    top = enumerate(rows[: min(at, _SIGNAL_LINES)])
    found = {row[0]: (place, row[1]) for place, row in top if len(row) > 1 and _SIGNAL.match(row[0])}
    if not found:
        return None
    return Head(tuple(title for _, title in found.values()), (), min(place for place, _ in found.values()))


def _are_factors(row: Row) -> bool:
    """Whether most cells of a row are factors, such as ``x1000``."""
    filled = [cell for cell in row if cell]
    factors = sum(bool(_FACTOR.fullmatch(cell)) for cell in filled)
    return factors >= NAMED and 2 * factors > len(filled)


def refuse_factors(path: Path, rows: Sequence[tuple[int, Row]]) -> None:
    """Raises :class:`BadInput` where a row between titles and numbers holds factors of the columns."""
    for at, row in rows:
        if _are_factors(row):
            problem = f"{shown(', '.join(filter(None, row)), 80)} above the numbers may be factors of the columns"
            raise BadInput(f"{path}: row {at}", problem, "numbers in the units above them, without this row")


def joined(row: Row) -> str:
    """The cells of a row that hold something as one line, with single spaces."""
    return " ".join(" ".join(row).split())


def is_label(row: Row) -> bool:
    """Whether the first cell of a row says what the others are: ``Range=``, ``Sample:``."""
    return bool(row) and row[0].endswith(("=", ":"))


def _higher(rows: Sequence[Row], at: int) -> Head | None:
    """The head above rows that have no title of a test; None if no row there has."""
    if _names(rows[at]):
        return None
    for place in range(at - 1, max(at - 1 - HIGHEST, -1), -1):
        row = rows[place]
        if any(is_number(cell, mark) for cell in row for mark in ".,"):
            return None
        if len(_names(row)) >= NAMED and _covers(row, rows[at]):
            below = rows[place + 1]
            return Head(row, below if is_row_of_units(below) else (), place)
    return None


def _names(row: Row) -> set[int]:
    """Which of time, motion and load a row has titles of, by number. Titles that are only a unit do not count."""
    named = [each for each in map(name_and_unit, filter(None, row)) if not each[0].startswith("(")]
    names = {name for name, _ in named}
    measured = [name for name, unit in named if is_unit(unit)]
    found = set()
    for number, (_, known) in enumerate(OF_A_TEST):
        if not names.isdisjoint(known) or any(known_within(name, known) for name in measured):
            found.add(number)
    return found


def _without_numbers(row: Row) -> Row:
    """The row without its numbers, which somebody may have written beside a table; ``1`` may be a unit."""
    return tuple("" if any(is_number(cell, mark) for mark in ".,") and not is_unit(cell) else cell for cell in row)


def _next_above(rows: Sequence[Row], at: int) -> int:
    """The next row above that is not blank, up to two rows higher; -1 if there is none."""
    return next((place for place in (at - 2, at - 3) if place >= 0 and any(rows[place])), -1)


def _covers(titles: Row, below: Row) -> bool:
    """Whether each cell below has a title, which is no number."""
    places = _places(below)
    texts = {place for place in places if place < len(titles) and titles[place]}
    return texts == places and not any(is_number(titles[place], mark) for place in places for mark in ".,")


def _places(row: Row) -> set[int]:
    return {place for place, cell in enumerate(row) if cell}


def _may_be_units(row: Row) -> bool:
    """Whether most cells are units, and the others words: ``mm kN Sec segments``."""
    filled = [cell for cell in row if cell]
    known = sum(is_bracketed(cell) or is_unit(cell.strip("()[] ")) for cell in filled)
    return known > len(filled) - known and all(len(cell.split()) == 1 for cell in filled)


def _is_any_unit(text: str) -> bool:
    return is_unit(text) or is_other(text)


def is_row_of_units(row: Row) -> bool:
    """Whether all cells are units; one that is not known may be among two that are, such as a ``d`` for days."""
    filled = [cell for cell in row if cell]
    unknown = [cell for cell in filled if not (is_bracketed(cell) or _is_any_unit(cell.strip("()[] ")))]
    known = len(filled) - len(unknown)
    return known > len(unknown) and all(_UNKNOWN_UNIT.fullmatch(cell) for cell in unknown)


def told_units(row: Row) -> Row:
    """A row of units without the word in front that says that it is one; empty for another row."""
    labelled = row[1:] if row and row[0].rstrip("=: ").casefold() in _UNIT_LABELS else None
    plain = row if labelled is None else ("", *labelled)
    return plain if is_row_of_units(plain) else ()


def is_bracketed(text: str) -> bool:
    """Whether a text stands in brackets, as units often do."""
    return len(text) > 1 and text[0] in "([" and text[-1] in ")]"
