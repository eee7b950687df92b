"""What a discovery says of its misfit, part by part of each test, and of the noise in units of which it is told."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sinew.tasks.study.result import OMIT, Correlation, Count, NotNegative, Number

LONGEST_UNIT = 24  # letters, as in a study


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of a specimen's curves: standard deviation at rest (N), lag-one correlation, growth with the force."""

    sd_N: NotNegative
    ar1: Correlation
    proportional: NotNegative


@dataclass(frozen=True)
class OtherNoise:
    """Noise of another quantity than the force: standard deviation in its ``unit``, and lag-one correlation.

    ``given``: the study says the standard deviation.
    """

    sd: NotNegative
    ar1: Correlation
    unit: str
    given: bool

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` where there is no noise, in times of which misfit is told."""
        if not 0.0 < self.sd < np.inf:
            raise ValueError(f"noise of {self.sd:g}")
        if len(self.unit) > LONGEST_UNIT:
            raise ValueError(f"a unit of {len(self.unit)} letters")


@dataclass(frozen=True)
class CellMisfit:
    """The misfit of one part of a test: ``z`` in units of chance, ``mean_N`` (N); measured minus simulated.

    ``quantity``: what is compared, with its ``mean`` in its own unit; None for the force.

    ``number`` is that of the step or cycle. Chance alone takes some cell of the cohort beyond ``limit`` with the
    probability of the study's setting, and beyond ``sure`` in one of fifty of these cases.
    """

    protocol: str
    phase: str
    number: Count
    z: Number
    mean_N: Number
    limit: Number
    sure: Number
    quantity: str | None = field(default=None, metadata=OMIT)
    mean: float | None = field(default=None, metadata=OMIT)

    @property
    def name(self) -> str:
        """What a person calls it: the protocol, the quantity unless it is the force, and the part."""
        protocol = self.protocol if self.quantity is None else f"{self.protocol}, {self.quantity}"
        return f"{protocol}: {self.phase} {self.number}"

    @property
    def beyond_chance(self) -> bool:
        return abs(self.z) > self.limit

    @property
    def far_beyond_chance(self) -> bool:
        return abs(self.z) > self.sure


Cells = Mapping[str, tuple[CellMisfit, ...]]


def course_name(model: str, quantity: str | None, protocol: str) -> str:
    """What a course of a ``model``, or what was ``measured``, is called in the store; None for the force."""
    return f"{model}_{protocol}" if quantity is None else f"{model}_{quantity}_{protocol}"


def check_compared(compared: Mapping[str, Mapping[str, OtherNoise]] | None, cells: Cells, after: Cells | None) -> None:
    """Raises :class:`ValueError` for cells of quantities, or noise of specimens, that do not belong together."""
    known = {name: set(others) for name, others in (compared or {}).items()}
    if compared is not None and (set(known) != set(cells) or not all(known.values())):
        raise ValueError("compared: other specimens than in cells, or nothing of one")
    for every in (cells, after or {}):
        for name, parts in every.items():
            if not {cell.quantity for cell in parts} <= known.get(name, set()) | {None}:
                raise ValueError(f"cells: of a quantity of {name} that was not compared")
            if any((cell.quantity is None) != (cell.mean is None) for cell in parts):
                raise ValueError(f"cells: a mean of {name} without a quantity, or the other way round")
