"""The three columns that a test needs, time, motion and load, and what a person says of each."""

from dataclasses import dataclass

from sinew.tasks.data import units
from sinew.tasks.data.hints import Hints, each_title
from sinew.tasks.data.quantities import FORCE, LOADS, MOTIONS, STRESS, TIME, Quantity

TIMED = ", --rate-hz, --speed or --speed-column"  # what tells times where no column does
UNTIMED_BY_SPEED = " or --rate-hz"  # the same, where no speed of the motion tells the time


@dataclass(frozen=True)
class Role:
    """One of the three columns that a test needs, and what a person says of it."""

    name: str
    option: str
    quantities: tuple[Quantity, ...]
    wanted: tuple[str, ...]
    given: str | None
    more_titles: tuple[str, ...] = ()  # that any of the quantities may have
    without_speed: bool = False  # no speed of the motion tells the time
    titled: bool = True  # some columns have titles, which may tell units

    def titles(self, quantity: Quantity) -> tuple[str, ...]:
        return quantity.titles + self.more_titles

    @property
    def unit_option(self) -> str:
        return f"--{self.option}-unit"

    @property
    def remedy(self) -> str:
        """What a person can do where no column is recognised."""
        told = (UNTIMED_BY_SPEED if self.without_speed else TIMED) if self.option == "time" else ""
        named = "NAME or NUMBER" if self.titled else f"NUMBER and {self.unit_option}"
        return f"--{self.option}-column {named}{told}"

    @property
    def choices(self) -> tuple[str, ...]:
        return units.merged(quantity.units for quantity in self.quantities)


def roles_of(hints: Hints) -> tuple[Role, Role, Role]:
    """Time, motion and load; the load is a stress where a person gives a unit of stress."""
    stress = hints.force_unit is not None and units.factor(STRESS.units, hints.force_unit) is not None
    loads, more = ((STRESS,), FORCE.titles) if stress else (LOADS, ())
    return (
        Role("time", "time", (TIME,), each_title(hints.time_column), hints.time_unit),
        Role("displacement, length or strain", "displacement", MOTIONS, each_title(hints.displacement_column),
              hints.displacement_unit),
        Role(" or ".join(load.name for load in loads), "force", loads, each_title(hints.force_column),
              hints.force_unit, more),
    )  # fmt: skip


def by_number(hints: Hints) -> bool:
    """Whether a person names all three columns by their numbers, or tells how times run in place of one."""
    times = () if hints.timing.given else (hints.time_column,)
    every = map(each_title, (*times, hints.displacement_column, hints.force_column))
    return all(given and all(map(str.isdigit, given)) for given in every)
