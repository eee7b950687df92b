"""Evaluations with known posteriors, for the sampler: a mean that is observed with noise, or not at all."""

import hashlib
import time
from dataclasses import dataclass

import numpy as np

from sinew.runner.evaluation.batch import Outcome
from sinew.runner.store.schema import STATUSES, Field, TableSpec

SD = 0.5


@dataclass(frozen=True)
class NoisyMean:
    """``y = slope * mean + noise``: the noise follows from the parameters' bytes: equal rows, equal outcomes.

    A share ``failing`` of the rows fails, whatever the parameters; ``seconds`` per row.
    """

    slope: float = 1.0
    failing: float = 0.0
    seconds: float = 0.0
    salt: int = 0

    def __call__(self, parameters: np.ndarray) -> Outcome:
        time.sleep(self.seconds * len(parameters))
        noise, fails = [], []
        for row in parameters:
            digest = hashlib.blake2b(row.tobytes() + str(self.salt).encode(), digest_size=16).digest()
            rng = np.random.default_rng(np.frombuffer(digest, dtype=np.uint64))
            noise.append(SD * rng.standard_normal())
            fails.append(rng.random() < self.failing)
        y = self.slope * parameters[:, 0] + np.array(noise)
        status = np.where(fails, STATUSES.index("diverged"), 0).astype(np.int8)
        messages = tuple("it diverged" if failed else "" for failed in fails)
        y[np.array(fails)] = np.nan
        return Outcome({"y": y}, status, messages if any(fails) else ())

    def table(self) -> TableSpec:
        identity = {"slope": self.slope, "failing": self.failing, "salt": self.salt}
        return TableSpec(f"mean {self.slope:g}", identity, ("mean",), ("1",), (Field("y", (), "1", "observed"),), ())
