"""Effects of the machine around any simulator: compliance, slip, friction, lag, drift, and an error of the area.

Such effects change the displacement that reaches the specimen, or the force that is read, and nothing inside the
specimen. The simulator runs along the displacement that they leave, and they act on its force. Where that displacement
depends on the force, some runs bring both into balance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.batch import RETRIED
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import FORCE, Curve, Model, Protocol, Specimen
from sinew.tasks.model.acting import Acting, acting
from sinew.tasks.model.effect import Effect, model_without
from sinew.tasks.simulate import Array, Capabilities, Compared, Courses, Simulated, Simulator, rmse_of
from sinew.tasks.simulate.balance import Ask, balance
from sinew.tasks.simulate.machines import Machines
from sinew.tasks.simulate.near import Near
from sinew.tasks.simulate.row_by_row import Failed, row_by_row

VERSION = 2  # of the forces that are computed here, with the equations of the effects
SHARED = 64  # of the last runs, of which rows that differ in their effects alone may need the same


@dataclass(frozen=True)
class Around:
    """The simulator ``inner`` with ``effects`` around it; their parameters are the last of its models, in any order.

    ``near``: what earlier calls have left to start from. Raises :class:`ValueError` for an effect that acts inside the
    specimen.
    """

    inner: Simulator
    effects: tuple[Effect, ...]
    near: Near | None = None

    def __post_init__(self) -> None:
        if inside := [effect.name for effect in self.effects if not effect.around]:
            raise ValueError(f"{inside[0]} acts inside the specimen")

    @property
    def name(self) -> str:
        return self.inner.name

    @property
    def capabilities(self) -> Capabilities:
        return replace(self.inner.capabilities, batch_multiple=1, stresses=False, effects="none")

    def identity(self) -> dict[str, Any]:
        return self.inner.identity() | {"around": {"version": VERSION, "effects": [one.name for one in self.effects]}}

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        """The force as it is read. Raises :class:`BadInput` when ``stresses`` are asked for."""
        if stresses:
            raise BadInput("simulator", "with effects there are no stresses of the constituents", "a model without")

        others = self._others

        def run(own: Model, values: Array, moved: Protocol) -> Array:
            done = self.inner.simulate(own, specimen, moved, values)
            return _first(done, done.force_N, *(done.outputs[name] for name in others))

        found, status, messages = self._rows(model, specimen, protocol, parameters, run, 1 + len(others))
        return Simulated(
            found[:, 0], status, messages, outputs=dict(zip(others, found[:, 1:].swapaxes(0, 1), strict=True))
        )

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        outputs, every = self.inner.capabilities.outputs, np.arange(curve.protocol.time_s.size)
        others = self._others

        def run(own: Model, values: Array, moved: Protocol) -> Array:
            done = self.inner.compare(own, specimen, replace(curve, protocol=moved), values, every)
            return _first(done, done.force_N, *(done.outputs[name] for name in others))

        found, status, messages = self._rows(model, specimen, curve.protocol, parameters, run, 1 + len(others))
        force = found[:, 0]
        values = {output.name: found[:, 1 + others.index(output.name)] if output.name in others else force
                  for output in outputs}  # fmt: skip
        return Compared(
            rmse_of(force, curve.force_N),
            force[:, keep],
            status,
            messages,
            {name: each[:, keep] for name, each in values.items()},
            {output.name: output.summarised(values[output.name]) for output in outputs},
            {name: rmse_of(values[name], measured) for name, measured in curve.others.items() if name in values},
        )

    @property
    def _others(self) -> list[str]:
        """The outputs besides the force."""
        can = self.inner.capabilities
        return [output.name for output in can.outputs if output.name != can.force]

    def _rows(
        self,
        model: Model,
        specimen: Specimen,
        protocol: Protocol,
        parameters: Array,
        run: Callable[[Model, Array, Protocol], Array],
        count: int,
    ) -> tuple[Array, Array, tuple[str, ...]]:
        """Courses of each row ``[n, count, t]``, first the force as it is read; status ``[n]``, and messages."""
        own = model_without(model, self.effects)
        near, key = self.near, protocol.digest
        accident: Failed | None = None

        @lru_cache(SHARED)
        def shared(values: bytes, displacement: bytes) -> Array:
            moved = replace(protocol, displacement_mm=np.frombuffer(displacement).copy(), paced_by=protocol.pace)
            return run(own, np.frombuffer(values).copy()[np.newaxis], moved)

        def along(values: Array) -> Ask:
            return lambda displacement: shared(values.tobytes(), displacement.tobytes())

        def solve(values: Array) -> Array:
            nonlocal accident
            if accident is not None:  # a row learns from those before it, so that it waits for them
                raise accident
            inside, at, chosen = self._parts(model, values[np.newaxis])
            machine = Machines(chosen, specimen.length_mm, protocol)
            if near is None:
                return balance(machine, along(inside[0])).courses
            try:
                return near.row(key, machine, at[0], inside[0], along)
            except Failed as failed:
                accident = failed if failed.status in RETRIED else None
                raise

        found = np.full((len(parameters), count, protocol.time_s.size), np.nan)
        with np.errstate(all="ignore"):  # what is no number fails
            return found, *row_by_row(model, parameters, solve, found)

    def nearly(self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array) -> Courses | None:
        """All outputs ``[n, t]`` without a run, of a specimen that is linear near the last one that was run.

        None where it is not known how its outputs change with its parameters; NaN where they are no numbers.
        """
        known = self.near.known.get(protocol.digest) if self.near else None
        if known is None or not known.followed:
            return None
        _, at, chosen = self._parts(model, parameters)
        machines = Machines(chosen, specimen.length_mm, protocol, len(parameters))
        with np.errstate(all="ignore"):
            found = known.pulled(machines, at)
        return {FORCE: found[:, 0], **dict(zip(self._others, found[:, 1:].swapaxes(0, 1), strict=True))}

    def _parts(self, model: Model, parameters: Array) -> tuple[Array, Array, Acting]:
        """Of rows ``[n, d]``: what is the simulator's own, the same on the unit cube, and the effects with the rest."""
        own = model_without(model, self.effects)
        inside = [model.names.index(name) for name in own.names]
        outside = [model.names.index(name) for effect in self.effects for name in effect.names]
        low, high = (np.array([getattr(one, end) for one in own.parameters]) for end in ("minimum", "maximum"))
        mine = parameters[:, inside]
        at = (mine - low) / np.where(high > low, high - low, 1.0)
        return mine, at, acting(self.effects, parameters[:, outside])


def _first(done: Simulated | Compared, *courses: Array) -> Array:
    """The courses ``[k, t]`` of the only row, of ``courses`` each ``[1, t]``. Raises :class:`Failed`."""
    if done.status[0]:
        raise Failed(STATUSES[int(done.status[0])], done.messages[0])
    return np.concatenate(courses)
