"""Evaluations that workers of the tests can import: quick, slow, failing and deadly ones."""

import errno
import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinew.runner.cluster import drain
from sinew.runner.evaluation.batch import Outcome
from sinew.runner.store.schema import STATUSES, Coordinate, Field, TableSpec

POINTS = 7


def table_spec(identity: str = "quick", points: int = POINTS) -> TableSpec:
    """A table for two parameters, one number and one curve."""
    return TableSpec(
        title=f"specimen {identity}",
        identity={"evaluation": identity},
        parameters=("a", "b"),
        units=("MPa", "s"),
        fields=(
            Field("objective", ("protocol",), "N", "distance"),
            Field("force", ("time",), "N", "force"),
        ),
        coordinates=(
            Coordinate("protocol", "protocol", np.array(["pull"], dtype=object)),
            Coordinate("time", "time", np.arange(float(points)), "s"),
        ),
    )


def must_end_in(seconds: float) -> None:
    """Move the deadline of the worker that runs this."""
    os.environ[drain.DEADLINE] = str(time.time() + seconds)


@dataclass(frozen=True)
class Quick:
    """force = a * time + b. What goes wrong depends on the first parameter, see the tests that set ``bad``."""

    notes: Path | None = None
    seconds_per_row: float = 0.0
    bad: str = ""
    points: int = POINTS

    def __call__(self, parameters: np.ndarray) -> Outcome:
        count = len(parameters)
        hit = parameters[:, 0] < 0
        if self.bad == "raise" and hit.any():
            raise ArithmeticError("no such tissue")
        if self.bad == "disk" and hit.any():
            raise OSError(errno.ENOSPC, "No space left on device")
        if self.bad == "kill" and hit.any():
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(self.seconds_per_row * count)
        force = parameters[:, :1] * np.arange(self.points) + parameters[:, 1:]
        status = np.zeros(count, dtype=np.int8)
        if self.bad == "crashed":
            status[hit] = STATUSES.index("crashed")
        if self.bad == "diverged":
            status[hit] = STATUSES.index("diverged")
        if self.bad == "nan":
            force[hit, 3] = np.nan
        if self.notes is not None:
            with open(self.notes, "a", encoding="utf-8") as file:  # one write of few bytes: whole even when killed
                file.write("".join(f"{row[0]!r},{row[1]!r}\n" for row in parameters.tolist()))
        return Outcome(
            {"objective": force[:, :1] ** 2, "force": force},
            status,
            tuple("it broke" if failed else "" for failed in status),
        )
