"""Parameters that the data press against an end of their range."""

from collections.abc import Mapping, Sequence

from sinew.tasks.discover.fit.fit import Fitted
from sinew.tasks.model import Parameter


def at_limit(parameter: Parameter, at: float, null: Mapping[str, float]) -> bool:
    """Whether the bound that a parameter is on is its ``null`` value or a limit of the law, with nothing beyond."""
    end = parameter.minimum if at < 0.5 else parameter.maximum
    return end in (null.get(parameter.name), parameter.floor)


def pressed_in_most(
    parameters: Sequence[Parameter], first: int, fits: Sequence[Fitted], null: Mapping[str, float]
) -> tuple[str, ...]:
    """The parameters, from the ``first`` of a fit on, that data press against a bound in most specimens.

    Null values and limits of a law do not count.
    """
    return tuple(
        parameter.name
        for k, parameter in enumerate(parameters, first)
        if 2 * sum(one.pressed[k] and not at_limit(parameter, one.at[k], null) for one in fits) > len(fits)
    )


def cornered(varied: Sequence[Parameter], bare: Sequence[Fitted]) -> tuple[str, ...]:
    """Those of the ``varied`` parameters of the bare model that are pressed in most specimens, if these are most."""
    names = pressed_in_most(varied, 0, bare, {})
    return names if 2 * len(names) > len(varied) else ()
