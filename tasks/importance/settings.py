"""The section ``importance`` of a study."""

from typing import Annotated

from pydantic import Field

from sinew.tasks.study.fields import TaskSettings


class Settings(TaskSettings):
    """Random forests on the rows of the Sobol study."""

    trees: Annotated[int, Field(ge=10, le=10_000)] = 100
    repeats: Annotated[int, Field(ge=2, le=1000)] = 10
    max_rows: Annotated[int, Field(ge=100)] = 10_000
