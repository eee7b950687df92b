"""From where a displacement and a force are counted, and in which direction: what is doubtful, and what a person says.

Here, tension is positive. Some machines count a compression as positive, or a pull as negative, and some tell the
position of the crosshead as its displacement.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import words
from sinew.tasks.data.columns import Column
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import BASE_UNITS, DISPLACEMENT, LENGTH, POSITION, STRAIN, STRETCH
from sinew.tasks.data.questions import Doubt

Array = np.ndarray[Any, np.dtype[Any]]
#: Where a motion is set to zero again, it moves by this part of its range, and by so many times its usual step, from
#: one row to the next (fewer suffice where it ends at zero); the force by no more than this part of its own range.
JUMP, STEPS, STEPS_TO_ZERO, STAYS = 0.2, 20.0, 5.0, 0.02
AT_ZERO = 0.05  # of the motion before it: what a machine has set to zero again is smaller
LOADED = 0.01  # of the range of the force: with less, a specimen is not loaded
ALONG, ROWS_ALONG = 0.5, 10  # correlation of motion and force, beyond which they go together, and rows it takes
OFFSET = 0.75  # of the way of a displacement: what it starts from is more than a preload takes
TESTED = 0.2  # of the range of the force: behind a preload, the specimen is tested
FEWEST = 3  # rows on either side of it
ZERO, NEGATE, PRELOAD = "--zero-displacement", "--negate", "--preload"
_TURNED = "which sign should be reversed?"
_TENSION = re.compile(rf"(?<![a-z])(?:{'|'.join(words.TENSION)})")


def counted(where: str, columns: Sequence[Column], numbers: Array, hints: Hints) -> tuple[Array, tuple[str, ...]]:
    """The numbers ``[t, 3]`` of a test as a person wants them counted, and a note on each change.

    A length, a stretch and a position have a zero of their own. Raises :class:`BadInput` for a length or a stretch that
    is to be negated.
    """
    found, notes = numbers.copy(), []
    for place, name, zero in ((1, "displacement", hints.zero_displacement), (2, "force", hints.zero_force)):
        quantity = columns[place].quantity
        if zero == "first" and quantity not in (LENGTH, STRETCH, POSITION) and found[0, place] != 0:
            start = f"{found[0, place]:.6g} {BASE_UNITS.get(quantity.name, '')}".strip()
            notes.append(f"{quantity.name} counted from its first value, {start}")
            found[:, place] -= found[0, place]
        if hints.negate in (name, "both"):
            if quantity in (LENGTH, STRETCH):
                problem = f"a {quantity.name} has no sign, but {NEGATE} says {hints.negate}"
                raise BadInput(where, problem, f"{NEGATE} force or none")
            notes.append(f"{quantity.name} with the other sign, by {NEGATE}")
            found[:, place] = 0.0 - found[:, place]
    return found, tuple(notes)


def doubts(
    columns: Sequence[Column], numbers: Array, texts: Iterable[str], hints: Hints, *, falls: str = ""
) -> Iterator[Doubt]:
    """What is doubtful in numbers ``[t, 3]`` that are counted as ``hints`` say.

    ``texts``: titles and lines above. ``falls``: the title of lengths that fall as the motion rises.
    """
    if hints.zero_displacement is None and columns[1].quantity in (DISPLACEMENT, STRAIN):
        start, way = float(numbers[0, 1]), float(np.ptp(numbers[:, 1]))
        if abs(start) > OFFSET * way:
            only = "only " if abs(start) > way else ""
            name = columns[1].quantity.name
            begins, changes = (f"{each} {BASE_UNITS.get(name, '')}".strip() for each in (f"{start:g}", f"{way:.4g}"))
            text = f"the {name} starts at {begins} but changes by {only}{changes}"
            text += "; the start may be an offset of the machine"
            yield Doubt(text, "count it from its first value?", ZERO, ("first", "none"))
    if hints.preload is None:
        yield from _preload(columns, numbers)
    if hints.negate is None:
        yield from _sign(columns, numbers, texts, falls)


def new_zeros(numbers: Array) -> tuple[int, ...]:
    """The rows of numbers ``[t, 3]`` from which on a motion counts from another zero: it jumps, and the force stays.

    Machines set the displacement to zero again after a preload, and again after a preconditioning. A single long jump
    may lead anywhere. Several and shorter ones count where they lead to zero and the specimen is loaded there: one
    without load may have been moved back.
    """
    if not len(numbers):
        return ()
    motion, loads, span = numbers[:, 1], np.abs(np.diff(numbers[:, 2])), np.ptp(numbers[:, 2])
    steps = np.abs(np.diff(motion))
    moving = steps[steps > 0.0]
    usual = float(np.median(moving)) if moving.size else np.inf
    to_zero = at_zero(motion[:-1], motion[1:]) & (np.abs(numbers[1:, 2]) > LOADED * span)
    far = (steps > JUMP * np.ptp(motion)) & (steps > np.where(to_zero, STEPS_TO_ZERO, STEPS) * usual)
    jumps = np.flatnonzero(far & (loads < STAYS * span))
    rows = jumps + 1 if len(jumps) == 1 else jumps[to_zero[jumps]] + 1
    found = tuple(int(row) for row in rows if FEWEST <= row < len(numbers) - FEWEST)
    if found and np.ptp(numbers[found[-1] :, 2]) < TESTED * span:  # the machine drives back behind the test
        return ()
    return found


def at_zero(before: Array, after: Array) -> Array:
    """Whether each motion ``[n]`` (any unit) is next to zero after a jump from another one ``before`` it."""
    return np.abs(after) <= AT_ZERO * np.abs(before)


def _preload(columns: Sequence[Column], numbers: Array) -> Iterator[Doubt]:
    """Where the motion is set to zero again."""
    if rows := new_zeros(numbers):
        row, unit = rows[-1], BASE_UNITS.get(columns[1].quantity.name, "")
        before, after = (f"{each:.4g} {unit}".strip() for each in numbers[row - 1 : row + 1, 1])
        jumps = "jumps" if len(rows) == 1 else f"jumps {len(rows)} times, the last time"
        text = (
            f"the {columns[1].quantity.name} {jumps} from {before} to {after} at {numbers[row, 0]:.6g} s while the "
            f"force does not change: likely set to zero again after a preload of {row:,} rows"
        )
        yield Doubt(text, "leave out these rows?", PRELOAD, ("leave-out", "keep"))


def _sign(columns: Sequence[Column], numbers: Array, texts: Iterable[str], falls: str) -> Iterator[Doubt]:
    """Where the specimen gets shorter or is pushed, or a compression is told."""
    motion, force = numbers[:, 1], numbers[:, 2]
    has_sign = columns[1].quantity not in (LENGTH, STRETCH)
    offset = columns[1].quantity is DISPLACEMENT and abs(motion[0]) > OFFSET * np.ptp(motion)
    if offset or columns[1].quantity in (POSITION, LENGTH, STRETCH):
        motion = motion - motion[0]
    shorter = _below(motion)
    pushed = _below(force) or _falls(motion, force, shorter=shorter)
    told = next(filter(_tells_compression, texts), None)
    either = ("both", "force", "none") if has_sign else ("force", "none")
    if shorter and pushed:
        unless = "" if told else ", unless the machine counts tension as negative"
        fibres = "fibres carry no load in compression, so this test says nothing about their parameters"
        text = f"a compression{unless}: the specimen gets shorter and forces are negative; {fibres}"
        yield Doubt(text, _TURNED, NEGATE, either)
    elif shorter:
        text = "the specimen gets shorter, but forces are above 0; in a compression they should be below 0"
        yield Doubt(text, _TURNED, NEGATE, ("displacement", *either[1:]) if has_sign else either)
    elif falls:
        name = f"{columns[1].quantity.name} rises"
        forces = "and forces are negative" if pushed else "and forces are above 0, which is the sign of tension"
        text = f"a compression: {shown(falls)} falls as the {name}, {forces}"
        yield Doubt(text, _TURNED, NEGATE, ("displacement", "none") if pushed else either)
    elif pushed:
        text = "forces are negative, but sinew takes tension as positive; check the sign convention of the machine"
        yield Doubt(text, _TURNED, NEGATE, ("force", "none"))
    elif told is not None:
        text = f"a compression by {shown(told)}, but displacement and force are above 0, which is the sign of tension"
        yield Doubt(text, _TURNED, NEGATE, either)


def _tells_compression(text: str) -> bool:
    folded = text.casefold()
    return any(word in folded for word in (*words.COMPRESSION, *words.INDENTATION)) and not _TENSION.search(folded)


def _falls(motion: Array, force: Array, *, shorter: bool) -> bool:
    """Whether a force ``[t]`` that crosses zero, as of cycles that end below it, has the sign of a push.

    It is farther below zero than above, and it falls as the specimen gets longer, or with it as it gets shorter.
    """
    if motion.size < ROWS_ALONG or not (np.ptp(motion) and np.ptp(force)) or abs(force.min()) <= abs(force.max()):
        return False
    along = float(np.corrcoef(motion, force)[0, 1])
    return along > ALONG if shorter else along < -ALONG


def _below(values: Array) -> bool:
    return bool(np.median(values) < 0 and abs(values.min()) > 5 * abs(values.max()))
