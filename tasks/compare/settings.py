"""The section ``compare`` of a study."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from sinew.tasks.study.fields import TaskSettings

MOST_FITS = 100_000  # of the classifier, for each pair of sites: minutes


class Settings(TaskSettings):
    """``confidence`` of all intervals; the classifier of all parameters is judged by cross-validation.

    That has ``folds``, is repeated ``repeats`` times over other ones, and set against ``permutations`` of the sites.
    """

    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    folds: Annotated[int, Field(ge=2, le=100)] = 5
    repeats: Annotated[int, Field(ge=1, le=1000)] = 5
    permutations: Annotated[int, Field(ge=20, le=100_000)] = 200

    @model_validator(mode="after")
    def _of_few_fits(self) -> Self:
        fits = self.folds * (self.repeats + self.permutations)
        if fits > MOST_FITS:
            raise ValueError(f"folds x (repeats + permutations) is {fits:,}; expected at most {MOST_FITS:,}")
        return self
