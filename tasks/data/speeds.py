"""Times of a table that has none: by a rate or a speed that a person tells, or by a column of speeds."""

from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units, words
from sinew.tasks.data.column_titles import names_and_units
from sinew.tasks.data.columns import NOWHERE, Column
from sinew.tasks.data.hints import NO_COLUMN, Hints
from sinew.tasks.data.possible_columns import turns_often
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.several import Block, Columns, place_named
from sinew.tasks.data.tables import Table

OPTION = "--speed-column"
SAME = 0.05  # by how much a speed that is told and one of a column may differ
SHOWN = 4  # speeds in a message
Array = np.ndarray[Any, np.dtype[Any]]


def timed(table: Table, columns: Columns, numbers: Array, hints: Hints, block: Block) -> tuple[Array, tuple[str, ...]]:
    """The numbers ``[t, 3]`` with times by ``hints``, and a note if the file has times of its own, which count.

    Raises :class:`BadInput` where a speed gives no time, and :class:`Unclear` where a column gives other speeds.
    """
    timing = hints.timing
    own = columns[0].place != NOWHERE and np.ptp(numbers[:, 0]) > 0
    if own and (timing.rate_hz is None or not _is_coarse(numbers[:, 0])):
        return numbers, (f"its own times count, not {timing}",)
    rows = range(block.start, block.end)
    speeds = None
    if timing.speed_column is not None:
        speeds = _speeds(table, rows, *_named(table, timing.speed_column), columns[1])
    elif timing.speed is not None and hints.speed_column != NO_COLUMN:
        _refuse_others(table, rows, columns[1], timing.speed)
    times = timing.times(numbers[:, 1], speeds)
    if own:
        _refuse_another_rate(table, numbers[:, 0], times)
    numbers[:, 0] = times
    stays = np.flatnonzero(np.diff(times) <= 0)
    if stays.size:
        where = f"{table.path}: row {table.rows[block.start + int(stays[0]) + 1][0]}"
        raise BadInput(where, "the same motion as in the row before, so a speed gives no time", "--rate-hz")
    if timing.rate_hz is None and (turns := turns_often(numbers[:, 1])):
        problem = f"the motion turns {turns:,} times in {len(numbers):,} rows, so a speed gives no time"
        raise BadInput(table.path, problem, "--rate-hz")
    return numbers, (f"times by {timing}",)


def _is_coarse(times: Array) -> bool:
    """Whether several rows have one time, as by a clock that counts whole seconds."""
    steps = np.diff(times)
    return bool((steps >= 0).all() and (steps == 0).any())


def _refuse_another_rate(table: Table, coarse: Array, times: Array) -> None:
    """Raises :class:`BadInput` where ``times`` by a rate are not those of the file, but for their rounding."""
    rounded = float(np.diff(coarse).max())
    span, counted = float(np.ptp(coarse)), float(np.ptp(times))
    if abs(span - counted) > 2.0 * rounded:
        problem = f"its times span {span:g} s, its rows at this rate {counted:g} s"
        raise BadInput(f"{table.path}: --rate-hz", problem, f"about {(len(times) - 1) / span:.4g} rows per second")


def _named(table: Table, wanted: str) -> tuple[int, str]:
    """The place of a column of speeds, and the unit that a person tells behind its name: ``Speed=mm/min``."""
    name, _, unit = wanted.rpartition("=")
    told = name and wanted.strip() not in table.titles
    return place_named(table, name.strip() if told else wanted, OPTION), unit.strip() if told else ""


def _speeds(table: Table, rows: range, place: int, told: str, motion: Column) -> Array:
    """The speeds ``[t]`` of a column, in mm/s or, for strains and stretches, in 1/s. Raises :class:`BadInput`.

    ``told``: the unit that a person tells, for a column without one.
    """
    titles, named = names_and_units(table)
    own = named[place][1]
    if own and told and _factor(own, motion) != _factor(told, motion):
        problem = f"{shown(titles[place])} has the unit {shown(own)}, {OPTION} says {shown(told)}"
        raise BadInput(table.path, problem, f"{OPTION} without a unit")
    if not (own or told):
        choices = _with_units(titles[place], motion)
        raise Unclear(
            str(table.path),
            f"the unit of the speeds in {shown(titles[place])} is not known",
            f"{OPTION}, one of {', '.join(map(shown, choices))}",
            what="speed",
            which="in which unit?",
            option=OPTION,
            choices=choices,
        )
    factor = _factor(own or told, motion)
    if factor is None:
        problem = f"unit {shown(own or told)} of {shown(titles[place])} is none of a {motion.quantity.name}'s speed"
        raise BadInput(table.path, problem, f"a speed in a unit such as {' or '.join(_usual(motion))}")
    found = np.abs(factor * table.numbers(place)[rows])
    wrong = 1 + np.flatnonzero(~(found[1:] > 0.0))  # nothing moves before the first row
    if wrong.size:
        where = f"{table.path}: row {table.rows[rows[int(wrong[0])]][0]}, {titles[place]}"
        raise BadInput(where, "no speed", "a number other than 0 in each row, or --rate-hz")
    return np.where(found > 0.0, found, 1.0)


def _usual(motion: Column) -> tuple[str, ...]:
    """Usual units of the speed of a motion."""
    return ("1/s", "%/s", "1/min") if "%" in motion.quantity.units else ("mm/s", "mm/min")


def _with_units(title: str, motion: Column) -> tuple[str, ...]:
    return tuple(f"{title}={unit}" for unit in _usual(motion))


def _factor(unit: str, motion: Column) -> float | None:
    """The factor of a unit of speed to mm/s or 1/s; None where it is not one of this motion."""
    plain = "1/s" if unit.replace(" ", "") in ("s-1", "s^-1", "s⁻¹") else unit
    way, _, per = plain.rpartition("/")
    factor, time = units.factor(motion.quantity.units, way.strip() or "1"), units.factor(units.TIME, per.strip())
    return None if factor is None or time is None else factor / time


def _agree(value: float, factor: float | None, told: float) -> bool:
    """Whether a speed of a column is the one that a person tells."""
    return factor is not None and abs(abs(factor * value) - told) <= SAME * told


def _refuse_others(table: Table, rows: range, motion: Column, told: float) -> None:
    """Raises :class:`Unclear` where a column tells another speed than a person did."""
    titles, named = names_and_units(table)
    for place, (name, unit) in enumerate(named):
        if name not in words.SPEEDS:
            continue
        factor, column = _factor(unit, motion) if unit else 1.0, shown(titles[place])
        values = {value for row in rows if (value := table.number(row, place))}
        other = sorted({abs(value) for value in values if not _agree(value, factor, told)})
        if other:
            listed = ", ".join(f"{value:g}" for value in other[:SHOWN]) + (" and more" if len(other) > SHOWN else "")
            those = (titles[place],) if unit else _with_units(titles[place], motion)
            raise Unclear(
                str(table.path),
                f"{column} gives other speeds ({f'{listed} {unit}'.strip()}) than --speed {told:g}",
                f"{OPTION} {' or '.join(map(shown, those))}, or {OPTION} {NO_COLUMN} to use --speed all the same",
                what="speed",
                which=f"by the column {column}, or by --speed ({NO_COLUMN})?",
                option=OPTION,
                choices=(*those, NO_COLUMN),
            )
