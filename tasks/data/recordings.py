"""What the tests of a file recorded: their columns of time, motion and load, and what the file says of them."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.apart_by_columns import refuse_several, told_apart
from sinew.tasks.data.cell_numbers import filled_rows, measured, unread_at_start
from sinew.tasks.data.chosen_sheet import of_sheet
from sinew.tasks.data.columns import NOWHERE, Column, alike_places, recognise
from sinew.tasks.data.further import kept
from sinew.tasks.data.further_tables import has_columns, is_test, left_out_note, may_be_test, unclear_further
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.joined_tables import are_steps, as_one, joined_tables, times_go_on, without_effect
from sinew.tasks.data.layout import NoTable
from sinew.tasks.data.length_columns import Repeats, contradiction, length_beside, lengths_at_zeros, repeats_of
from sinew.tasks.data.marks import refuse_marks
from sinew.tasks.data.other_tests import refuse_other_tests
from sinew.tasks.data.possible_columns import titles_of_numbers
from sinew.tasks.data.quantities import DISPLACEMENT
from sinew.tasks.data.questions import NoColumn, Unclear
from sinew.tasks.data.ragged import refuse_ragged
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.restarts import rows_again, tests_again, without_gaps
from sinew.tasks.data.rows_of_results import Oscillations, refusal_of, refuse_oscillations
from sinew.tasks.data.rows_of_words import cut_off, names_test, says_more, without_words
from sinew.tasks.data.same_times import again, before_clock, behind_clock, is_coarse, spread
from sinew.tasks.data.several import (
    FEWEST_ROWS,
    TABLES,
    Block,
    Columns,
    beside,
    blocks_of_cycles,
    blocks_of_tests,
    columns_of,
    going_on,
    names_beside,
    other_test,
    refuse_results,
    units_alone,
)
from sinew.tasks.data.signs import new_zeros
from sinew.tasks.data.sizes import Size, read_sizes
from sinew.tasks.data.sizes_of_tests import sizes_beside, sizes_by_results, sizes_in_columns, without_others
from sinew.tasks.data.speeds import timed
from sinew.tasks.data.tables import Source, Table, read_source, tables_of
from sinew.tasks.data.text import HUGE

Array = np.ndarray[Any, np.dtype[Any]]
UNITS_ALONE = "units in place of titles, of which several are alike"
UNPADDED = "milliseconds of clock times lack leading zeros (12:58.29 is 12 min 58.029 s); else times would go back"


def read_recordings(file: Path | Source, hints: Hints, *, first_of_alike: bool = False) -> list[Recording]:
    """The tests in a file: those of the first table with columns of time, motion and load, and of all further tables
    with the same titles.

    Tables whose times go on from one to the next are one test. Tests may also stand beside each other, or one under
    another if ``hints.test_column`` tells them apart. Of other columns with one title, the first counts if
    ``first_of_alike``, with a remark; else they are refused.

    A further table with other titles is left out, with a note where it may be a test; where it surely is one, a person
    has to say so.

    Raises :class:`BadInput` naming file, row and column: :class:`UnknownUnit` for a unit that the file does not tell.
    """
    source = of_sheet(file if isinstance(file, Source) else read_source(file), hints.sheet)
    try:
        return _read(source, hints, first_of_alike=first_of_alike)
    except NoColumn:
        if len(source.fewest) == 1:
            raise
        with suppress(NoColumn, NoTable):  # two columns of another sheet may be the test
            return _read(replace(source, fewest=source.fewest[1:]), hints, first_of_alike=first_of_alike)
        raise


def _read(source: Source, hints: Hints, *, first_of_alike: bool) -> list[Recording]:
    """The same, of tables of as many columns as the source asks for."""
    missing: BadInput | None = None
    found: list[tuple[Table, list[Recording]]] = []
    before: list[Table] = []  # with those that are left out
    short, end = 0, ("", 0)
    other: list[Table] = []
    for table in tables_of(source):
        alike = not found or (any(table.common_titles) and table.common_titles == found[0][0].common_titles)
        if not alike and not has_columns(table, hints, found[0][1][0].columns):
            before.append(replace(table, rows=table.rows[:1]))
            inside = table.sheet == end[0] and table.first <= end[1]  # behind words within the first one
            if hints.tables is None and not inside and is_test(table, hints):
                raise unclear_further(before[-1])
            other += [before[-1]] if not inside and may_be_test(table, hints, found[0][0]) else []
            continue  # of another kind
        try:
            columns = recognise(table, hints, first_of_alike=True)
            count = 1 if hints.columns_given else beside(table, columns)
            if not hints.columns_given and units_alone(table, columns):
                raise NoColumn(str(table.path), UNITS_ALONE, "titles of time, displacement and force")
            refuse_results(table, columns, count, hints)
            refuse_oscillations(table)
            refuse_other_tests(table, columns, hints)
            if count == 1 and not first_of_alike:
                columns = recognise(table, hints)
        except (NoColumn, Oscillations) as error:
            missing = missing or refusal_of(table) or error
            continue
        if found and len(table.rows) < FEWEST_ROWS:
            short += 1
            before.append(replace(table, rows=table.rows[:1]))
            continue
        table, words = without_words(without_others(table, before), columns, hints)
        before.append(replace(table, rows=table.rows[:1]))
        end = table.sheet, table.rows[-1][0]
        tests = _tests(table, columns, count, hints)
        tests[:1] = [replace(tests[0], notes=(*tests[0].notes, *words))] if words else tests[:1]
        if count == 1 and (left := other_test(table, hints, columns)) is not None:
            told = f"columns {left.start + 1} to {left.stop} may be another test and are left out"
            note = f"{told}; it needs a file of its own"
            tests = [replace(tests[0], notes=(*tests[0].notes, note)), *tests[1:]]
        found.append((before[-1], tests))
    if not found:
        assert missing is not None, "a file without tables is refused by read_tables"
        raise missing
    named = _named(found, hints)
    first, *others = _with_results(named, found[0][0].decimal)
    notes = [left_out_note(other)] if other else []
    notes += without_effect(hints, sum(len(tests) for _, tests in found), len(named))
    if short:
        notes.append(f"{short} further tables with fewer than {FEWEST_ROWS} rows are left out")
    return [replace(first, notes=(*first.notes, *notes)), *others]


def _with_results(tests: list[Recording], decimal: str) -> list[Recording]:
    """The tests with sizes from a table of results above the first one, where that has a row for each."""
    each, notes = sizes_by_results(tests[0].header, [test.test for test in tests], decimal)
    return [
        replace(test, sizes={**test.sizes, **sizes}, notes=(*test.notes, *notes))
        for test, sizes in zip(tests, each, strict=True)
    ]


def _named(found: Sequence[tuple[Table, list[Recording]]], hints: Hints) -> list[Recording]:
    """The tests of several tables, each with a name of its own if there are several."""
    if len(found) == 1:
        return found[0][1]
    firsts = [table.titles[0] for table, _ in found]
    taken = any(column.place == 0 for _, tests in found for column in tests[0].columns)  # a title, and not a name
    apart = not taken and all(firsts) and len(set(firsts)) == len(found)
    alone = [tests[0] for _, tests in found if len(tests) == 1]
    one_sheet = len({table.sheet for table, _ in found}) == 1
    between = (row for table, _ in found[1:] for row in table.header[table.own :])
    nothing_between = not says_more(between, found[0][0].header)
    if not apart and one_sheet and nothing_between and len(alone) == len(found):
        if times_go_on(alone):
            return [as_one(alone, "whose times go on")]
        if hints.tables == "join" and alone[0].columns[0].place == NOWHERE:
            return [as_one(alone, f"without times, as {TABLES} says")]
    if len(alone) == len(found) and (one_sheet or are_steps(alone)):
        named = apart or any(names_test(table.header[table.own :]) for table, _ in found[1:])
        alone = joined_tables(alone, hints, named=named)
        if len(alone) == 1:
            return alone
        apart = apart and len(alone) == len(found)
        found = [(table, [one]) for (table, _), one in zip(found, alone, strict=False)]
    sheets = [table.sheet for table, _ in found]
    if apart:
        names = firsts
    else:
        names = sheets if len(set(sheets)) == len(found) else [str(number) for number in range(1, len(found) + 1)]
    return [
        replace(test, test=f"{name}_{test.test}" if test.test else name)
        for name, (_, tests) in zip(names, found, strict=True)
        for test in tests
    ]


def _tests(table: Table, columns: Columns, count: int, hints: Hints) -> list[Recording]:
    """The tests of one table, ``count`` beside each other, or one under another."""
    found: list[Recording] = []
    alone = count == 1 and hints.test_column is None
    table, gaps = without_gaps(table) if alone else (table, ())
    every = [columns_of(table, columns, number, hints) for number in range(count)] if count > 1 else [columns]
    sizes = sizes_beside(table, every) if count > 1 else [read_sizes(table.header, table.own, table.decimal)]
    names = names_beside(table, every) if count > 1 else [""]
    for number, (name, ours) in enumerate(zip(names, every, strict=True)):
        rows = filled_rows(table, ours[1:] if count > 1 else ours)  # times may be shared with a longer test
        cut = cut_off(table, ours, rows)
        rows -= cut
        if count > 1 and rows < FEWEST_ROWS:
            continue  # of fewer tests than there is room for
        early, unread = unread_at_start(table, ours, rows) if alone else (0, "")
        blocks = [Block("", early, rows)] if hints.tests_by is None else blocks_of_tests(table, rows, hints.tests_by)
        for block in blocks:
            both = replace(block, name="_".join(filter(None, (name, block.name))))
            one = _once(_begun(_ended(_recording(table, ours, hints, both, sizes[number], number, count))))
            found += [_spread(each, hints) for each in (tests_again(one, gaps, hints) if alone else [one])]
        if early:
            found[0] = replace(found[0], notes=(*found[0].notes, unread))
        if cut:
            at, row = table.rows[rows]
            note = f"row {at} ends within a number, {shown(row[-1])}, and is left out"
            found[-1] = replace(found[-1], notes=(*found[-1].notes, note))
    return found


def _recording(
    table: Table, columns: Columns, hints: Hints, block: Block, told: Mapping[str, Size], number: int, beside: int
) -> Recording:
    """The test in a block of rows of a table; ``told``: its sizes, ``number``: which of the tests ``beside`` others."""
    numbers = measured(table, range(block.start, block.end), columns)
    raw, numbers = numbers, numbers * [column.factor for column in columns]
    beyond = np.argwhere(~(np.abs(numbers) < HUGE))
    if beyond.size:
        row, column = beyond[0]
        where = f"{table.path}: row {table.rows[block.start + row][0]}, {columns[column].title}"
        raise BadInput(where, f"{numbers[row, column]:g}", "a number below 1e100")
    at = tuple(row for row, _ in table.rows[block.start : block.end])
    for values, column in zip(raw.T[1:], columns[1:], strict=True):
        refuse_marks(f"{table.path}: {shown(column.title or column.quantity.name)}", at, values)
    if len(numbers) < FEWEST_ROWS:
        raise BadInput(table.path, f"{len(numbers)} rows of numbers{_of(block)}", f"at least {FEWEST_ROWS}")
    further = kept(table, range(block.start, block.end), hints.further, number, beside)
    refuse_ragged(table, range(block.start, block.end))
    places = {*further.places, *(column.place for column in columns)}
    others = {place for column in columns if beside > 1 for place in alike_places(table, column)}  # of other tests
    unused = [place for place, title in enumerate(table.titles) if place not in places | others and title]
    notes = _unseen(table, range(block.start, block.end), columns)
    if hints.timing.given:
        if hints.test_column is None and not np.ptp(numbers[:, 0]):
            refuse_several(table, block.end, list(places), rows_again(numbers))
        numbers, by = timed(table, columns, numbers, hints, block)
        notes += by
    if hints.cycle_column is not None:
        numbers[:, 0], by = _over_cycles(table, columns, numbers[:, 0], hints.cycle_column, block)
        notes += by
    back = [block.start + int(at) + 1 for at in np.flatnonzero(np.diff(numbers[:, 0]) <= 0)]
    apart = told_apart(table, block.end, back, list(places)) if hints.test_column is None else None
    if apart is not None and not back:
        notes += (f"{apart.count} values of '{apart.title}': {apart.option}, if each is a test of its own",)
    sizes, doubted = _believed(told, table, range(block.start, block.end), columns[1] if beside == 1 else None, places)
    notes += doubted
    lengths: tuple[Size | None, Size | None] = (None, None)
    if "length" not in sizes and columns[1].quantity is DISPLACEMENT:
        length = length_beside(table, columns[1], numbers[:, 1], block.start)
        sizes |= {} if length is None else {"length": length}
        if zeros := new_zeros(numbers):
            lengths = lengths_at_zeros(table, columns[1], numbers[:, 1], zeros, block.start)
    used = {size.text for size in (sizes.get("length"), lengths[1]) if size is not None and size.column}
    unused = [place for place in unused if table.titles[place] not in used]
    return Recording(
        table.path,
        numbers,
        columns,
        at,
        table.header,
        sizes,
        tuple(table.titles[place] for place in unused),
        titles_of_numbers(table, unused),
        block.name,
        notes,
        "" if apart is None or not back else f", or {apart.option} {shown(apart.title)}, which changes there",
        further=further,
        lengths=lengths,
        repeats=repeats_of(table, range(block.start, block.end), *columns[1:]) if beside == 1 else Repeats(),
    )


def _begun(recording: Recording) -> Recording:
    """The recording without the rows before its clock runs, and a note on them."""
    early = before_clock(recording.numbers)
    if not early or recording.columns[0].place == NOWHERE:
        return recording
    same = f"{recording.numbers[0, 0]:g} s"
    note = f"the first {early + 1} rows have the same time, {same}: the test begins with the last of them"
    return replace(recording.part(slice(early, None), note), repeats=recording.repeats)


def _ended(recording: Recording) -> Recording:
    """The recording without the rows behind its end, whose clock is back at the start, and a note on them."""
    behind = behind_clock(recording.numbers)
    if not behind or recording.columns[0].place == NOWHERE:
        return recording
    rows, left = ("row has", "is") if behind == 1 else (f"{behind} rows have", "are")
    note = f"the last {rows} the time {recording.numbers[-1, 0]:g} s again, and {left} left out"
    return replace(recording.part(slice(None, -behind), note), repeats=recording.repeats)


def _once(recording: Recording) -> Recording:
    """The recording without a few rows that have the time of the row before, and a note on them."""
    rows = again(recording.numbers)
    if not rows.size or recording.columns[0].place == NOWHERE:
        return recording
    listed = ", ".join(f"{recording.rows[row]}" for row in rows[:5]) + (", ..." if rows.size > 5 else "")
    note = f"{rows.size} of {len(recording.rows):,} rows repeat the time stamp before them and are left out: {listed}"
    return replace(recording.part(np.delete(np.arange(len(recording.rows)), rows), note), repeats=recording.repeats)


def _spread(recording: Recording, hints: Hints) -> Recording:
    """The recording with times of their own for rows that have one by a coarse clock, as a person says, and a note.

    Raises :class:`Unclear` where nobody has said it.
    """
    time_s = recording.numbers[:, 0]
    if recording.columns[0].place == NOWHERE or recording.remedy or not is_coarse(time_s):
        return recording
    same = np.flatnonzero(np.diff(time_s) == 0) + 1
    told = f"times repeat in {same.size:,} of {len(time_s):,} rows, first in row {recording.rows[same[0]]}"
    if hints.same_times is None:
        expected = "--same-times spread where the clock is coarser than the rows, or --rate-hz"
        raise Unclear(
            str(recording.path), told, expected, what="times", which="spread them up to the next step of the clock?",
            option="--same-times", choices=("spread",),
        )  # fmt: skip
    numbers = np.column_stack([spread(time_s), recording.numbers[:, 1:]])
    note = f"{told}; they are spread evenly, up to the next step of the clock"
    return replace(recording, numbers=numbers, notes=(*recording.notes, note))


def _unseen(table: Table, rows: range, columns: Sequence[Column]) -> tuple[str, ...]:
    """What one does not see of a test: what is hidden, and milliseconds without zeros in front."""
    notes = table.unseen(rows, {each.place: each.title for each in columns})
    return (*notes, UNPADDED) if columns[0].place in table.unpadded else notes


def _over_cycles(
    table: Table, columns: Columns, time_s: Array, cycle_column: str, block: Block
) -> tuple[Array, tuple[str, ...]]:
    """Times ``[t]`` (s) of a block of rows that go on over its cycles, and a note where this changes them."""
    taken = [column.place for column in columns]
    cycles = _within(blocks_of_cycles(table, block.end, cycle_column, taken), block)
    going = going_on(time_s, cycles)
    if np.array_equal(going, time_s):
        return going, ()
    return going, (f"times go on over {len(cycles)} cycles, which {shown(cycle_column)} tells apart",)


def _believed(
    sizes: Mapping[str, Size], table: Table, rows: range, moved: Column | None, taken: Collection[int]
) -> tuple[dict[str, Size], tuple[str, ...]]:
    """The ``sizes`` without a length that the table's own strains contradict, and a note on that.

    With those in columns of their own that are not ``taken``. ``moved``: the displacements, where it is known which
    columns belong to them.
    """
    sizes = dict(sizes) if moved is None else {**sizes_in_columns(table, rows, taken), **sizes}
    told = sizes.get("length")
    both = "" if told is None or told.mm is None or moved is None else contradiction(table, rows, moved, told.mm)
    if not both:
        return sizes, ()
    del sizes["length"]
    return sizes, (f"the gauge length is not taken from the file: {both}",)


def _of(block: Block) -> str:
    return f" of test {shown(block.name)}" if block.name else ""


def _within(cycles: Sequence[Block], block: Block) -> list[Block]:
    """The cycles that begin in a block, counted from its first row."""
    first = block.start
    return [Block(c.name, max(c.start - first, 0), c.end - first) for c in cycles if c.end > first]
