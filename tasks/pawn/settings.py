"""The section ``pawn`` of a study."""

from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from sinew.tasks.study.fields import TaskSettings


class Settings(TaskSettings):
    """PAWN indices from the rows of the Sobol study, with each parameter's range cut into ``slides``.

    ``resamples``: bootstrap resamples behind the intervals, and permutations behind the level of no influence.
    """

    slides: Annotated[int, Field(ge=4, le=50)] = 10
    resamples: Annotated[int, Field(ge=20, le=10_000)] = 100
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    @field_validator("slides")
    @classmethod
    def _can_be_cut(cls, value: int) -> int:
        step = 1 / value
        if np.arange(0, 1 + step, step).max() > 1:  # how SALib cuts; rounding takes some numbers beyond the range
            raise ValueError(f"{value} slides, which SALib cannot cut; expected another number, such as 10")
        return value
