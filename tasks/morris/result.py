"""The result of a Morris screening: what ``morris.json`` holds."""

from collections.abc import Mapping
from dataclasses import dataclass

from sinew.tasks.study.result import Count, NotNegatives, Numbers, Result, Share

KEYS = ("mu", "mu_star", "mu_star_conf", "sigma")


@dataclass(frozen=True, eq=False)
class Effects:
    """Statistics ``[d]`` of the elementary effects of each parameter over its whole range, in units of the outcome.

    ``mu``: mean; ``mu_star``: mean of the absolute values, with the half-width of its interval; ``sigma``: standard
    deviation, which is large for parameters whose effect depends on the others or is not linear.
    """

    mu: Numbers
    mu_star: Numbers
    mu_star_conf: NotNegatives
    sigma: Numbers


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
    mu_star: Numbers
    mu_star_conf: NotNegatives
    sigma: Numbers
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

    @property
    def total(self) -> Effects:
        """The effects on the objective of all protocols together."""
        return Effects(self.mu, self.mu_star, self.mu_star_conf, self.sigma)

    def panels(self) -> dict[str, Effects]:
        """Effects by the title under which a person sees them: all together, by protocol, by specimen."""
        several = dict(self.protocols) if len(self.protocols) > 1 else {}
        return {self.objective: self.total} | several | (dict(self.specimens) if len(self.specimens) > 1 else {})


RESULT = MorrisResult
