"""The section ``calibrate`` of a study."""

from typing import Annotated, Literal

from pydantic import Field

from sinew.tasks.study.fields import Specimens, TaskSettings
from sinew.tasks.study.settings_file import Section


class BayesianSettings(Section):
    """Bayesian optimisation: ``evaluations``, of which ``initial`` are random; ``pending`` are under way at a time.

    ``seeds``: how many evaluations that the store has already inform the surrogate from the start.
    """

    evaluations: Annotated[int, Field(ge=2, le=1000)] = 100
    initial: Annotated[int, Field(ge=1, le=1000)] = 10
    pending: Annotated[int, Field(ge=1, le=100)] = 1
    seeds: Annotated[int, Field(ge=0, le=1000)] = 40


class Settings(TaskSettings):
    """``methods``, each with ``evaluations`` for each specimen; least squares uses them from up to ``starts`` points.

    ``hybrid`` polishes the best points of the Bayesian optimisation, whose evaluations count as its own.
    """

    specimens: Specimens = "all"
    methods: Annotated[list[Literal["bayesian", "hybrid", "least_squares"]], Field(min_length=1)] = Field(
        default_factory=lambda: ["bayesian", "hybrid"]  # type: ignore[arg-type]
    )
    starts: Annotated[int, Field(ge=1, le=1000)] = 5
    evaluations: Annotated[int, Field(ge=10, le=10**6)] = 600
    bayesian: BayesianSettings = BayesianSettings()
