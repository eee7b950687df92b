"""The factor of a column to the unit that sinew computes in. It is read or told, never guessed."""

from sinew.runner.errors import BadInput, shown
from sinew.tasks.data import units
from sinew.tasks.data.quantities import LOADS, Quantity
from sinew.tasks.data.questions import UnknownUnit

_ELECTRIC = frozenset({"v", "volt", "volts", "mv", "mv/v", "v/v"})


def is_signal(unit: str) -> bool:
    """Whether a unit is that of a sensor's signal, such as V."""
    return unit.casefold() in _ELECTRIC


def is_angle(unit: str) -> bool:
    """Whether a unit is that of an angle."""
    return unit.casefold() in units.ANGLES


def factor_of(where: str, quantity: Quantity, unit: str, given: str | None, option: str) -> float:
    """The factor of a column to s, mm, N, MPa or 1, by the ``unit`` in the file and the one ``given``.

    Raises :class:`UnknownUnit` if only a person can tell it, and :class:`BadInput` where both contradict each other or
    the unit is one of another quantity. ``where``: file and column, ``option``: that tells the unit.
    """
    listed = f"one of {', '.join(units.listed(quantity.units))}"
    if unit in ("1", "-") and unit not in quantity.units:  # as some programs write in place of a unit
        unit = ""
    if units.ambiguous(unit) and quantity in LOADS:
        choices = [name for name in quantity.units if name.lower() == unit.lower()]
        if given in choices:
            return quantity.units[given]
        problem = f"unit {shown(unit)} may stand for milli or for mega"
        raise UnknownUnit(where, quantity.name, option, choices or units.listed(quantity.units), problem)
    if is_signal(unit):
        problem = f"unit {shown(unit)} is that of a sensor's signal, no {quantity.name}"
        raise BadInput(where, problem, f"a column in {listed}: multiply the signal by the factor of its sensor first")
    if angle := next(filter(is_angle, (unit, given or "")), ""):
        raise BadInput(
            where, f"unit {shown(angle)} is that of an angle, which is no {quantity.name}", f"a column in {listed}"
        )
    expected = None if given is None else units.factor(quantity.units, given)
    if given is not None and expected is None:
        raise BadInput(where, f"a {quantity.name}, but {option} says {shown(given)}", listed)
    if units.EITHER in unit and expected is None:
        told = unit.split(units.EITHER)
        problem = f"the {quantity.name} has two units: {' and '.join(map(shown, told))}"
        choices = [one for one in told if units.factor(quantity.units, one) is not None]
        raise UnknownUnit(where, quantity.name, option, choices or units.listed(quantity.units), problem)
    if unit and not units.is_unit(unit) and expected is None:
        weight = f" ({unit}f, if it is a weight)" if f"{unit}f" in quantity.units else ""
        problem = f"unit {shown(unit)} of the {quantity.name} is not known{weight}"
        raise UnknownUnit(where, quantity.name, option, units.listed(quantity.units), problem)
    if units.is_unit(unit):
        factor = units.factor(quantity.units, unit)
        if factor is None:
            raise BadInput(where, f"unit {shown(unit)}", listed)
        if expected is not None and expected != factor:
            raise BadInput(where, f"unit {shown(unit)}, but {option} says {given}", "one and the same unit")
        return factor
    if expected is not None:
        return expected
    if quantity.bare:
        return 1.0
    raise UnknownUnit(where, quantity.name, option, units.listed(quantity.units))
