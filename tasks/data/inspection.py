"""What a file is taken for, before anything is written: its columns, units and sizes, and what must be asked."""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.apart_by_columns import told_apart, told_apart_without_times
from sinew.tasks.data.chosen_sheet import of_sheet
from sinew.tasks.data.column_titles import names_and_units
from sinew.tasks.data.columns import Column, alike_places, partly
from sinew.tasks.data.curves import check_times
from sinew.tasks.data.exports import Reading, length_taken
from sinew.tasks.data.factors import is_signal
from sinew.tasks.data.heads import Row
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.layout import NoTable
from sinew.tasks.data.length_columns import contradiction, length_beside, lengths_at_zeros, numbers_of
from sinew.tasks.data.other_tests import refuse_other_tests
from sinew.tasks.data.possible_columns import counts, holds_numbers, titles_by_unit
from sinew.tasks.data.quantities import DISPLACEMENT, LENGTH, LOADS, MOTIONS, POSITION, STRAIN, STRESS, STRETCH
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks, which_columns
from sinew.tasks.data.restarts import rows_again, tests_below
from sinew.tasks.data.roles import TIMED
from sinew.tasks.data.rows_of_results import (
    refuse_oscillations,
    refuse_results_by_titles,
    refuse_rows_of_results,
    refuse_shear,
)
from sinew.tasks.data.rows_of_words import says_more
from sinew.tasks.data.same_times import behind_clock
from sinew.tasks.data.several import FEWEST_ROWS, beside, blocks_of_tests, go_on, units_alone
from sinew.tasks.data.signs import new_zeros
from sinew.tasks.data.sizes import SIZES, contradiction_of_areas, contradiction_without_unit, read_sizes
from sinew.tasks.data.sizes_in_names import sizes_in_name
from sinew.tasks.data.sizes_of_tests import sizes_in_columns
from sinew.tasks.data.tables import Source, Table, read_source, tables_of
from sinew.tasks.data.told import as_told
from sinew.tasks.data.units import usual

_TRUE = re.compile(r"\b(?:true|wahre?|vraie?|verdader[oa]|cauchy)\b", re.IGNORECASE)  # strains and stresses


@dataclass(frozen=True)
class Inspection:
    """One file. ``columns``: time, motion and load, as far as they are recognised.

    ``first``: time (s), motion (mm, or 1) and load (N, or MPa) in the first row of the first test, ``peak`` the load of
    largest magnitude, as in the file. ``specimens``: tests in the file. ``questions``: what the file does not tell, and
    why an import would refuse it. ``remarks``: what a person should check. ``recordings``: the tests as in the file, if
    it can be imported.
    """

    path: Path
    sheet: str
    columns: tuple[Column | None, Column | None, Column | None]
    sizes: dict[str, float | None]
    rows: int
    first: tuple[float | None, float | None, float | None]
    peak: float | None
    specimens: int
    questions: tuple[str, ...]
    remarks: tuple[str, ...]
    recordings: tuple[Recording, ...] = ()

    def content(self) -> dict[str, Any]:
        """As JSON. Columns have the keys ``column``, ``unit`` (None if the file does not give it)."""
        motion, load = self.columns[1], self.columns[2]
        stress = load is not None and load.quantity is STRESS
        named = {"time": self.columns[0], _kind(motion): motion, "stress" if stress else "force": load}
        found: dict[str, Any] = {"file": str(self.path)} | ({"sheet": self.sheet} if self.sheet else {})
        found |= {
            name: None
            if column is None
            else {"column": _title(column), "unit": usual(column.quantity.units, column.unit) or None}
            for name, column in named.items()
        }
        found |= {f"{name}_mm2" if name == "area" else f"{name}_mm": size for name, size in self.sizes.items()}
        found |= {"rows": self.rows, "first": list(self.first)}
        found |= {"peak_stress_MPa" if stress else "peak_force_N": self.peak}
        return found | {"specimens": self.specimens, "ask": list(self.questions), "remarks": list(self.remarks)}


