"""A specimen whose outputs change linearly from those of a run, as other runs have shown.

Where no run has shown how the force follows the displacement, it is that of a specimen without memory.
"""

from dataclasses import dataclass

import numpy as np

from sinew.tasks.simulate import Array
from sinew.tasks.simulate.secants import Secants

MOVED = 1e-9  # of the largest displacement: smaller motions tell no stiffness
SHOWN = 1e-4  # of the largest displacement: the answers to smaller steps drown in the solver's tolerance
CLEAR, TRUST = 0.01, 3.0  # of the largest step: smaller ones tell none; and the factor by which one may change it


@dataclass(frozen=True, eq=False)
class Run:
    """Outputs ``[1 + k, t]`` of the specimen along a displacement ``[t]`` (mm), the force (N) first."""

    displacement_mm: Array
    courses: Array


@dataclass(frozen=True, eq=False)
class Response:
    """How outputs ``[1 + k, t]`` change with the displacement ``[t]`` (mm).

    ``stiffness`` ``[t]`` (N/mm): of a specimen without memory, for what no run has shown.
    """

    shown: Secants
    stiffness: Array

    @classmethod
    def first(cls, run: Run, largest: float) -> "Response":
        """A guess from one run; ``largest`` displacement of the protocol (mm)."""
        none = Secants.none(run.displacement_mm.size, *run.courses.shape)
        return cls(none, _slopes(run.displacement_mm, run.courses[0], MOVED * largest))

    def to(self, steps: Array) -> tuple[Array, Array]:
        """The changes ``[n, 1 + k, t]`` with ``steps`` ``[n, t]``, and that part of each that no run has shown."""
        change, rest = self.shown.split(steps)
        change[:, 0] += self.stiffness * rest
        return change, rest

    def after(self, step: Array, change: Array, largest: float) -> "Response":
        """What it is after a run, a ``step`` ``[t]`` from another, whose outputs had changed; ``largest`` as before."""
        if np.abs(step).max() < SHOWN * largest:
            return self
        return Response(self.shown.after(step, change), _secants(self.stiffness, step, change[0]))


@dataclass(frozen=True, eq=False)
class LinearSpecimens:
    """Specimens near a ``run``; along its displacement, each has other ``courses`` ``[n, 1 + k, t]``."""

    run: Run
    courses: Array
    response: Response

    @classmethod
    def of(cls, run: Run, response: Response) -> "LinearSpecimens":
        """The one that was run."""
        return cls(run, run.courses[np.newaxis], response)

    def along(self, displacement: Array) -> Array:
        """Their outputs ``[n, 1 + k, t]`` along displacements ``[n, t]`` (mm)."""
        return self.courses + self.response.to(displacement - self.run.displacement_mm)[0]


def _secants(stiffness: Array, step: Array, change: Array) -> Array:
    """The stiffness ``[t]`` (N/mm) by the ``change`` (N) of the force over a ``step`` (mm), where that tells it."""
    size = np.abs(step)
    tells = size > CLEAR * size.max()
    secant = change / np.where(tells, step, 1.0)
    return np.where(tells & (secant > 0.0), np.clip(secant, stiffness / TRUST, TRUST * stiffness), stiffness)


def _slopes(displacement: Array, force: Array, least: float) -> Array:
    """A first guess of the stiffness ``[t]`` (N/mm): of the last motion, or the next one before the first."""
    steps = np.diff(displacement)
    moving = np.flatnonzero(np.abs(steps) > least)
    if not moving.size:
        return np.zeros_like(force)
    slopes = np.abs(np.diff(force)[moving] / steps[moving])
    at = np.clip(np.searchsorted(moving, np.arange(force.size) - 1, side="right") - 1, 0, None)
    return np.asarray(slopes[at])
