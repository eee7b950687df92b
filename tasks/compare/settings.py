"""The section ``compare`` of a study."""

from typing import Annotated

from pydantic import Field

from sinew.tasks.study.fields import TaskSettings


class Settings(TaskSettings):
    """``confidence`` of all intervals; the classifier of all parameters is judged by cross-validation.

    That has ``folds``, is repeated ``repeats`` times over other ones, and set against ``permutations`` of the sites.
    """

    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    folds: Annotated[int, Field(ge=2, le=100)] = 5
    repeats: Annotated[int, Field(ge=1, le=1000)] = 5
    permutations: Annotated[int, Field(ge=20, le=100_000)] = 200
