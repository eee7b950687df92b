"""What a person should check in a recording that was understood."""

from collections.abc import Collection, Iterator, Sequence

from sinew.tasks.data.columns import LIKELY, Column
from sinew.tasks.data.heads import joined
from sinew.tasks.data.odd_numbers import odd_numbers
from sinew.tasks.data.quantities import POSITION
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.signs import ZERO
from sinew.tasks.data.sizes import narrow
from sinew.tasks.data.titles import name_and_unit, without_fillers
from sinew.tasks.data.told_lines import told_bending, told_factors


def remarks(recording: Recording) -> list[str]:
    """A line for each thing that a person should check."""
    found = [*recording.notes, *recording.further.notes, *which_columns(recording.columns)]
    if recording.motion.quantity is POSITION:
        start = f"{recording.numbers[0, 1]:.6g} mm"
        found.append(f"positions, {LIKELY} to count from the first one, {start}; {ZERO} none if they are displacements")
    lines = [joined(row) for row in narrow(recording.header)]
    found += [*told_bending((*lines, *recording.titles)), *told_factors(lines)]
    found += [*odd_numbers(recording.columns, recording.numbers)]
    return [*found, *map(str, recording.doubts)]


def which_columns(columns: Sequence[Column | None]) -> Iterator[str]:
    """A line for each column in whose place another one could be meant."""
    for column in filter(None, columns):
        if column.alike:
            others = ", ".join(f"'{title}'" for title in column.alike)
            yield f"{column.quantity.name} from column {column.place + 1}; it may be in another: {others}"
        name, known = name_and_unit(column.title)[0], column.quantity.titles
        if name not in known and (part := _part_of(name, known)):
            yield f"{column.quantity.name} from column {column.place + 1}, {LIKELY} by '{part}' in its title"


def _part_of(name: str, known: Collection[str]) -> str:
    """The known name within a title: among words that change nothing of it, or behind those of a station."""
    ends = (name.split(maxsplit=at)[-1] for at in range(1, name.count(" ") + 1))
    return next((part for part in (without_fillers(name), *ends) if part in known), "")