def inspect(path: Path, reading: Reading | None = None) -> Inspection:
    """What a file is taken for, with what a person says of it in ``reading``.

    Raises :class:`BadInput` for a file without a table of numbers.
    Of several tables, the first counts that has the most columns of a test; those with the same titles are further
    specimens.
    """
    reading = reading or Reading()
    hints = reading.all_hints
    source = of_sheet(read_source(path), hints.sheet)
    table, columns, problems, titles = _best(source, hints)
    if not any(columns) and len(source.fewest) > 1:  # two columns of another sheet may be the test
        with suppress(NoTable):
            narrow = _best(replace(source, fewest=source.fewest[1:]), hints)
            table, columns, problems, titles = narrow if any(narrow[1]) else (table, columns, problems, titles)
    numbers, rows = _numbers(table, columns)
    _refuse_no_test(table, columns, numbers[:rows], hints)
    values, differs = _sizes(table, columns, numbers[:rows], hints)
    given = {"length": reading.length_mm, "area": reading.area_mm2}
    values |= {name: size for name, size in given.items() if size is not None}
    doubt = _doubt(table, columns, values["length"], numbers[:rows]) if reading.length_mm is None else ""
    if doubt:
        values["length"] = None
    one_below = titles[table.common_titles] if any(table.common_titles) else 1
    if one_below > 1 and _go_on(source, table, columns):
        one_below = 1
    below, times = _below(table, columns, numbers[:rows], hints)
    recordings, refusal = ((), ()) if problems or times else _as_read(source, hints)
    if len(recordings) > 1:  # a table of results may have a row for each
        known = {name: size.mm for name, size in recordings[0].sizes.items() if not (doubt and name == "length")}
        values = _with_area({name: known.get(name) if mm is None else mm for name, mm in values.items()})
    told = [as_told(one, hints) for one in recordings]
    notes = tuple(dict.fromkeys(remark for one in told for remark in (*remarks(one), *length_taken(one, reading))))
    if not recordings:
        notes = tuple(which_columns(columns))
    if recordings and columns[0] is None:  # a person has told how times run
        columns = recordings[0].columns
        numbers[0, 0] = recordings[0].numbers[0, 0]
    if differs and reading.area_mm2 is None:
        values["area"] = None
    questions = (*problems, *times, *refusal, *_missing(path, values, columns, doubt, differs))
    first = [float(number) if rows and np.isfinite(number) else None for number in numbers[0]]
    load = recordings[0].numbers[:, 2] if len(recordings) == 1 else numbers[:rows, 2]
    if len(recordings) == 1:  # of several tables that go on
        rows = len(recordings[0].rows)
    elif any(columns):
        rows = int(np.isfinite(numbers[:rows]).any(axis=1).sum())  # tests may stand apart by empty rows
    else:
        rows = sum(any(row) for _, row in table.rows)
    peak = float(load[np.nanargmax(np.abs(load))]) if np.isfinite(load).any() else None
    specimens = one_below * below * (1 if hints.columns_given else beside(table, columns))
    if hints.tables == "join" and recordings:
        specimens = len(recordings)
    start = (first[0], first[1], first[2])
    return Inspection(path, table.sheet, columns, values, rows, start, peak, specimens, questions, notes, recordings)


def _refuse_no_test(
    table: Table, columns: Sequence[Column | None], numbers: np.ndarray[Any, Any], hints: Hints
) -> None:
    """Raises :class:`BadInput` for a table of anything else than a test, as of results; ``numbers`` ``[t, 3]``."""
    refuse_oscillations(table)
    refuse_shear(table, *columns[1:])
    refuse_other_tests(table, columns, hints)
    if not hints.columns_given:
        _refuse_too_few_columns(table, columns)
        if columns[0] is None and columns[2] is None:
            refuse_results_by_titles(table)
    if len(numbers) < FEWEST_ROWS:
        numbered = "1 row" if len(numbers) == 1 else f"{len(numbers)} rows"
        raise BadInput(table.path, f"{numbered} of numbers", f"a test, which has at least {FEWEST_ROWS}")
    if columns[0] is None and columns[1] is not None and not hints.timing.given:
        refuse_rows_of_results(table, columns[1].quantity.name, numbers[:, 1], numbers[:, 2])


def _refuse_too_few_columns(table: Table, columns: Sequence[Column | None]) -> None:
    """Raises :class:`BadInput` for a table that has none of the columns of a test, or cannot have all of them."""
    known = [one for one in columns if one is not None]
    alone = (
        len(known) == 1 and len(known[0].title) == 1 and not known[0].unit
    )  # "f" may be anything, but not beside "t"
    if any(table.titles) and (alone or not known):
        raise _no_test(table)
    missing = [name for name, column in zip(("displacement", "force"), columns[1:], strict=True) if column is None]
    taken = {place for one in columns if one is not None for place in (one.place, *alike_places(table, one))}
    _, named = names_and_units(table)
    free = [
        place
        for place, (_, unit) in enumerate(named)
        if place not in taken and not is_signal(unit) and holds_numbers(table, place) and not counts(table, place)
    ]
    if len(free) < len(missing):
        others = f"{len(free) or 'no'} other column{'' if len(free) == 1 else 's'} of numbers"
        problem = f"no title names {' or '.join(missing)}, and there {'is' if len(free) == 1 else 'are'} {others}"
        raise BadInput(table.path, problem, "a file with time, displacement and force")


