"""What the columns of a test hold: the quantities, their titles and their units."""

from collections.abc import Iterable
from dataclasses import dataclass

from sinew.tasks.data import units, words
from sinew.tasks.data.units import Units


@dataclass(frozen=True)
class Quantity:
    """What a column may hold. ``titles``: in lower case, the better the earlier; ``units``: with their factors.

    ``bare``: without a unit, the numbers are taken as they are.
    """

    name: str
    titles: tuple[str, ...]
    units: Units
    bare: bool = False


TIME = Quantity("time", words.TIME, units.TIME)
DISPLACEMENT = Quantity("displacement", words.DISPLACEMENT + words.EXTENSOMETER, units.LENGTH)
POSITION = Quantity("position", words.POSITION, units.LENGTH)
LENGTH = Quantity("length", words.LENGTH, units.LENGTH)
STRAIN = Quantity("strain", words.STRAIN + words.EXTENSOMETER + words.ELONGATION, units.FRACTION)
STRETCH = Quantity("stretch", words.STRETCH, units.FRACTION, bare=True)
FORCE = Quantity("force", words.FORCE, units.FORCE)
STRESS = Quantity("stress", words.STRESS, units.STRESS)
BASE_UNITS = {"displacement": "mm", "position": "mm", "length": "mm", "force": "N", "stress": "MPa"}  # of what is read
MOTIONS, LOADS = (DISPLACEMENT, LENGTH, POSITION, STRETCH, STRAIN), (FORCE, STRESS)
#: What the columns of a test may hold, and all titles of these: of time, motion and load.
OF_A_TEST = tuple(
    (quantities, tuple(title for quantity in quantities for title in quantity.titles))
    for quantities in ((TIME,), MOTIONS, LOADS)
)
AT_REST = 0.5  # how far the first stretch may be from 1, and the first strain from 0


def ratio_of_lengths(values: Iterable[float | None]) -> Quantity | None:
    """Whether bare numbers begin as a stretch, at 1, or as a strain, at 0; None if as neither."""
    first = next((value for value in values if value is not None), None)
    if first is None:
        return None
    return STRETCH if abs(first - 1.0) < AT_REST else STRAIN if abs(first) < AT_REST else None
