"""A recording as a person says that its displacement and force are counted."""

from dataclasses import replace

from sinew.runner.errors import BadInput
from sinew.tasks.data.ends import doubt_of_end, without_end
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import DISPLACEMENT, POSITION
from sinew.tasks.data.questions import Doubt
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.signs import PRELOAD, at_zero, counted, doubts, new_zeros


def as_told(recording: Recording, hints: Hints) -> Recording:
    """The recording with displacement and force counted as a person says, and what is doubtful then."""
    if hints.zero_displacement == "none" and recording.motion.quantity is POSITION:
        time, motion, load = recording.columns
        recording = replace(recording, columns=(time, replace(motion, quantity=DISPLACEMENT), load))
    if hints.preload is not None:
        recording = _without_preload(recording, hints)
    numbers, notes = counted(str(recording.path), recording.columns, recording.numbers, hints)
    recording = replace(recording, numbers=numbers, notes=(*recording.notes, *notes))
    if hints.end == "leave-out":
        recording = without_end(recording)
    lines = (" ".join(row) for row in recording.header)
    falls = recording.repeats.falls
    found = doubts(recording.columns, recording.numbers, (*recording.titles, *lines), hints, falls=falls)
    told = [_with_lengths(one, recording) if one.option == PRELOAD else one for one in found]
    return replace(recording, doubts=(*told, *(doubt_of_end(recording) if hints.end is None else ())))


def _without_preload(recording: Recording, hints: Hints) -> Recording:
    """The recording from its last zero on, or counted on from the first one, as a person says."""
    rows = new_zeros(recording.numbers)
    if not rows:
        note = f"{PRELOAD} has no effect: the {recording.motion.quantity.name} is never set to zero again"
        return replace(recording, notes=(*recording.notes, note))
    if hints.preload == "leave-out":
        return _from_row(recording, rows[-1])
    by_speed = hints.timing.given and hints.timing.rate_hz is None
    if by_speed and f"times by {hints.timing}" in recording.notes:
        problem = f"its displacement is set to zero again after {rows[0]:,} rows, so a speed gives no time there"
        raise BadInput(recording.path, problem, "--rate-hz, or --preload leave-out")
    for row in rows:
        recording = _counted_on(recording, row, once=len(rows) == 1)
    return recording


def _with_lengths(doubt: Doubt, recording: Recording) -> Doubt:
    """The doubt about a preload with the gauge lengths that either answer leads to, where the file gives them."""
    before, after = (None if one is None else one.mm for one in recording.lengths)
    if before is None or after is None:
        return doubt
    lengths = f"the gauge length is {after:.4g} mm without these rows, {before:.4g} mm with them"
    return replace(doubt, text=f"{doubt.text}; {lengths}")


def _counted_on(recording: Recording, first: int, *, once: bool) -> Recording:
    """The recording whose displacement goes on where it is set to zero again, in row ``first``.

    It goes on by what the gauge lengths at both zeros tell, if this happens ``once``, or else from the row before.
    Without such lengths, a jump to anywhere but zero may be a motion of the machine, and nothing is changed.
    """
    name, numbers = recording.motion.quantity.name, recording.numbers.copy()
    if recording.motion.quantity is not DISPLACEMENT:  # a strain may count from a new length
        note = f"the {name} is set to zero again after {first:,} rows, and stays as it is"
        return replace(recording, notes=(*recording.notes, note))
    before, after = recording.lengths
    if once and before is not None and after is not None and before.mm is not None and after.mm is not None:
        further = after.mm - before.mm
    elif once and not at_zero(numbers[first - 1, 1], numbers[first, 1]):
        note = f"the {name} jumps after {first:,} rows, but not to zero, and stays as it is"
        return replace(recording, notes=(*recording.notes, note))
    else:
        further = numbers[first - 1, 1] - numbers[first, 1]
    numbers[first:, 1] += further
    note = f"displacement counted on by {further:.6g} mm after the first {first:,} rows, where it was set to zero again"
    length = {} if before is None else {"length": before}
    return replace(recording, numbers=numbers, notes=(*recording.notes, note), sizes={**recording.sizes, **length})


def _from_row(recording: Recording, first: int) -> Recording:
    """The recording without the rows before ``first``."""
    reason = f"then the {recording.motion.quantity.name} was set to zero again"
    note = f"the first {first:,} rows left out, as --preload says: {reason}"
    length = {} if recording.lengths[1] is None else {"length": recording.lengths[1]}
    return replace(recording.part(slice(first, None), note), sizes={**recording.sizes, **length})
