"""What the columns of a test hold: the quantities, their titles and their units."""

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
STRAIN = Quantity("strain", words.STRAIN + words.EXTENSOMETER, units.FRACTION)
STRETCH = Quantity("stretch", words.STRETCH, units.FRACTION, bare=True)
FORCE = Quantity("force", words.FORCE, units.FORCE)
STRESS = Quantity("stress", words.STRESS, units.STRESS)
MOTIONS, LOADS = (DISPLACEMENT, LENGTH, POSITION, STRETCH, STRAIN), (FORCE, STRESS)
