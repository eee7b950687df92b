"""What became of one cohort of the benchmark: what ``cohort.json`` holds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from sinew.tasks.study.result import Count, NotNegative, Result, Share

Level = Literal["mean", "spread", "specimen"]


@dataclass(frozen=True)
class Ranked:
    """One truth and its posterior: what it is ``of``, and its ``rank`` among the draws, from 0 to 1.

    ``level``: ``mean`` or ``spread`` of a population, or ``specimen``; ``held``: whether the reported interval holds
    the truth; ``determined``: see the result of `sinew infer`.
    """

    cohort: int
    level: Level
    of: str
    parameter: str
    rank: Share
    held: bool
    determined: bool = True

    def inside(self, level: float) -> bool:
        """Whether the middle ``level`` of the draws hold the truth."""
        return abs(self.rank - 0.5) <= level / 2


@dataclass(frozen=True)
class LeftOut:
    """A curve of a specimen that was left out: the share of its ``points`` in the pointwise band of a new specimen.

    ``whole``: whether all of it is inside the band for whole curves.
    """

    site: str
    protocol: str
    points: Share
    whole: bool


@dataclass(frozen=True, eq=False)
class CohortResult(Result):
    """The ranks of all truths of a cohort, or the ``error`` for which it has no posterior.

    ``tarp`` by level: see :mod:`sinew.tasks.benchmark.infer.score`. ``contrasts``: parameters that are compared between
    the two sites, whose populations are one, and how many of them are called ``different``. ``left_out``: curves of
    further specimens, after an inference by likelihood.
    """

    TASK = "cohort"

    number: int
    method: str
    ranked: list[Ranked]
    tarp: Mapping[Level, list[Share]]
    contrasts: Count
    different: Count
    seconds: NotNegative
    error: str | None
    inputs: str
    left_out: list[LeftOut] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for more differences than contrasts, and for ranks of another cohort."""
        if self.different > self.contrasts:
            raise ValueError(f"{self.different} of {self.contrasts} contrasts are different")
        if any(one.cohort != self.number for one in self.ranked):
            raise ValueError(f"ranks of another cohort than {self.number}")
