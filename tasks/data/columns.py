"""Which column of a table holds what, in which unit, and how sure that is.

Columns are recognised by their titles. Units are read or given, never guessed: a wrong unit looks right, and results
that rest on it are worthless.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units, words
from sinew.tasks.data.tables import Row, Table
from sinew.tasks.data.text import is_number
from sinew.tasks.data.units import Units

SURE, LIKELY, GIVEN = "sure", "likely", "as you said"
#: Titles of columns with the spread of a mean.
SPREADS = ("sd", "std", "se", "sem", "standard deviation", "standard error")
_CHANNEL = re.compile(r"(?:c|ch|chan|channel|kanal|canal|voie) ?\d+ (?=\D)")  # "C_1_Force", "Ch 1 Kraft"
_COMMON_TITLES = 6  # the first titles of a quantity leave no doubt


@dataclass(frozen=True)
class Quantity:
    """What a column may hold. ``titles``: in lower case, the better the earlier; ``units``: with their factors.

    ``bare``: without a unit, the numbers are taken as they are.
    """

    name: str
    titles: tuple[str, ...]
    units: Units
    bare: bool = False


TIME = Quantity("time", words.TIME, units.TIME)
DISPLACEMENT = Quantity("displacement", words.DISPLACEMENT, units.LENGTH)
POSITION = Quantity("position", words.POSITION, units.LENGTH)
LENGTH = Quantity("length", words.LENGTH, units.LENGTH)
STRAIN = Quantity("strain", words.STRAIN, units.FRACTION)
STRETCH = Quantity("stretch", words.STRETCH, units.FRACTION, bare=True)
FORCE = Quantity("force", words.FORCE, units.FORCE)
STRESS = Quantity("stress", words.STRESS, units.STRESS)
MOTIONS, LOADS = (DISPLACEMENT, LENGTH, POSITION, STRETCH, STRAIN), (FORCE, STRESS)


@dataclass(frozen=True)
class Hints:
    """What a person says of a file: titles or numbers (from 1) of columns, and units that the file does not tell.

    ``force_unit`` may be a unit of stress; the load is a stress then.
    """

    time_column: str | None = None
    displacement_column: str | None = None
    force_column: str | None = None
    time_unit: str | None = None
    displacement_unit: str | None = None
    force_unit: str | None = None

    def answered(self, option: str, unit: str) -> "Hints":
        """The same, with the answer to an :class:`UnknownUnit`."""
        return replace(self, **{option.removeprefix("--").replace("-", "_"): unit})


class UnknownUnit(BadInput):
    """A unit that only a person can tell. ``option`` is the option that tells it, ``choices`` are its values."""

    def __init__(self, where: str, quantity: str, option: str, choices: Sequence[str], problem: str = "") -> None:
        problem = problem or f"no unit of the {quantity} can be found"
        super().__init__(where, problem, f"{option}, one of {', '.join(choices)}")
        self.quantity, self.option, self.choices = quantity, option, tuple(choices)


class NoColumn(BadInput):
    """A table that has no title of a quantity that is needed."""


@dataclass(frozen=True)
class Column:
    """A column and what it is taken for. ``unit`` is that of the file, ``how`` says how sure the choice is.

    ``alike``: titles of columns that could be taken as well as this one.
    """

    quantity: Quantity
    place: int
    title: str
    unit: str
    factor: float
    how: str
    alike: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Role:
    """One of the three columns that a test needs, and what a person says of it."""

    name: str
    option: str
    quantities: tuple[Quantity, ...]
    wanted: str | None
    given: str | None
    more_titles: tuple[str, ...] = ()  # that any of the quantities may have

    def titles(self, quantity: Quantity) -> tuple[str, ...]:
        return quantity.titles + self.more_titles

    @property
    def unit_option(self) -> str:
        return f"--{self.option}-unit"

    @property
    def choices(self) -> tuple[str, ...]:
        return units.merged(quantity.units for quantity in self.quantities)


@dataclass(frozen=True)
class _Choice:
    quantity: Quantity
    place: int
    how: str
    alike: tuple[str, ...] = ()


def recognise(table: Table, hints: Hints, *, first_of_alike: bool = False) -> tuple[Column, Column, Column]:
    """The columns of time, motion and load. Of columns with one title, the first counts if ``first_of_alike``.

    Raises :class:`NoColumn` if one is missing, :class:`UnknownUnit` if a person must tell its unit, and
    :class:`BadInput` if units contradict each other or a choice is not clear.
    """
    titles = _titles(table)
    named = _named(table, titles)
    roles = _roles(hints)
    choices = [_choose(table, titles, named, role) for role in roles]
    if table.titles and not _by_number(hints):
        _check_width(table)
    if not first_of_alike:
        for choice, role in zip(choices, roles, strict=True):
            if choice.alike:
                listed = " and ".join(shown(title) for title in (titles[choice.place], *choice.alike))
                expected = f"--{role.option}-column NUMBER, from 1"
                raise BadInput(table.path, f"{listed} may both be the {choice.quantity.name}", expected)
    time, motion, load = (
        _column(table, titles, named, role, choice) for role, choice in zip(roles, choices, strict=True)
    )
    if len({time.place, motion.place, load.place}) < 3:
        expected = "three columns; name them by --time-column and the like"
        raise BadInput(table.path, "one column is taken for two things", expected)
    return time, motion, load


def partly(
    table: Table, hints: Hints, *, only: Quantity | None = None
) -> tuple[tuple[Column | None, Column | None, Column | None], tuple[str, ...]]:
    """The columns of time, motion and load that can be recognised, and a line on each that cannot.

    A column whose unit only a person can tell has the unit ``""`` and the factor 1. ``only``: the motion must be this.
    """
    titles = _titles(table)
    named = _named(table, titles)
    found: list[Column | None] = []
    problems = []
    for role in _roles(hints):
        if only is not None and role.name.startswith("displacement"):
            role = replace(role, quantities=(only,))
        try:
            choice = _choose(table, titles, named, role)
        except BadInput as error:
            found.append(None)
            problems.append(f"{role.name}: {error.problem}; --{role.option}-column")
            continue
        try:
            found.append(_column(table, titles, named, role, choice))
        except BadInput as error:
            title = titles[choice.place]
            found.append(Column(choice.quantity, choice.place, title, "", 1.0, choice.how, choice.alike))
            problems.append(f"unit of '{title}' ({choice.quantity.name}): {error.problem}; {role.unit_option}")
    return (found[0], found[1], found[2]), tuple(problems)


def is_spread(title: str) -> bool:
    """Whether a column holds the spread of a mean, such as a standard deviation."""
    return re.sub(r"\s*[(\[].*", "", title, flags=re.DOTALL).strip().lower() in SPREADS


def _roles(hints: Hints) -> tuple[_Role, _Role, _Role]:
    stress = hints.force_unit is not None and units.factor(STRESS.units, hints.force_unit) is not None
    loads, more = ((STRESS,), FORCE.titles) if stress else (LOADS, ())
    return (
        _Role("time", "time", (TIME,), hints.time_column, hints.time_unit),
        _Role("displacement, length or strain", "displacement", MOTIONS, hints.displacement_column,
              hints.displacement_unit),
        _Role(" or ".join(load.name for load in loads), "force", loads, hints.force_column, hints.force_unit,
              more),
    )  # fmt: skip


def _by_number(hints: Hints) -> bool:
    return all((given or "").isdigit() for given in (hints.time_column, hints.displacement_column, hints.force_column))


# ---- titles


def _titles(table: Table) -> Row:
    """A title for each column that has one or holds numbers."""
    width = _width(table.rows[0][1])
    return (*table.titles, *[""] * (width - len(table.titles)))


def _named(table: Table, titles: Row) -> list[tuple[str, str]]:
    """Name and unit of each column; the unit may be empty."""
    found = [_name_and_unit(title, below) for title, below in zip(titles, _below(table, len(titles)), strict=True)]
    return [(name, "s" if table.has_clock(place) else unit) for place, (name, unit) in enumerate(found)]


def _width(row: Sequence[str]) -> int:
    """How many cells a row has, without empty ones at its end."""
    return max((i for i, cell in enumerate(row, start=1) if cell), default=0)


def _below(table: Table, count: int) -> list[str]:
    cells = [cell.strip("()[] ") for cell in table.units[:count]]
    return [*cells, *[""] * (count - len(cells))]


def _check_width(table: Table) -> None:
    """Refuse titles that are too few or too many to belong to the columns below them."""
    count, row = _width(table.titles), table.rows[0][1]
    numbers = _width([cell if is_number(cell, table.decimal) else "" for cell in row])
    untitled = numbers > len(table.titles) or numbers >= 2 * count
    shifted = len(row) < count and any(units.is_unit(title) for title in table.titles)
    if untitled or shifted:
        problem = f"{count} names above {_width(row)} columns of numbers"
        expected = "as many; commas cannot separate columns and be decimal marks at the same time"
        raise BadInput(f"{table.path}: row {table.first}", problem, expected)


def _where(table: Table) -> str:
    return f"{table.path}: row {table.title_row}" if table.titles else str(table.path)


def _name_and_unit(title: str, below: str = "") -> tuple[str, str]:
    """Name, in lower case, and unit (may be empty): ``Force (N)``, ``Kraft [kN]``, ``Zeit / s``, ``force_N``."""
    title = unicodedata.normalize("NFC", title).strip().lstrip("#").strip().strip("\"'")
    if title.lower() in STRETCH.titles:
        return title.lower(), below
    if brackets := re.findall(r"[(\[]\s*([^()\[\]]*?)\s*[)\]]", title):
        unit = next((text for text in brackets if units.is_unit(text)), below or brackets[0])
        return _plain(re.split(r"[(\[]", title)[0]), unit
    for pattern in (r"(.+?)\s*/\s*(\S+)", r"(.+?)\s*,\s*(\S+)", r"(.+)[_ -]([^\s_-]+)", r"(.+?)\s+in\s+(\S+)"):
        if (found := re.fullmatch(pattern, title)) and units.is_unit(found[2]):
            return _plain(found[1]), found[2]
    return _plain(title), below


def _plain(text: str) -> str:
    text = re.sub(r"(?<=[a-zäöü])(?=[A-Z])", " ", text)
    text = re.sub(r"[\s_.:-]+", " ", text).strip().lower().removesuffix(" in").strip()
    return _CHANNEL.sub("", text)


# ---- the choice of a column


def _choose(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: _Role) -> _Choice:
    if role.wanted is not None:
        return _chosen_by_person(table, titles, named, role, role.wanted)
    found = [
        (_rank(table, role, number, place, *column), place, quantity)
        for number, quantity in enumerate(role.quantities)
        for place, column in enumerate(named)
        if column[0] in role.titles(quantity)
        and _possible(quantity, column[0], column[1] or role.given or "", column[1])
    ]
    if not found:
        listed = ", ".join(title or "(no name)" for title in titles[:12])
        expected = f"--{role.option}-column NAME or NUMBER"
        raise NoColumn(_where(table), f"no column of {role.name} among {shown(listed, 200)}", expected)
    rank, place, quantity = min(found, key=lambda one: one[:2])
    alike = tuple(titles[other] for same, other, _ in found if same == rank and other != place)
    sure = len(found) == 1 and rank[-1] < _COMMON_TITLES and quantity in (TIME, DISPLACEMENT, FORCE)
    return _Choice(quantity, place, SURE if sure else LIKELY, alike)


def _rank(table: Table, role: _Role, number: int, place: int, name: str, unit: str) -> tuple[int, bool, bool, int]:
    """The lower, the rather a column is meant: by its quantity, whether it has a unit, and how usual its title is.

    A clock may stand beside the time since the start, which is finer.
    """
    quantity = role.quantities[number]
    no_unit = not (unit or role.given or quantity.bare)
    return number, table.has_clock(place), no_unit, role.titles(quantity).index(name)


def _possible(quantity: Quantity, name: str, unit: str, in_file: str) -> bool:
    """Whether a column can hold a quantity: one in mm is no ratio of lengths.

    ``unit``: that ``in_file``, else the one that a person gives.
    ``L`` is a ratio of lengths unless its unit, in the file or given, is one of length.
    """
    if name == "l":
        return (units.factor(units.LENGTH, unit) is not None) == (quantity is LENGTH)
    return units.ambiguous(in_file) or not units.belongs_elsewhere(quantity.units, in_file)


def _chosen_by_person(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: _Role, wanted: str) -> _Choice:
    place = _place_of(table, titles, named, role, wanted)
    name, unit = named[place]
    fitting = [q for q in role.quantities if name in role.titles(q)]
    quantity = next((q for q in fitting if _possible(q, name, unit or role.given or "", unit)), None)
    quantity = quantity or next(iter(fitting), None)
    quantity = quantity or _quantity_of_unit(role.quantities, unit or role.given or "")
    if quantity is None:
        raise UnknownUnit(f"{table.path}: column {shown(wanted)}", role.name, role.unit_option, role.choices)
    return _Choice(quantity, place, GIVEN)


def _place_of(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: _Role, wanted: str) -> int:
    exact = [i for i, title in enumerate(titles) if title == wanted.strip()]
    alike = exact or [i for i, (name, _) in enumerate(named) if name and name == _name_and_unit(wanted)[0]]
    if len(alike) == 1:
        return alike[0]
    if not alike and wanted.isascii() and wanted.isdigit() and len(wanted) < 5 and 1 <= int(wanted) <= len(titles):
        return int(wanted) - 1
    listed = ", ".join(shown(title) for title in titles[:12])
    problem = f"{shown(wanted)} names {len(alike)} columns" if alike else f"{shown(wanted)} is no column"
    expected = f"a number from 1 to {len(titles)}, or one of {listed}"
    raise NoColumn(f"{table.path}: --{role.option}-column", problem, expected)


def _quantity_of_unit(quantities: Sequence[Quantity], unit: str) -> Quantity | None:
    """The quantity that a unit belongs to; none for a bare number, which may be a strain or a stretch."""
    if units.factor(units.NUMBER, unit) is not None:
        return None
    return next((quantity for quantity in quantities if units.factor(quantity.units, unit) is not None), None)


# ---- units


def _column(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: _Role, choice: _Choice) -> Column:
    unit, title = named[choice.place][1], titles[choice.place]
    where = f"{table.path}: {shown(title or f'column {choice.place + 1}')}"
    factor = _factor(where, choice.quantity, unit, role)
    how = choice.how if unit or choice.quantity.bare else GIVEN
    return Column(choice.quantity, choice.place, title, unit or role.given or "1", factor, how, choice.alike)


def _factor(where: str, quantity: Quantity, unit: str, role: _Role) -> float:
    given = role.given
    listed = f"one of {', '.join(quantity.units)}"
    if units.ambiguous(unit) and quantity in LOADS:
        choices = [name for name in quantity.units if name.lower() == unit.lower()]
        if given in choices:
            return quantity.units[given]
        problem = f"unit {shown(unit)} may stand for milli or for mega"
        raise UnknownUnit(where, quantity.name, role.unit_option, choices or list(quantity.units), problem)
    expected = None if given is None else units.factor(quantity.units, given)
    if given is not None and expected is None:
        raise BadInput(where, f"a {quantity.name}, but {role.unit_option} says {shown(given)}", listed)
    if unit:
        factor = units.factor(quantity.units, unit)
        if factor is None:
            raise BadInput(where, f"unit {shown(unit)}", listed)
        if expected is not None and expected != factor:
            raise BadInput(where, f"unit {shown(unit)}, but {role.unit_option} says {given}", "one and the same unit")
        return factor
    if expected is not None:
        return expected
    if quantity.bare:
        return 1.0
    raise UnknownUnit(where, quantity.name, role.unit_option, list(quantity.units))
