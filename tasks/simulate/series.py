"""A measured quantity along a protocol, as it enters the objective of a fit."""

from dataclasses import dataclass

import numpy as np

from sinew.tasks.simulate import Array


@dataclass(frozen=True, eq=False)
class Series:
    """What was measured of an ``output`` along a ``protocol``: ``values`` ``[t]``, NaN where nothing was.

    ``field`` is what the store calls its simulated points. Both are divided by ``level``: 1 N where the force alone is
    compared, the noise level of the output where there are several.
    """

    output: str
    protocol: str
    field: str
    time_s: Array
    values: Array
    level: float

    @property
    def there(self) -> Array:
        """Whether it was measured ``[t]``."""
        return np.isfinite(self.values)

    @property
    def count(self) -> int:
        """How many points were measured."""
        return int(self.there.sum())

    def shares(self, rows: Array) -> Array:
        """For each of ``rows`` ``[k]``, how many of the measured points are nearest to it."""
        before = np.concatenate([[0], np.cumsum(self.there)])
        between = (rows[1:] + rows[:-1] + 1) // 2
        return np.diff(np.concatenate([[0], before[between], before[-1:]])).astype(float)

    def at(self, rows: Array) -> Array:
        """The measured values at ``rows`` ``[k]``, in levels; interpolated in time where nothing was measured."""
        there = self.there
        if not there.all():
            return np.interp(self.time_s[rows], self.time_s[there], self.values[there]) / self.level
        return self.values[rows] / self.level


def with_unit(name: str, unit: str) -> str:
    """A name for a column: ``force_N``, ``width_change_mm``, ``lateral_strain``."""
    return (
        name if unit == "1" or name.endswith(f"_{unit}") else f"{name}_{unit.replace('/', '_per_').replace(' ', '_')}"
    )
