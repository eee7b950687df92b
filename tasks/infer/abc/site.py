"""A site whose parameters are inferred."""

from dataclasses import dataclass

from sinew.tasks.infer.abc.noise import CurveNoise
from sinew.tasks.infer.abc.observations import SiteEvaluation
from sinew.tasks.infer.abc.prior import Prior
from sinew.tasks.model import Specimen


@dataclass(frozen=True)
class Site:
    """A site to infer: its specimens, the evaluation that compares all of them, the prior, and noise to simulate."""

    name: str
    specimens: tuple[Specimen, ...]
    evaluation: SiteEvaluation
    prior: Prior
    noise: CurveNoise | None
