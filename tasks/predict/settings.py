"""The section ``predict`` of a study."""

from typing import Annotated

from pydantic import Field

from sinew.tasks.study.fields import TaskSettings


class Settings(TaskSettings):
    """Bands that hold ``probability`` of ``draws`` from the posterior, and of specimens that are still to come."""

    draws: Annotated[int, Field(ge=2, le=10_000)] = 40
    probability: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
