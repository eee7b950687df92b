"""The parameters of the fibre-reinforced viscoelastic tendon, with the ranges of Pekedis (2025), table 1."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Parameter:
    """One parameter: ``minimum`` and ``maximum`` bound its study, ``reference`` is used where nothing else is given.

    A fixed parameter has equal bounds. ``floor`` and ``ceiling`` bound what is physically possible; a floor that is
    ``exclusive`` is not possible itself (a relaxation time of 0 s). For a parameter of a user's ``own`` model, only
    the range is known, so the range bounds what is possible. ``strain_power``: the power of the
    tests' strain with which a range grows, 1 for a strain, -1 for a number per strain.
    """

    name: str
    unit: str
    minimum: float
    maximum: float
    reference: float
    description: str
    floor: float = 0.0
    ceiling: float = np.inf
    exclusive: bool = False
    own: bool = False
    strain_power: int = 0

    @property
    def fixed(self) -> bool:
        return self.minimum == self.maximum

    @property
    def limits(self) -> str:
        """What values are possible, in words."""
        if self.own:
            return f"from {self.minimum:g} to {self.maximum:g}, the range in the study"
        above = f"{'above' if self.exclusive else 'at least'} {self.floor:g}"
        below = "" if self.ceiling == np.inf else f" and below {self.ceiling:g}"
        return f"{above}{below}{'' if self.unit == '1' else f' {self.unit}'}"

    def possible(self, value: float) -> bool:
        """Whether the model can be evaluated at ``value`` at all."""
        above = value > self.floor if self.exclusive else value >= self.floor
        return bool(above and value < self.ceiling)


def bounds(parameters: Sequence[Parameter]) -> tuple[Array, Array]:
    """The lower and the upper ends ``[k]`` of the ranges of ``k`` parameters, in their order and units."""
    lower = np.array([parameter.minimum for parameter in parameters], dtype=float)
    return lower, np.array([parameter.maximum for parameter in parameters], dtype=float)


def scaled(parameters: Sequence[Parameter], unit: Array) -> Array:
    """Values ``[n, k]`` of ``k`` parameters at points ``[n, k]`` of the unit cube: 0 is a lower end, 1 an upper one."""
    lower, upper = bounds(parameters)
    return np.asarray(lower + (upper - lower) * unit)


def unscaled(parameters: Sequence[Parameter], values: Array) -> Array:
    """The points of the unit cube of which :func:`scaled` makes ``values``; no range may be a point."""
    lower, upper = bounds(parameters)
    return np.asarray((values - lower) / (upper - lower))


LARGEST_LAMBDA_0 = 2.0  # the stretch at which the toe of a study may end at most


def _parameter(name: str, unit: str, minimum: float, maximum: float, description: str, **physical: Any) -> Parameter:
    return Parameter(name, unit, minimum, maximum, (minimum + maximum) / 2, description, **physical)


TENDON: tuple[Parameter, ...] = (
    _parameter("E_f", "MPa", 160, 275, "fibre modulus in the linear region"),
    _parameter("alpha_f", "1", 0, 10_000, "exponent of the fibres' toe region"),
    _parameter("g_1f", "1", 0.8, 1.0, "fibre relaxation, first strength"),
    _parameter("g_2f", "1", 0.8, 2.1, "fibre relaxation, second strength"),
    _parameter("g_3f", "1", 0.8, 2.1, "fibre relaxation, third strength"),
    _parameter("tau_1f", "s", 0.1, 2.0, "fibre relaxation, first time", exclusive=True),
    _parameter("tau_2f", "s", 2.0, 20.0, "fibre relaxation, second time", exclusive=True),
    _parameter("tau_3f", "s", 20.0, 200.0, "fibre relaxation, third time", exclusive=True),
    _parameter("E_m", "MPa", 11, 70, "matrix modulus"),
    _parameter("g_1m", "1", 0.8, 1.5, "matrix relaxation, first strength"),
    _parameter("g_2m", "1", 0.8, 2.1, "matrix relaxation, second strength"),
    _parameter("g_3m", "1", 0.8, 2.1, "matrix relaxation, third strength"),
    _parameter("tau_1m", "s", 0.1, 2.0, "matrix relaxation, first time", exclusive=True),
    _parameter("tau_2m", "s", 3.0, 20.0, "matrix relaxation, second time", exclusive=True),
    _parameter("tau_3m", "s", 20.0, 200.0, "matrix relaxation, third time", exclusive=True),
    _parameter("nu_m", "1", 0.0, 0.4, "Poisson's ratio of the matrix", floor=-1.0, ceiling=0.5, exclusive=True),
)


def own_parameter(name: str, unit: str, minimum: float, maximum: float, reference: float | None = None) -> Parameter:
    """A parameter of a user's own template; its ``reference`` is the middle of its range unless given."""
    above = float(np.nextafter(maximum, np.inf))
    middle = (minimum + maximum) / 2 if reference is None else reference
    return Parameter(name, unit, minimum, maximum, middle, "", minimum, above, own=True)


@dataclass(frozen=True)
class Model:
    """The tissue: its parameters in order, and constants that a study does not vary.

    ``beta`` is the power in the fibres' exponent, ``lambda_0`` the stretch at which they become linear. A ``law``
    other than ``tendon`` is that of a user's own template, which has neither.
    """

    parameters: tuple[Parameter, ...] = TENDON
    beta: float = 2.0
    lambda_0: float = 1.01
    law: str = "tendon"
    names: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(parameter.name for parameter in self.parameters))

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The parameters that a study varies."""
        return tuple(parameter for parameter in self.parameters if not parameter.fixed)

    @property
    def reference(self) -> Array:
        """Reference values ``[d]``."""
        return np.array([parameter.reference for parameter in self.parameters])

    def full(self, names: tuple[str, ...], values: Array) -> Array:
        """Parameter sets ``[n, d]`` from ``values`` ``[n, len(names)]``; the others stay at their reference."""
        if names == self.names:
            return values
        rows = np.tile(self.reference, (len(values), 1))
        rows[:, [self.names.index(name) for name in names]] = values
        return rows

    def identity(self) -> dict[str, Any]:
        """What an evaluation depends on besides its parameters."""
        if self.law != "tendon":
            return {"law": self.law, "parameters": list(self.names)}
        return {"law": "tendon", "beta": self.beta, "lambda_0": self.lambda_0, "parameters": list(self.names)}

    def with_parameter(self, parameter: Parameter) -> "Model":
        """The same model with one parameter replaced by name."""
        return replace(self, parameters=tuple(parameter if p.name == parameter.name else p for p in self.parameters))


def from_unit(model: Model, points: Array) -> Array:
    """Parameter sets ``[n, all]`` from points ``[n, free]`` of the unit cube; what is fixed stays at its reference."""
    return model.full(tuple(parameter.name for parameter in model.free), scaled(model.free, points))


def to_unit(model: Model, parameters: Array) -> Array:
    """Points ``[n, free]`` of the unit cube from parameter sets ``[n, all]``."""
    columns = [model.names.index(parameter.name) for parameter in model.free]
    return unscaled(model.free, parameters[:, columns])
