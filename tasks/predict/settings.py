"""The section ``predict`` of a study."""

import math
from typing import Annotated

from pydantic import Field

from sinew.tasks.study.fields import TaskSettings

HDI = 3  # simulations for its band: a posterior's mean and both ends of its interval
NEW, MOST_NEW = 400, 10_000  # draws of a new specimen: where they cost next to nothing, and at most


def fewest_of_new(probability: float) -> int:
    """Draws of a new specimen below which no two of them hold one more with this probability."""
    return math.ceil(round(2.0 / (1.0 - probability) - 1.0, 6))


class Settings(TaskSettings):
    """Bands that hold ``probability`` of ``draws`` from the posterior, and of specimens that are still to come.

    ``new``: draws of a new specimen, after an inference by likelihood: 39 or more for a band of 95 %, 100 or more for
    one of whole curves. If omitted, 400 where the simulator takes next to no time, else as many as ``draws``, and at
    least as many as the band needs.
    """

    draws: Annotated[int, Field(ge=2, le=10_000)] = 40
    new: Annotated[int, Field(ge=4, le=MOST_NEW)] | None = None
    probability: Annotated[float, Field(gt=0.5, le=0.9998)] = 0.95

    def of_new(self, *, quick: bool) -> int:
        """How many draws of a new specimen are simulated."""
        if self.new is not None:
            return self.new
        return min(max(NEW if quick else self.draws, fewest_of_new(self.probability)), MOST_NEW)
