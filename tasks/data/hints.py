"""What a person says of a file: its columns, the units that it does not tell, and how its times run."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data.cohort import COLUMNS, NAME
from sinew.tasks.data.timing import Timing
from sinew.tasks.model.specimen import FORCE

Zero = Literal["first", "none"]
Negate = Literal["none", "displacement", "force", "both"]
Rows = Literal["leave-out", "keep"]
Tables = Literal["join", "apart", "first"]
SameTimes = Literal["spread"]
NO_COLUMN = "none"
Title = str | tuple[str, ...]  # several: each file has one of them


@dataclass(frozen=True)
class Further:
    """A column that is kept beside the force: its title or number, its ``name`` in curve files, its unit if told."""

    column: str
    name: str
    unit: str | None


def further(text: str) -> Further:
    """What ``TITLE=NAME`` or ``TITLE=NAME:UNIT`` asks for. Raises :class:`BadInput`."""
    column, _, rest = text.rpartition("=")
    name, _, unit = rest.partition(":")
    if not column.strip() or not NAME.fullmatch(name.strip()) or name.strip() in (*COLUMNS, FORCE):
        expected = "TITLE=NAME or TITLE=NAME:UNIT, NAME of letters, digits and '_', and not that of the force"
        raise BadInput("--keep-column", shown(text), expected)
    return Further(column.strip(), name.strip(), unit.strip() or None)


@dataclass(frozen=True)
class Hints:
    """What a person says of a file: titles or numbers (from 1) of columns, and units that the file does not tell.

    Of several titles of one column, the first that a file has counts, as files may come from different machines.
    ``force_unit`` may be a unit of stress; the load is a stress then. ``test_column`` tells the tests of a table apart,
    ``cycle_column`` its cycles, if their times start again. ``rate_hz``, ``speed`` and ``speed_column``: see
    :class:`Timing`. ``NO_COLUMN`` for a column of tests or speeds: that which looks like one is none.
    ``zero_displacement`` and ``zero_force``: whether each counts from its ``first`` value. ``negate``: which of
    them get the other sign. ``tables``: whether tables that may go on from each other are one test; ``first`` leaves
    out tests with other titles than the first one.
    ``preload``: what becomes of the rows before a motion is set to zero again; ``end``: of those after a break, or
    after a jump of the motion in the last rows. ``same_times``: what becomes of rows to which a coarse clock gives one
    time. ``sheet``: the only one of a spreadsheet whose tables are read.
    ``keep_column``: columns that are kept beside the force, as for :func:`further`.
    """

    time_column: Title | None = None
    displacement_column: Title | None = None
    force_column: Title | None = None
    time_unit: str | None = None
    displacement_unit: str | None = None
    force_unit: str | None = None
    test_column: str | None = None
    cycle_column: str | None = None
    rate_hz: float | None = None
    speed: float | None = None
    speed_column: str | None = None
    zero_displacement: Zero | None = None
    zero_force: Zero | None = None
    negate: Negate | None = None
    tables: Tables | None = None
    preload: Rows | None = None
    end: Rows | None = None
    same_times: SameTimes | None = None
    sheet: str | None = None
    keep_column: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for a rate or a speed that is impossible, and for what names no column to keep."""
        names = [one.name for one in self.further]
        if len(set(names)) < len(names):
            raise BadInput("--keep-column", f"two columns called {shown(max(names, key=names.count))}", "other names")
        if self.timing.given and self.time_column is not None:
            raise BadInput(str(self.timing), "given together with --time-column", "one of them")

    @property
    def columns_given(self) -> bool:
        """Whether a person names a column of the test."""
        return any(one is not None for one in (self.time_column, self.displacement_column, self.force_column))

    @property
    def further(self) -> tuple[Further, ...]:
        """The columns that are kept beside the force."""
        return tuple(map(further, self.keep_column or ()))

    @property
    def timing(self) -> Timing:
        return Timing(self.rate_hz, self.speed, None if self.speed_column == NO_COLUMN else self.speed_column)

    @property
    def tests_by(self) -> str | None:
        """The column that tells the tests of a table apart, if any does."""
        return None if self.test_column == NO_COLUMN else self.test_column

    def of(self, option: str) -> Any:
        """What is told of an option."""
        return getattr(self, _field(option))

    def answered(self, option: str, answer: Title) -> "Hints":
        """The same, with the answer to a question."""
        told: dict[str, Any] = {_field(option): answer}
        return replace(self, **told)


def each_title(given: Title | None) -> tuple[str, ...]:
    """The titles that a person gives for one column; none where nobody does."""
    return () if given is None else (given,) if isinstance(given, str) else given


def _field(option: str) -> str:
    return option.removeprefix("--").replace("-", "_")
