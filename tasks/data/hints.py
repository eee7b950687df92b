"""What a person says of a file: its columns, the units that it does not tell, and how its times run."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from sinew.runner.errors import BadInput
from sinew.tasks.data.timing import Timing

Zero = Literal["first", "none"]
Negate = Literal["none", "displacement", "force", "both"]


@dataclass(frozen=True)
class Hints:
    """What a person says of a file: titles or numbers (from 1) of columns, and units that the file does not tell.

    ``force_unit`` may be a unit of stress; the load is a stress then. ``test_column`` tells the tests of a table apart,
    ``cycle_column`` its cycles, if their times start again. ``rate_hz`` and ``speed``: see :class:`Timing`.
    ``zero_displacement`` and ``zero_force``: whether each counts from its ``first`` value. ``negate``: which of
    them get the other sign.
    """

    time_column: str | None = None
    displacement_column: str | None = None
    force_column: str | None = None
    time_unit: str | None = None
    displacement_unit: str | None = None
    force_unit: str | None = None
    test_column: str | None = None
    cycle_column: str | None = None
    rate_hz: float | None = None
    speed: float | None = None
    zero_displacement: Zero | None = None
    zero_force: Zero | None = None
    negate: Negate | None = None

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for a rate or a speed that is impossible."""
        if self.timing.given and self.time_column is not None:
            raise BadInput(str(self.timing), "given together with --time-column", "one of them")

    @property
    def columns_given(self) -> bool:
        """Whether a person names a column of the test."""
        return any(one is not None for one in (self.time_column, self.displacement_column, self.force_column))

    @property
    def timing(self) -> Timing:
        return Timing(self.rate_hz, self.speed)

    def of(self, option: str) -> Any:
        """What is told of an option."""
        return getattr(self, _field(option))

    def answered(self, option: str, answer: str) -> "Hints":
        """The same, with the answer to a question."""
        told: dict[str, Any] = {_field(option): answer}
        return replace(self, **told)


def _field(option: str) -> str:
    return option.removeprefix("--").replace("-", "_")
