"""The section ``predict`` of a study."""

from typing import Annotated

from pydantic import Field

from sinew.tasks.study.fields import TaskSettings

NEW = 400  # draws of a new specimen, where they cost next to nothing
LEAST = 4  # of them


class Settings(TaskSettings):
    """Bands that hold ``probability`` of ``draws`` from the posterior, and of specimens that are still to come.

    ``new``: draws of a new specimen, after an inference by likelihood; with 100 or more there is a band for whole
    curves. Without it, 400 where the simulator takes next to no time, else as many as ``draws``.
    """

    draws: Annotated[int, Field(ge=2, le=10_000)] = 40
    new: Annotated[int, Field(ge=4, le=10_000)] | None = None
    probability: Annotated[float, Field(gt=0.5, lt=1)] = 0.95

    def of_new(self, *, quick: bool) -> int:
        """How many draws of a new specimen are simulated."""
        if self.new is not None:
            return self.new
        return NEW if quick else max(self.draws, LEAST)