def _no_test(table: Table) -> BadInput:
    """The refusal of a table whose titles are none of a test."""
    listed = ", ".join(title or "(no name)" for title in table.titles[:12])
    if any(is_signal(unit) for _, unit in names_and_units(table)[1]):
        expected = "forces and displacements: multiply the signals of sensors by their factors first"
    elif any(_TRUE.search(title) for title in table.titles):
        expected = "engineering strain and stress, which are of the first sizes"
    else:
        options = "--time-column, --displacement-column and --force-column NAME or NUMBER"
        expected = f"titles of time, displacement and force, or {options}{_by_units(table)}"
    return BadInput(table.path, f"no columns of a test among {shown(listed, 80)}", expected)


def _by_units(table: Table) -> str:
    """Which columns may be motion and load by their units, in words; nothing where only one of both is told."""
    found = [titles_by_unit(table.titles, quantities)[:2] for quantities in (MOTIONS, LOADS)]
    each = [" or ".join(map(shown, titles)) for titles in found]
    return f" (by their units, {each[0]} and {each[1]})" if all(each) else ""


def _best(
    source: Source, hints: Hints
) -> tuple[Table, tuple[Column | None, Column | None, Column | None], tuple[str, ...], Counter[Row]]:
    """The first table with the most columns of a test, these, a line on each other one, and how often titles come.

    Raises :class:`NoTable` if there is none.
    """
    recognised = -1
    titles: Counter[Row] = Counter()
    for one in tables_of(source):  # only the best is kept: each may reach to the end of the file
        titles[one.common_titles] += len(one.rows) >= FEWEST_ROWS or not titles[one.common_titles]
        found = partly(one, hints)
        alone = not hints.columns_given and units_alone(one, found[0])
        count = 0 if alone else sum(column is not None for column in found[0])
        if count > recognised:
            recognised, table, (columns, problems) = count, one, found
    return table, columns, problems, titles


def _as_read(source: Source, hints: Hints) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """The tests in the file, or why it cannot be imported as it is."""
    try:
        recordings = read_recordings(source, hints, first_of_alike=True)
        for one in recordings:
            check_times(one)
            as_told(one, hints)
    except BadInput as error:
        return (), (str(error).removeprefix(f"{source.path}: "),)
    return tuple(recordings), ()


def _go_on(source: Source, table: Table, columns: Sequence[Column | None]) -> bool:
    """Whether times go on from each table with the titles of this one to the next: they are one test then."""
    time = columns[0]
    if time is None:
        return False
    times: list[np.ndarray[Any, Any]] = []
    for one in tables_of(source):
        if one.common_titles != table.common_titles or len(one.rows) < FEWEST_ROWS:
            continue
        between = says_more(one.header[one.own :], table.header) if times else False
        named = one.titles[0] != table.titles[0] and time.place != 0
        if one.sheet != table.sheet or between or named:
            return False
        found = one.numbers(time.place) * time.factor
        times.append(found[np.isfinite(found)])
        if not times[-1].size:
            return False
    return go_on(times)


def _below(
    table: Table, columns: Sequence[Column | None], numbers: np.ndarray[Any, Any], hints: Hints
) -> tuple[int, tuple[str, ...]]:
    """How many tests stand one under another in a table, and what must be asked of its times."""
    numbers = numbers[: len(numbers) - behind_clock(numbers)]
    time_s = numbers[:, 0]
    if hints.tests_by is not None:
        return len(blocks_of_tests(table, time_s.size, hints.tests_by)), ()
    back = [int(at) + 1 for at in np.flatnonzero(np.diff(time_s) < 0)]
    taken = [column.place for column in columns if column is not None]
    again = rows_again(numbers)
    apart = None
    if hints.test_column is None:
        tell = told_apart if back else told_apart_without_times
        apart = tell(table, time_s.size, back or again, taken)
    told = apart is not None or hints.test_column is not None or hints.cycle_column is not None
    if again and not told:
        return tests_below(table, again, hints, timed=bool(back))
    if back and hints.cycle_column is None:
        row = table.rows[back[0]][0]
        remedy = f"one for each '{apart.title}'? {apart.option}" if apart else "one file for each"
        question = (
            f"time: goes back {len(back)} times, first in row {row}: several tests or cycles in one table? {remedy}"
        )
        return (apart.tests if apart else 1), (question,)
    if apart is not None:
        question = f"{apart.count:,} tests in one table, one for each '{apart.title}'? {apart.option}"
        return apart.tests, (question,)
    if time_s.size > 1 and not np.ptp(time_s) and not hints.timing.given:
        return 1, (f"time: the same in all rows; --time-column{TIMED}",)
    return 1, ()


