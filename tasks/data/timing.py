"""Times of files that have none, by what a person says: how often was sampled, or how fast the machine moved."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput, shown

LEAST, MOST = 1e-6, 1e9
Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Timing:
    """``rate_hz``: rows per second. ``speed``: of the motion, in mm/s, or 1/s for strain and stretch. At most one.

    ``speed_column``: the title or number of a column of speeds, which goes before ``speed``.
    """

    rate_hz: float | None = None
    speed: float | None = None
    speed_column: str | None = None

    def __post_init__(self) -> None:
        """Raises :class:`BadInput` for what is no rate, and where both are given."""
        for option, value in (("--rate-hz", self.rate_hz), ("--speed", self.speed)):
            if value is not None and not LEAST <= value <= MOST:
                raise BadInput(option, f"{value:g}", f"a number from {LEAST:g} to {MOST:g}")
        for option, given in (("--speed", self.speed), ("--speed-column", self.speed_column)):
            if self.rate_hz is not None and given is not None:
                raise BadInput(option, "given together with --rate-hz", "one of them")

    @property
    def given(self) -> bool:
        return any(one is not None for one in (self.rate_hz, self.speed, self.speed_column))

    def __str__(self) -> str:
        if self.speed_column is not None:
            return f"--speed-column {shown(self.speed_column)}"
        return f"--rate-hz {self.rate_hz:g}" if self.rate_hz is not None else f"--speed {self.speed:g}"

    def times(self, motion: Array, speeds: Array | None = None) -> Array:
        """Times ``[t]`` (s) since the first row, for the ``motion`` ``[t]`` (mm, or 1). They may fail to increase.

        ``speeds`` ``[t]``: those of the column, in the unit of ``speed``.
        """
        if self.rate_hz is not None:
            return np.arange(motion.size) / self.rate_hz
        by = self.speed if speeds is None else speeds
        assert by is not None, "one of them is given"
        way = np.abs(np.diff(motion, prepend=motion[:1]))
        return np.asarray(np.cumsum(way / by))
