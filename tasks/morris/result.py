"""The result of a Morris screening: what ``morris.json`` holds."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sinew.tasks.study.result import ROUNDING, Count, NotNegatives, Numbers, Result, Share, check_lengths

KEYS = ("mu", "mu_star", "mu_star_conf", "sigma")


@dataclass(frozen=True, eq=False)
class Effects:
    """Statistics ``[d]`` of the elementary effects of each parameter over its whole range, in units of the outcome.

    ``mu``: mean; ``mu_star``: mean of the absolute values, with the half-width of its interval; ``sigma``: standard
    deviation, which is large for parameters whose effect depends on the others or is not linear.
    """

    mu: Numbers
    mu_star: NotNegatives
    mu_star_conf: NotNegatives
    sigma: NotNegatives


@dataclass(frozen=True, eq=False)
class MorrisResult(Result):
    """Elementary effects of the free parameters on the total objective, and on each protocol's and specimen's.

    ``field`` is what the store calls the quantity under study and ``objective`` says it in words. ``trajectories`` were
    planned; those with a failed row, ``rows`` in all of which ``failed``, are left out.
    """

    TASK = "morris"
    LIBRARIES = ("SALib",)

    names: list[str]
    bounds: list[list[int | float]]
    mu: Numbers
    mu_star: NotNegatives
    mu_star_conf: NotNegatives
    sigma: NotNegatives
    rows: Count
    failed: Count
    trajectories: Count
    trajectories_used: Count
    levels: Count
    confidence: Share
    objective: str
    unit: str
    field: str
    protocols: Mapping[str, Effects]
    specimens: Mapping[str, Effects]
    inputs: str

    def __post_init__(self) -> None:
        """Raises :class:`ValueError` for numbers that contradict each other."""
        if self.failed > self.rows or self.trajectories_used > self.trajectories:
            told = f"{self.trajectories_used} of {self.trajectories} trajectories are used"
            told += f", {self.failed} of {self.rows} rows failed"
            raise ValueError(told)
        if self.rows != self.trajectories * (len(self.names) + 1):
            raise ValueError(f"rows: {self.rows:,} of {self.trajectories:,} trajectories of {len(self.names) + 1} each")
        if self.levels < 2 or self.levels % 2 or not 0 < self.confidence < 1:
            raise ValueError(f"{self.levels:,} levels, confidence {self.confidence:g}")
        if len(self.bounds) != len(self.names) or any(len(one) != 2 or one[0] > one[1] for one in self.bounds):
            raise ValueError("bounds: not two numbers in order for each name")
        for one in (self.total, *self.protocols.values(), *self.specimens.values()):
            check_lengths(self.names, one, KEYS)
            if np.any(np.abs(one.mu) > one.mu_star * (1.0 + ROUNDING) + ROUNDING * np.abs(one.mu)):
                raise ValueError("mu: larger than mu_star, the mean of the absolute values")

    @property
    def total(self) -> Effects:
        """The effects on the objective of all protocols together."""
        return Effects(self.mu, self.mu_star, self.mu_star_conf, self.sigma)

    def panels(self) -> dict[str, Effects]:
        """Effects by the title under which a person sees them: all together, by protocol, by specimen."""
        several = dict(self.protocols) if len(self.protocols) > 1 else {}
        return {self.objective: self.total} | several | (dict(self.specimens) if len(self.specimens) > 1 else {})


RESULT = MorrisResult
