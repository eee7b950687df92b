"""A candidate of a discovery: the model with some effects, what a fit of it varies, and what it predicts."""

from dataclasses import dataclass, replace

import numpy as np

from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import FORCE, Model, Parameter, Protocol, Specimen
from sinew.tasks.model.effect import Effect, model_with
from sinew.tasks.simulate import Array, Courses, Simulated, Simulator, TakesEffects
from sinew.tasks.simulate.around import Around
from sinew.tasks.simulate.effects import bars_with
from sinew.tasks.simulate.lateral import widths
from sinew.tasks.simulate.near import Known, Near
from sinew.tasks.simulate.retrying import simulate_patiently

BLIND = "nu_m"  # of the tissue: the force does not depend on it
SEEN, SEEN_BY_SOLVER = 1e-8, 1e-3  # what is smaller, of the largest singular value of derivatives, is rounding


@dataclass(frozen=True, eq=False)
class Candidate:
    """The model with some effects: what a fit can vary is the model's free parameters and those of the effects.

    Forces are those of the embedded simulator or, where there is one, of the ``solver``, without which there are none
    of a user's own model. Its runs that fail by accident are repeated up to ``retries`` times. ``near``: what runs of
    nearly the same parameters leave for each other. ``compared``: outputs that are compared beside the force.
    """

    model: Model
    effects: tuple[Effect, ...] = ()
    solver: TakesEffects | None = None
    retries: int = 0
    near: dict[str, Known] | None = None
    compared: tuple[str, ...] = ()

    @property
    def stand_in(self) -> "Candidate":
        """The same with the embedded simulator, which is nearly the solver; of a user's own model, the same."""
        return self if self.solver is None or self.model.law != "tendon" else replace(self, solver=None)

    def remembering(self) -> "Candidate":
        """The same for one fit, whose runs remember what is near if its derivatives are those of its solver."""
        return self if self.stand_in.solver is None else replace(self, near={})

    def having(self, *effects: Effect) -> "Candidate":
        """The same with these effects instead."""
        return replace(self, effects=effects)

    def possible(self, effects: tuple[Effect, ...]) -> bool:
        """Whether its simulator can have these effects, all at once."""
        return self.solver is None or self.solver.can_have(effects)

    @property
    def varied(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.free)

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The free parameters on which what is compared depends."""
        return self.model.free if self.compared else seen_by_force(self.model)

    @property
    def size(self) -> int:
        return len(self.varied) + sum(len(effect.parameters) for effect in self.effects)

    @property
    def seen(self) -> float:
        """Of the largest singular value of derivatives: directions with smaller ones change no force."""
        return SEEN if self.stand_in.solver is None else SEEN_BY_SOLVER

    @property
    def fitted_width(self) -> int:
        """How many numbers :meth:`Fitted.numbers` of its fits has."""
        return 2 + 3 * self.size

    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds ``[k]``: the model's, then the effects'."""
        every = [*self.free, *(p for effect in self.effects for p in effect.parameters)]
        low = [p.minimum if p.possible(p.minimum) else p.minimum + 1e-6 * (p.maximum - p.minimum) for p in every]
        return np.array(low), np.array([p.maximum for p in every])

    def rows(self, at: Array) -> tuple[Array, Array]:
        """Parameters ``[n, d]`` and effects' values ``[n, m]`` of points ``[n, k]`` of the unit cube."""
        low, high = self.bounds()
        values = np.clip(low + (high - low) * at, low, high)
        count = len(self.varied)
        return self.model.full(self.varied, values[:, :count]), values[:, count:]

    def forces(self, specimen: Specimen, protocol: Protocol, at: Array, *, nearby: bool = False) -> Array:
        """Forces ``[n, t]`` (N) along a protocol at points ``[n, k]`` of the unit cube; NaN where they fail.

        ``nearby``: the points are small steps away from the first.
        """
        return self.courses(specimen, protocol, at, nearby=nearby)[FORCE]

    def courses(self, specimen: Specimen, protocol: Protocol, at: Array, *, nearby: bool = False) -> Courses:
        """As :meth:`forces`, of all that is compared."""
        if self.solver is not None:
            return self.simulated(specimen, protocol, at, nearby=nearby).courses(self.compared)
        parameters, values = self.rows(at)
        bars = bars_with(self.model, self.effects, specimen, protocol, parameters, values, nearby=nearby)
        return {
            FORCE: bars.force_N,
            **widths(self.compared, self.model, specimen, parameters, bars.strain, bars.force_N),
        }

    def simulated(self, specimen: Specimen, protocol: Protocol, at: Array, *, nearby: bool = False) -> Simulated:
        """As :meth:`forces`, of the solver, with the status of each row."""
        solver = self.solver
        assert solver is not None
        near: dict[str, Known] | None = {} if nearby and self.near is None else self.near
        having = self._having(near)
        return simulate_patiently(having, *self._asked(specimen, protocol, at), retries=self.retries)

    def _asked(self, specimen: Specimen, protocol: Protocol, at: Array) -> tuple[Model, Specimen, Protocol, Array]:
        """What a simulator is asked for at points ``[n, k]`` of the unit cube."""
        rows = np.concatenate(self.rows(at), axis=1)
        return model_with(self.model, self.effects), specimen, protocol, rows

    def _having(self, near: dict[str, Known] | None) -> Simulator:
        """The solver with the effects, which starts from what is known ``near``."""
        assert self.solver is not None
        return self.solver.with_effects(self.effects, None if near is None else Near(near))

    @property
    def surrounded(self) -> bool:
        """Whether effects act around its solver."""
        return self.solver is not None and isinstance(self._having({}), Around)

    def nearly(self, specimen: Specimen, protocol: Protocol, at: Array) -> Courses | None:
        """As :meth:`courses`, without a run, as far as runs with nearly the same parameters tell; else None."""
        having = None if self.solver is None or self.near is None else self._having(self.near)
        if not isinstance(having, Around):
            return None
        return having.nearly(*self._asked(specimen, protocol, at))

    def failures(self, measured: Measured, at: Array) -> dict[str, str]:
        """By curve, what the solver says where it fails at a point ``[k]`` of the unit cube."""
        if self.solver is None:
            return {}
        said = {
            curve.name: self.simulated(measured.specimen, curve.protocol, at[np.newaxis]).messages[0]
            for curve in measured.curves
        }
        return {name: words for name, words in said.items() if words}

    def unit(self, name: str, value: float) -> float:
        """Where on the unit cube a parameter of an effect has a value."""
        low, high = self.bounds()
        index = len(self.varied) + [p.name for effect in self.effects for p in effect.parameters].index(name)
        return float(np.clip((value - low[index]) / (high[index] - low[index]), 0.0, 1.0))

    def null(self) -> Array:
        """The effects' values ``[m]`` on the unit cube at which they do nothing."""
        return np.array([self.unit(n, v) for e in self.effects for n, v in zip(e.names, e.null_values, strict=True)])

    def typical(self) -> Array:
        """The effects' typical values ``[m]`` on the unit cube."""
        return np.array([self.unit(n, v) for e in self.effects for n, v in zip(e.names, e.typical, strict=True)])


def seen_by_force(model: Model) -> tuple[Parameter, ...]:
    """The free parameters on which the force depends."""
    return tuple(p for p in model.free if model.law != "tendon" or p.name != BLIND)
