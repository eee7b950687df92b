"""How many particles a generation has: as many as are worth the effective sample size that is wanted."""

import math
from typing import Any

from pyabc.populationstrategy import PopulationStrategy

MOST = 10


class EnoughParticles(PopulationStrategy):  # type: ignore[misc]
    """At least ``particles``, and so many that they are worth ``ess`` of equal weight, if weights are as before.

    At most ``MOST`` times as many as either.
    """

    def __init__(self, particles: int, ess: int) -> None:
        super().__init__()
        self.least, self.ess, self.now = particles, ess, particles

    def update(self, transitions: Any, model_weights: Any, t: int | None = None) -> None:
        """Learn from the weights of the generation before, to which proposals were fitted."""
        most = MOST * max(self.least, self.ess)
        self.now = min(max(self.least, math.ceil(self.ess / transitions[0].worth_)), most)

    def __call__(self, t: int | None = None) -> int:
        return self.now if t is not None and t > 0 else self.least

    def get_config(self) -> dict[str, Any]:
        """As pyABC keeps it in its history."""
        return {**super().get_config(), "particles": self.least, "ess": self.ess}
