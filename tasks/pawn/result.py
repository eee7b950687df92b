"""The result of a PAWN analysis: what ``pawn.json`` holds."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.tasks.simulate.studied_quantity import panels
from sinew.tasks.study.result import OMIT, ROUNDING, Count, NotNegatives, Result, Share, Shares, check_lengths

KEYS = ("median", "median_low", "median_high", "maximum", "mean", "CV")


@dataclass(frozen=True, eq=False)
class Pawn:
    """Kolmogorov-Smirnov distances ``[d]`` between the outcome and the outcome within one slide of a parameter.

    Of the slides: ``median`` with its interval, ``maximum``, ``mean`` and coefficient of variation ``CV``.
    ``no_influence``: a median below it cannot be told from that of a parameter without any influence.
    """

    median: Shares
    median_low: Shares
    median_high: Shares
    maximum: Shares
    mean: Shares
    CV: NotNegatives
    no_influence: Share


@dataclass(frozen=True, eq=False)
class PawnResult(Result):
    """PAWN indices of the free parameters for the total objective, each protocol's, and each of a template's outputs.

    ``rows`` of the Sobol study's first and last matrix are used, without those that ``failed``. ``field`` is what the
    store calls the quantity under study and ``objective`` says it in words.
    """

    TASK = "pawn"
    LIBRARIES = ("SALib",)

    names: list[str]
    median: Shares
    median_low: Shares
    median_high: Shares
    maximum: Shares
    mean: Shares
    CV: NotNegatives
    no_influence: Share
    slides: Count
    confidence: Share
    rows: Count
    failed: Count
    objective: str
    field: str
    protocols: Mapping[str, Pawn]
    inputs: str
    outputs: Mapping[str, Pawn] | None = dataclasses.field(default=None, metadata=OMIT)

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for numbers that contradict each other."""
        if self.failed > self.rows:
            raise ValueError(f"failed: {self.failed} of {self.rows} rows")
        for one in self.by_output().values():
            check_lengths(self.names, one, KEYS)
            if np.any(one.median_low > one.median + ROUNDING) or np.any(one.median > one.median_high + ROUNDING):
                raise ValueError("median: outside median_low to median_high")
            if np.any(np.maximum(one.median, one.mean) > one.maximum + ROUNDING):
                raise ValueError("maximum: below the median or the mean")

    @property
    def total(self) -> Pawn:
        """The indices of the objective of all protocols together."""
        return Pawn(**{field.name: getattr(self, field.name) for field in dataclasses.fields(Pawn)})

    def by_output(self) -> dict[str, Pawn]:
        """Indices by name: all together (``total``), each protocol, each of a template's outputs."""
        return {"total": self.total, **self.protocols, **(self.outputs or {})}

    def panels(self) -> dict[str, Any]:
        """Indices by the title under which a person sees them; what would be shown twice is left out."""
        return panels(self.total, self.protocols, self.outputs or {}, self.field, self.objective)


RESULT = PawnResult
