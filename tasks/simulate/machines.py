"""Machines with effects of given sizes that pull specimens: what they leave to a specimen, and what they read."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from sinew.tasks.model import Protocol
from sinew.tasks.model.acting import Acting, displaced, gives_way, read, ways, with_constants
from sinew.tasks.model.effect import Bars
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.linear_specimens import LinearSpecimens

ITERATIONS, LEFT = 40, 1e-4  # to the balance with a linear specimen, and the part of the residual that may remain
STEPS, RANK = 8, 1e-8  # of these: how many are remembered, and how far from each other they must be


@dataclass(frozen=True, eq=False)
class Machines:
    """Effects ``chosen``, with the values of ``n`` rows, around a specimen of this length, along one protocol.

    ``rigid_N`` ``[n, t]``: the force if nothing gave way, for effects that ask for it. What is no number stays so.
    """

    chosen: Acting
    length_mm: float
    protocol: Protocol
    count: int = 1
    rigid_N: Array | None = None

    @property
    def gives_way(self) -> bool:
        """Whether a specimen's displacement depends on its force."""
        return gives_way(self.chosen)

    @property
    def asks_rigid(self) -> bool:
        """Whether they need ``rigid_N``."""
        return any(effect.asks_rigid for effect, _ in self.chosen)

    @cached_property
    def largest_mm(self) -> float:
        """The largest displacement of the grips."""
        return max(float(np.abs(self._grips.grips_mm).max()), np.finfo(float).tiny)

    @cached_property
    def _grips(self) -> Bars:
        area = {"area_mm2": np.ones((self.count, 1))}  # times that of the simulator
        bars = with_constants(self.chosen, Bars.at_grips(self.protocol, self.length_mm, area, self.count))
        return bars if self.rigid_N is None else replace(bars, rigid_N=bars.material["area_mm2"] * self.rigid_N)

    def with_rigid(self, force: Array) -> "Machines":
        """The same where specimens whose grips gave no way had a ``force`` ``[n, t]``."""
        return replace(self, rigid_N=force)

    def at_rest(self) -> Array:
        """The displacement ``[n, t]`` (mm) of specimens that have no force."""
        return displaced(self.chosen, self._grips).displacement_mm

    def at_grips(self) -> Array:
        """The displacement ``[n, t]`` (mm) of specimens if nothing gave way."""
        return self._grips.displacement_mm

    def left(self, displacement: Array, force: Array) -> Array:
        """What is left to specimens under a ``force``, less their displacement, each ``[n, t]``."""
        return displaced(self.chosen, self._under(force)).displacement_mm - displacement

    def read(self, displacement: Array, force: Array) -> Array:
        """What the load cells report ``[n, t]`` (N) of the force of specimens."""
        return read(self.chosen, replace(self._under(force), displacement_mm=displacement)).force_N

    def in_balance(self, specimens: LinearSpecimens) -> Array:
        """The displacements ``[n, t]`` (mm) of linear specimens that agree with their forces, or come nearest to it."""
        at = np.tile(specimens.run.displacement_mm, (self.count, 1))
        force = specimens.along(at)[:, 0]
        left = self.left(at, force)
        best, least = at, np.linalg.norm(left, axis=1)
        enough = LEFT * least
        steps = _Steps()
        for _ in range(ITERATIONS):
            at = at + steps.next(at, left, partial(self._change, specimens.response.stiffness, force))
            force = specimens.along(at)[:, 0]
            left = self.left(at, force)
            size = np.linalg.norm(left, axis=1)
            nearer = size < least
            best, least = np.where(nearer[:, np.newaxis], at, best), np.where(nearer, size, least)
            if not np.any(size > enough):
                break
        return best

    def _under(self, force: Array) -> Bars:
        return replace(self._grips, force_N=self._grips.material["area_mm2"] * force)

    def _change(self, stiffness: Array, force: Array, residual: Array) -> Array:
        """The change ``[n, t]`` (mm) that removes a residual from specimens of this ``stiffness`` ``[t]`` (N/mm)."""
        from sinew.tasks.simulate import memory  # its kernels are slow to import, and most effects need none

        bars = self._under(force)
        nothing, change = np.zeros_like(residual), np.empty_like(residual)
        memory.correction(  # of bars without branches: their force follows their displacement
            *self.protocol.distinct_steps,
            *(np.empty(0, np.int64), np.empty((self.count, 0)), np.empty((self.count, 0)), np.ones((self.count, 1)), 0),
            np.ones_like(nothing),
            nothing,
            np.stack([bars.material["area_mm2"] * stiffness, nothing, nothing]),
            np.ones(self.count),
            1.0,
            *ways(self.chosen, bars),
            residual,
            change,
        )
        return change


@dataclass(eq=False)
class _Steps:
    """The steps of a quasi-Newton method, each by what the last ones changed (Anderson 1965)."""

    places: list[Array] = field(default_factory=list)
    residuals: list[Array] = field(default_factory=list)

    def next(self, place: Array, residual: Array, solve: Callable[[Array], Array]) -> Array:
        """Steps ``[n, t]`` from ``place`` ``[n, t]``; ``solve`` gives those for residuals of which nothing is known."""
        self.places = [*self.places, place][-STEPS:]
        self.residuals = [*self.residuals, residual][-STEPS:]
        if len(self.places) == 1:
            return solve(residual)
        moved, changed = (np.diff(np.stack(each, axis=2), axis=2) for each in (self.places, self.residuals))
        changed = np.where(np.isfinite(changed), changed, 0.0)
        weights = np.linalg.pinv(changed, RANK) @ residual[..., np.newaxis]
        return solve(residual - (changed @ weights)[..., 0]) - (moved @ weights)[..., 0]
