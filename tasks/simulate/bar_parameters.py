"""What a study may say of the bar that stands in for a model of the user's own: its parameters, and what they are."""

from collections.abc import Mapping, Sequence

from sinew.runner.errors import BadInput, shown
from sinew.tasks.model import TENDON

MODULI = ("E_m", "E_f")  # without one of which there is no force
CONSTANTS = ("beta", "lambda_0")  # of the bar, which are the same in every row
LEFT_OUT = {"E_f": 0.0, "E_m": 0.0, "alpha_f": 0.0, "nu_m": 0.3, "tau": 1.0, "g": 0.0}
"""What a parameter is that is not given, by its name or by what is in front of ``_``: it changes nothing."""


def parameters_of_the_bar() -> tuple[str, ...]:
    """Everything that can be given."""
    return (*(parameter.name for parameter in TENDON), *CONSTANTS)


def given_to_the_bar(asked: Mapping[str, str | float], names: Sequence[str], where: str) -> dict[str, str | float]:
    """What each parameter of the bar is: as asked, else the parameter among ``names`` that is called the same.

    Raises :class:`BadInput`, of ``where``.
    """
    known = parameters_of_the_bar()
    for name, what in asked.items():
        if name not in known:
            raise BadInput(f"{where}.{name}", "no parameter of the bar", f"one of {', '.join(known)}")
        if isinstance(what, str) and (name in CONSTANTS or what not in names):
            expected = "a number" if name in CONSTANTS else f"a number, or one of {', '.join(names)}"
            raise BadInput(f"{where}.{name}", shown(what), expected)
    given = {name: name for name in known if name in names and name not in CONSTANTS} | dict(asked)
    if not any(name in given for name in MODULI):
        expected = f"{' or '.join(MODULI)}, as a number or a parameter of the model"
        raise BadInput(where, "a bar without stiffness", expected)
    return dict(sorted(given.items()))