def _title(column: Column) -> str:
    return column.title or f"column {column.place + 1} (no title)"


def _kind(motion: Column | None) -> str:
    """The key of a motion: a position or a length is one way to tell a displacement."""
    if motion is None or motion.quantity in (POSITION, LENGTH):
        return "displacement"
    return motion.quantity.name


def _numbers(table: Table, columns: Sequence[Column | None]) -> tuple[np.ndarray[Any, Any], int]:
    """Numbers ``[t, 3]`` (NaN where a cell has none) and how many rows there are, without empty ones at the end."""
    found = np.full((len(table.rows), 3), np.nan)
    for i, column in enumerate(columns):
        if column is not None:
            found[:, i] = numbers_of(table, column, range(len(table.rows)))
    known = np.isfinite(found).any(axis=1) if any(columns) else [any(row) for _, row in table.rows]
    filled = np.flatnonzero(known)
    return found, int(filled[-1]) + 1 if filled.size else 0


def _sizes(
    table: Table, columns: Sequence[Column | None], numbers: np.ndarray[Any, Any], hints: Hints
) -> tuple[dict[str, float | None], str]:
    """The sizes (mm, mm2) that a file tells, and what contradicts each other in its cross-sections, or nothing."""
    places = [column.place for column in columns if column is not None]
    alone = beside(table, columns) == 1
    told = sizes_in_columns(table, range(max(len(numbers), 1)), places) if alone else {}
    told |= read_sizes(table.header, table.own, table.decimal)
    values: dict[str, float | None] = {
        name: told[name].mm if name in told else None for name in (*SIZES, "diameter", "area")
    }
    motion = columns[1]
    if values["length"] is None and motion is not None and motion.quantity is LENGTH and len(numbers):
        values["length"] = float(numbers[0, 1])
    if values["length"] is None and motion is not None and motion.quantity is DISPLACEMENT:
        zeros = new_zeros(numbers) if hints.preload is not None else ()
        first = zeros[-1] if zeros and hints.preload == "leave-out" else 0
        end = zeros[0] if zeros and hints.preload == "keep" else None
        beside_it = length_beside(table, motion, numbers[first:end, 1], first)
        values["length"] = None if beside_it is None else beside_it.mm
    return _with_area(values), contradiction_of_areas(told) or contradiction_without_unit(told)


def _with_area(values: dict[str, float | None]) -> dict[str, float | None]:
    """Sizes with the cross-section that the others give, where nothing else tells it."""
    width, thickness, diameter = (values[name] for name in ("width", "thickness", "diameter"))
    if values["area"] is not None:
        return values
    if diameter is not None:
        return values | {"area": float(np.pi / 4 * diameter**2)}
    return values | {"area": width * thickness} if width is not None and thickness is not None else values


def _two_lengths(table: Table, motion: Column, numbers: np.ndarray[Any, Any]) -> str:
    """The question for a gauge length that is another one after a preload, or nothing."""
    zeros = new_zeros(numbers)
    if not zeros:
        return ""
    before, after = lengths_at_zeros(table, motion, numbers[:, 1], zeros)
    if before is None or after is None:
        return ""
    both = f"{before.mm:g} mm by '{before.text}', and {after.mm:g} mm where it is set to zero again"
    return f"length: {both}; --length-mm"


def _doubt(
    table: Table, columns: Sequence[Column | None], length_mm: float | None, numbers: np.ndarray[Any, Any]
) -> str:
    """The question for a length that contradicts the numbers, or nothing: it is displacement over strain."""
    motion = columns[1]
    if motion is None or motion.quantity in (POSITION, LENGTH):
        return ""
    if length_mm is None:
        return "" if motion.quantity is STRAIN else _two_lengths(table, motion, numbers)
    both = contradiction(table, range(len(table.rows)), motion, length_mm)
    return f"length: {both}; --length-mm" if both else ""


def _missing(
    path: Path, values: dict[str, float | None], columns: Sequence[Column | None], doubt: str, differs: str
) -> Iterable[str]:
    proposed = [f"{size} {mm:g} mm" for size, mm in sizes_in_name(path.stem).items()]
    perhaps = f", but its name may: {', '.join(proposed)}" if proposed else ""
    motion = columns[1]
    if values["length"] is None and (doubt or motion is None or motion.quantity not in (STRAIN, STRETCH)):
        yield doubt or f"length: the file does not give it{perhaps}; --length-mm"
    load = columns[2]
    if values["area"] is None and (load is None or load.quantity is not STRESS):
        given = f"gives {differs}" if differs else f"does not give it{perhaps}"
        yield f"cross-section: the file {given}; --area-mm2"
