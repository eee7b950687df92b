"""The end of a test that tells nothing of the specimen: what follows a break, or a jump of the motion."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sinew.tasks.data.breaks import break_of
from sinew.tasks.data.quantities import BASE_UNITS, LENGTH, POSITION, STRETCH
from sinew.tasks.data.questions import Doubt
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.several import FEWEST_ROWS
from sinew.tasks.drawing.blocks import number
from sinew.tasks.model import Curve, Protocol

END = "--end"
FEWEST_ZEROS = 2  # rows
LAST_ROWS, JUMP, STEPS = 5, 0.1, 20.0  # at the end: a step of this part of the way before, and in usual steps


@dataclass(frozen=True)
class End:
    """The last row before it, and what happens there."""

    row: int
    text: str


def doubt_of_end(recording: Recording) -> Iterator[Doubt]:
    """The question what becomes of the rows behind the end of a test, where there are any."""
    if found := _end_of(recording):
        yield Doubt(found.text, "leave out the rows from there on?", END, ("leave-out", "keep"))


def without_end(recording: Recording) -> Recording:
    """The recording up to its end."""
    found = _end_of(recording)
    if found is None:
        return recording
    kept = found.row + 1
    note = f"the last {len(recording.rows) - kept:,} rows left out, as {END} says: {found.text}"
    return recording.part(slice(kept), note)


def _end_of(recording: Recording) -> End | None:
    """The first break or jump; None where there is none, where times do not increase, or next to nothing is before."""
    if (np.diff(recording.numbers[:, 0]) <= 0).any():
        return None
    every = (_break_of(recording), _jump_of(recording), _zeros_of(recording))
    found = [one for one in every if one and one.row + 1 >= FEWEST_ROWS]
    if not found:
        return None
    first, *later = sorted(found, key=lambda one: one.row)
    more = [one.text for one in later if one.row > first.row]  # those who keep the rows behind a break keep them, too
    return End(first.row, "; later, ".join((first.text, *more)))


def _break_of(recording: Recording) -> End | None:
    time_s, moved, load = recording.numbers.T
    if recording.motion.quantity in (LENGTH, POSITION, STRETCH):
        moved = moved - moved[0]
    rows = break_of(Curve(Protocol("test", time_s, moved), load))
    if rows is None:
        return None
    name = recording.load.quantity.name
    before, after = (_with_unit(name, load[row]) for row in rows)
    begin, end = (number(time_s[row], 4) for row in rows)
    text = (
        f"the {name} falls from {before} to {after} from {begin} to {end} s, while the specimen is still being loaded; "
        "this may be a break, which the model does not describe"
    )
    return End(rows[0], text)


def _jump_of(recording: Recording) -> End | None:
    """A motion that jumps in the last rows, as where a machine lets go or its sensor falls off."""
    time_s, moved, _ = recording.numbers.T
    steps = np.abs(np.diff(moved))
    moving = steps[steps > 0]
    way = float(np.ptp(moved[:-LAST_ROWS])) if moved.size > LAST_ROWS else 0.0
    if not moving.size or not way:
        return None
    far = np.flatnonzero(steps[-LAST_ROWS:] > max(JUMP * way, STEPS * float(np.median(moving))))
    if not far.size:
        return None
    row = moved.size - 1 - LAST_ROWS + int(far[0])
    name = recording.motion.quantity.name
    before, after = (_with_unit(name, moved[at]) for at in (row, row + 1))
    text = (
        f"the {name} jumps from {before} to {after} at {number(time_s[row + 1], 4)} s, at the end of the test; this "
        "may not be a motion of the specimen"
    )
    return End(row, text)


def _zeros_of(recording: Recording) -> End | None:
    """Rows of zeros at the end, as of a memory that was not filled, where motion or load was far from zero before."""
    _, moved, load = recording.numbers.T
    filled = np.flatnonzero((moved != 0) | (load != 0))
    row = int(filled[-1]) if filled.size else 0
    zeros = moved.size - 1 - row
    far = max(abs(each[row]) / (float(np.ptp(each)) or np.inf) for each in (moved, load))
    if zeros < FEWEST_ZEROS or far < JUMP:
        return None
    names = " and ".join(column.quantity.name for column in recording.columns[1:])
    return End(row, f"{names} are exactly 0 in the last {zeros:,} rows; they may not have been recorded")


def _with_unit(name: str, value: float) -> str:
    return f"{number(value, 4)} {BASE_UNITS.get(name, '')}".strip()
