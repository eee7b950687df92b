"""Which column of a table holds what, in which unit, and how sure that is.

Columns are recognised by their titles. Units are read or given, never guessed: a wrong unit looks right, and results
that rest on it are worthless.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units, words
from sinew.tasks.data.clocks import columns_by_clock
from sinew.tasks.data.column_titles import check_width, names_and_units, places_named
from sinew.tasks.data.factors import factor_of, is_angle, is_signal
from sinew.tasks.data.heads import Row
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.missing_columns import by_title_or_number, no_column, which_is
from sinew.tasks.data.possible_columns import (
    changes,
    follows,
    hardly_moves,
    holds_numbers,
    in_volts,
    possible,
    untimed,
)
from sinew.tasks.data.quantities import (
    DISPLACEMENT,
    FORCE,
    LENGTH,
    POSITION,
    STRAIN,
    STRESS,
    STRETCH,
    TIME,
    Quantity,
    ratio_of_lengths,
)
from sinew.tasks.data.questions import NoColumn, Unclear, UnknownUnit
from sinew.tasks.data.roles import Role, by_number, roles_of
from sinew.tasks.data.rows_of_results import refuse_shear_column
from sinew.tasks.data.tables import Table
from sinew.tasks.data.titles import known_within, name_and_unit, of_several_specimens

NOWHERE = -1
SURE, LIKELY, GIVEN = "sure", "likely", "as you said"


@dataclass(frozen=True)
class Column:
    """A column and what it is taken for. ``unit`` is that of the file, ``how`` says how sure the choice is.

    ``alike``: titles of columns that could be taken as well as this one. ``place`` is ``NOWHERE`` for times that are
    not in the file.
    """

    quantity: Quantity
    place: int
    title: str
    unit: str
    factor: float
    how: str
    alike: tuple[str, ...] = ()

    @property
    def in_words(self) -> str:
        """``force from 'Load' in kN``."""
        return f"{self.quantity.name} from '{self.title or self.place + 1}' in {self.unit}"

    def is_as(self, other: "Column") -> bool:
        """Whether another table has this column in the same place, whatever stands beside it."""
        return (self.quantity, self.place, self.title, self.unit) == (
            other.quantity, other.place, other.title, other.unit,
        )  # fmt: skip


@dataclass(frozen=True)
class _Choice:
    quantity: Quantity
    place: int
    how: str
    alike: tuple[int, ...] = ()  # the places of columns that could be taken as well

    @property
    def places(self) -> tuple[int, ...]:
        return (self.place, *self.alike)


def recognise(table: Table, hints: Hints, *, first_of_alike: bool = False) -> tuple[Column, Column, Column]:
    """The columns of time, motion and load. Of columns with one title, the first counts if ``first_of_alike``.

    Raises :class:`NoColumn` if one is missing, :class:`UnknownUnit` if a person must tell its unit, and
    :class:`BadInput` if units contradict each other or a choice is not clear.
    """
    titles, named = names_and_units(table)
    roles = roles_of(hints)
    choices = _choices(table, titles, named, roles, hints)
    if table.titles and not by_number(hints):
        check_width(table)
    for choice, role in zip(choices, roles, strict=True):
        if choice.alike and (not first_of_alike or of_several_specimens([titles[at] for at in choice.places])):
            raise _which_of(table, titles, choice, role)
    time, motion, load = (
        _column(table, titles, named, role, choice) for role, choice in zip(roles, choices, strict=True)
    )
    if time.place == NOWHERE:
        time = replace(time, title=str(hints.timing))
    if len({time.place, motion.place, load.place}) < 3:
        expected = "a column for each; name them by --time-column and the like"
        raise BadInput(table.path, "one column is taken for two things", expected)
    return time, motion, load


def _which_of(table: Table, titles: Row, choice: _Choice, role: Role) -> Unclear:
    """The question which of several columns is meant; by their numbers, where they have one title."""
    places = choice.places
    listed, choices = " and ".join(shown(titles[place]) for place in places[:2]), by_title_or_number(titles, places)
    both = "may both" if len(places) == 2 else f"and {len(places) - 2} more may each"
    option = f"--{role.option}-column"
    return Unclear(
        str(table.path),
        f"{listed} {both} be the {choice.quantity.name}",
        f"{option}, one of {', '.join(map(shown, choices))}",
        what=choice.quantity.name,
        which="which column?",
        option=option,
        choices=choices,
    )


def partly(
    table: Table, hints: Hints, *, only: Quantity | None = None
) -> tuple[tuple[Column | None, Column | None, Column | None], tuple[str, ...]]:
    """The columns of time, motion and load that can be recognised, and a line on each that cannot.

    A column whose unit only a person can tell has the unit ``""`` and the factor 1. ``only``: motion or load is this.
    """
    titles, named = names_and_units(table)
    found: list[Column | None] = []
    problems = []
    roles: Sequence[Role] = roles_of(hints)
    if only is not None:
        roles = [replace(role, quantities=(only,)) if only in role.quantities else role for role in roles]
    try:
        choices = _of_one_clock(table, titles, named, roles, [_choose(table, titles, named, role) for role in roles])
    except BadInput:
        choices = []  # each by itself, for what is said of it
    for number, role in enumerate(roles):
        try:
            choice = choices[number] if choices else _choose(table, titles, named, role)
        except BadInput as error:
            found.append(None)
            if role.quantities != (TIME,) or not hints.timing.given:
                here = _in_table(table, titles, named, role, hints)
                remedy = error.expected if isinstance(error, UnknownUnit) else here.remedy
                problems.append(f"{role.name}: {error.problem}; {remedy}")
            continue
        try:
            found.append(_column(table, titles, named, role, choice))
            if of_several_specimens([titles[place] for place in choice.places]):
                unclear = _which_of(table, titles, choice, role)
                problems.append(f"{role.name}: {unclear.problem}; {unclear.expected}")
        except BadInput as error:
            title = titles[choice.place]
            alike = tuple(titles[place] for place in choice.alike)
            found.append(Column(choice.quantity, choice.place, title, "", 1.0, choice.how, alike))
            remedy = role.unit_option if isinstance(error, UnknownUnit) else error.expected
            problems.append(f"unit of '{title}' ({choice.quantity.name}): {error.problem}; {remedy}")
    return (found[0], found[1], found[2]), tuple(problems)


def alike_places(table: Table, column: Column) -> list[int]:
    """The columns with the name of this one, and a unit of the same quantity or none, if they may be of other tests."""
    _, named = names_and_units(table)
    name = named[column.place][0]
    return [
        place
        for place, (other, unit) in enumerate(named)
        if other == name and name and possible(column.quantity, other, unit, unit)
    ]


def in_place(table: Table, hints: Hints, column: Column, place: int) -> Column:
    """The column of another test with the same name, in its own unit. Raises :class:`UnknownUnit`."""
    titles, named = names_and_units(table)
    role = next(role for role in roles_of(hints) if column.quantity in role.quantities)
    return _column(table, titles, named, role, _Choice(column.quantity, place, column.how))


# ---- the choice of a column


def _choices(
    table: Table, titles: Row, named: Sequence[tuple[str, str]], roles: Sequence[Role], hints: Hints
) -> list[_Choice]:
    """A column for each role. Times are nowhere if no column holds them and a person has told how they run."""
    found: list[_Choice] = []
    missing: list[tuple[Role, NoColumn]] = []
    for role in roles:
        try:
            found.append(_choose(table, titles, named, role))
        except NoColumn as none:
            if role.quantities == (TIME,) and hints.timing.given:
                found.append(_Choice(TIME, NOWHERE, GIVEN))
            else:
                missing.append((role, none))
    if missing:
        asked = [_in_table(table, titles, named, role, hints) for role, _ in missing]
        spare = len(titles) - sum(one.place != NOWHERE for one in found)
        of_person = [problem for role, problem in missing if role.wanted]
        problem = of_person[0] if of_person else no_column(table, titles, asked, spare=spare)
        problem.alone = all(choice.place == NOWHERE for choice in found)
        free = {place for place, _ in enumerate(titles) if holds_numbers(table, place)} - {one.place for one in found}
        problem.question = None if of_person or not free else which_is(table, titles, sorted(free), missing[0][0])
        raise problem
    return _of_one_clock(table, titles, named, roles, found)


def _in_table(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: Role, hints: Hints) -> Role:
    """The role, which knows whether columns have titles and, if it is that of time, whether no speed tells it."""
    role = replace(role, titled=any(table.titles))
    if role.quantities != (TIME,):
        return role
    try:
        motion = _choose(table, titles, named, roles_of(hints)[1])
    except BadInput:
        return role
    return replace(role, without_speed=untimed(table, motion.place))


def _of_one_clock(
    table: Table, titles: Row, named: Sequence[tuple[str, str]], roles: Sequence[Role], found: list[_Choice]
) -> list[_Choice]:
    """The same choices, of columns that belong to the same times, where these have all that a test needs."""
    time = found[0].place
    own = range(0) if time == NOWHERE else columns_by_clock(named, time)[time]
    if time == NOWHERE or all(choice.place in own for choice in found):
        return found
    inside = [column if place in own else ("", "") for place, column in enumerate(named)]
    try:
        others = [_choose(table, titles, inside, role) for role in roles[1:]]
    except (NoColumn, UnknownUnit):
        return found  # one test of several instruments, or columns that a person names
    return [found[0], *others]


def _choose(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: Role) -> _Choice:
    if role.wanted:
        return _chosen_by_person(table, titles, named, role)
    found = [
        (_rank(table, role, number, place, *column), place, quantity)
        for number, quantity in enumerate(role.quantities)
        for place, column in enumerate(named)
        if column[0] in role.titles(quantity)
        and possible(quantity, column[0], column[1] or role.given or "", column[1])
    ]
    still: set[int] = set()
    if len(found) > 1 and DISPLACEMENT in role.quantities:  # an extensometer that is not used says 0 all the time
        still = {at for _, at, one in found if one is DISPLACEMENT and named[at][0] not in words.EXTENSOMETER}
        found = [one for one in found if changes(table, one[1])] or found
        still -= {at for _, at, _ in found}
    loose = _loose(table, named, found)
    found = [one for one in found if one[1] not in loose]
    known = [one for one in found if units.is_unit(named[one[1]][1])]
    found = [one for one in found if not known or not in_volts(*named[one[1]])]
    if not found:
        raise no_column(table, titles, (role,), spare=len(titles))
    rank, place, quantity = min(found, key=lambda one: one[:2])
    if quantity is STRETCH and _is_strain(table, place, named[place][0], named[place][1] or role.given or "", role):
        quantity = STRAIN
    machine = (DISPLACEMENT, POSITION) if named[place][0] in words.EXTENSOMETER else ()
    others = loose | {other for same, other, one in found if same == rank or one in machine}
    if quantity is DISPLACEMENT and not named[place][1]:
        others |= {at for _, at, one in found if one is STRAIN and at != place and hardly_moves(table, place, at)}
    if quantity in (STRAIN, STRETCH):  # perhaps of a camera, while the crosshead rested
        others |= still
    title, unit = named[place]
    if title in words.ALONG_AXES:  # in a shear test, the force is not that along the height
        others |= {at for at, (name, _) in enumerate(named) if name in words.ALONG_AXES}
    if not unit:
        others |= {other for _, other, _ in found if named[other][0] in words.EXTENSOMETER and not named[other][1]}
    doubtful = title.startswith("(") or title in words.DOUBTFUL or quantity not in (TIME, DISPLACEMENT, FORCE)
    whole = name_and_unit(titles[place])[0]
    doubtful = doubtful or bool(known_within(whole, (title,)))
    same = [STRESS] if quantity is FORCE else [LENGTH] if quantity is DISPLACEMENT else []  # they say it once more
    rivals = _without_repeated([(one, named[at]) for _, at, one in found if one not in same], named)
    sure = len(rivals) == 1 and not doubtful
    return _Choice(quantity, place, SURE if sure else LIKELY, tuple(sorted(others - {place})))


def _loose(table: Table, named: Sequence[tuple[str, str]], found: Sequence[tuple[object, int, Quantity]]) -> set[int]:
    """Which of the columns ``found`` are of extensometers that do not move with the machine, where that moves."""
    sensors = {at for _, at, _ in found if named[at][0] in words.EXTENSOMETER}
    machines = [at for _, at, one in found if one in (DISPLACEMENT, POSITION) and at not in sensors]
    machine = next((at for at in machines if units.is_unit(named[at][1]) and changes(table, at)), None)
    return set() if machine is None else {at for at in sensors if not follows(table, at, machine)}


def _without_repeated(
    found: Sequence[tuple[Quantity, tuple[str, str]]], named: Sequence[tuple[str, str]]
) -> Sequence[tuple[Quantity, tuple[str, str]]]:
    """What is found, once where each of several tests beside each other has it, and times of its own."""
    clocks = sum(name in words.TIME for name, _ in named)
    return found[:1] if len(found) == clocks and all(one == found[0] for one in found) else found


def _rank(
    table: Table, role: Role, number: int, place: int, name: str, unit: str
) -> tuple[bool, int, int, bool, bool, int]:
    """The lower, the rather a column is meant: by its quantity, whether it has a unit, and how usual its title is.

    A title that is only a unit comes last. The motion of an extensometer comes before that of the machine if the file
    tells its unit, else behind it. A clock may stand beside the time since the start, which is finer.
    """
    quantity = role.quantities[number]
    extensometer = 0 if name not in words.EXTENSOMETER else -1 if unit and not in_volts(name, unit) else 1
    last = (name.startswith("("), extensometer)
    no_unit = not (unit or role.given or quantity.bare)
    return *last, number, table.has_clock(place), no_unit, role.titles(quantity).index(name)


def _chosen_by_person(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: Role) -> _Choice:
    wanted, place = _place_of(table, titles, named, role)
    name, unit = named[place]
    refuse_shear_column(f"{table.path}: --{role.option}-column", titles[place])
    if wanted.isdigit() and (other := _of_another_role(name, role)):
        problem = f"column {wanted} is {shown(titles[place])}, a {other}"
        raise BadInput(f"{table.path}: --{role.option}-column", problem, "its title, if it is meant")
    measured = (unit if units.is_unit(unit) else role.given or unit) or ""
    fitting = [q for q in role.quantities if name in role.titles(q)]
    quantity = next((q for q in fitting if possible(q, name, measured, unit)), None)
    if quantity is None and STRAIN in role.quantities and units.factor(units.FRACTION, measured) is not None:
        quantity = _ratio(table, place, measured)
    quantity = quantity or _quantity_of_unit(role.quantities, measured) or next(iter(fitting), None)
    if quantity is None and (is_signal(unit) or is_angle(measured) or is_angle(unit)):
        quantity = role.quantities[0]  # which is refused with its unit
    quantity = STRAIN if quantity is STRETCH and _is_strain(table, place, name, measured, role) else quantity
    if quantity is None:
        raise UnknownUnit(f"{table.path}: column {shown(wanted)}", role.name, role.unit_option, role.choices)
    return _Choice(quantity, place, GIVEN)


def _ratio(table: Table, place: int, unit: str) -> Quantity | None:
    """Whether ratios of lengths are stretches or strains; in percent, strains unless they begin near 100 %."""
    factor = units.factor(units.FRACTION, unit) or 1.0
    numbers = (table.number(row, place) for row in range(len(table.rows)))
    found = ratio_of_lengths(None if one is None else factor * one for one in numbers)
    return STRAIN if found is None and factor != 1.0 else found


def _is_strain(table: Table, place: int, name: str, unit: str, role: Role) -> bool:
    """Whether what is called a stretch begins at 0, as a strain does: no length is 0."""
    return name in words.STRETCH_OR_STRAIN and STRAIN in role.quantities and _ratio(table, place, unit) is STRAIN


def _of_another_role(name: str, role: Role) -> str:
    """The quantity of another role that this name is surely of; empty for none."""
    others = [one for each in roles_of(Hints()) if each.name != role.name for one in each.quantities]
    if name in words.DOUBTFUL or any(name in role.titles(one) for one in role.quantities):
        return ""
    return next((one.name for one in others if name in one.titles), "")


def _place_of(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: Role) -> tuple[str, int]:
    """The first title that the file has of those that a person gives, and its place."""
    found = [(wanted, places_named(titles, named, wanted)) for wanted in role.wanted]
    for wanted, places in found:
        if len(places) == 1:
            return wanted, places[0]
    wanted, places = next((one for one in found if one[1]), found[0])
    problem = f"{shown(wanted)} names {len(places)} columns" if places else f"{shown(wanted)} is no column"
    if len(found) > 1 and not places:
        problem = f"none of {', '.join(map(shown, role.wanted))} is a column"
    expected = f"a number from 1 to {len(titles)}, or one of {', '.join(map(shown, titles[:12]))}"
    again = "" if places or wanted.isdigit() else f"; repeat --{role.option}-column where files have other titles"
    raise NoColumn(f"{table.path}: --{role.option}-column", problem, f"{expected}{again}")


def _quantity_of_unit(quantities: Sequence[Quantity], unit: str) -> Quantity | None:
    """The quantity that a unit belongs to; none for a ratio of lengths, which may be a strain or a stretch."""
    if units.factor(units.FRACTION, unit) is not None:
        return None
    return next((quantity for quantity in quantities if units.factor(quantity.units, unit) is not None), None)


# ---- units


def _column(table: Table, titles: Row, named: Sequence[tuple[str, str]], role: Role, choice: _Choice) -> Column:
    if choice.place == NOWHERE:
        return Column(TIME, NOWHERE, "", "s", 1.0, GIVEN)
    unit, title = named[choice.place][1], titles[choice.place]
    where = f"{table.path}: {shown(title or f'column {choice.place + 1}')}"
    factor = factor_of(where, choice.quantity, unit, role.given, role.unit_option)
    if role.given is not None and not units.is_unit(unit):
        unit = ""  # what stands there is no unit that is known, so a person has told it
    how = choice.how if unit or choice.quantity.bare else GIVEN
    alike = tuple(titles[place] for place in choice.alike)
    return Column(choice.quantity, choice.place, title, unit or role.given or "1", factor, how, alike)
