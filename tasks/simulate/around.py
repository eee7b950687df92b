"""Effects of the machine around any simulator: compliance, slip, friction, lag, drift, and an error of the area.

Such effects change the displacement that reaches the specimen, or the force that is read, and nothing inside the
specimen. The simulator runs along the displacement that they leave, and they act on its force. Where that displacement
depends on the force, some runs bring both into balance by a quasi-Newton method (Anderson 1965; Fang and Saad 2009).
Its first guess is a specimen without memory, whose stiffness follows from the runs so far.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.evaluation.batch import RETRIED
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.acting import Acting, acting, displaced, gives_way, read, ways, with_constants
from sinew.tasks.model.effect import Bars, Effect, model_without
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, Simulator, rmse_of
from sinew.tasks.simulate.row_by_row import Failed, row_by_row

VERSION = 1  # of the forces that are computed here, with the equations of the effects
BALANCE, NEARER = 1e-5, 1e-6  # of the largest displacement: largest remaining difference of grips and specimen
RUNS = 60  # of the simulator for one curve, at most
STEPS, RANK = 8, 1e-8  # steps that are remembered, and how far from each other they must be
MOVED = 1e-9  # of the largest displacement: smaller motions tell no stiffness
NOT_SO_NEAR = ("diverged", "bad_input")  # where a start from another balance may be to blame
SHARED = 64  # of the last runs, of which rows that differ in their effects alone may need the same
CLEAR, TRUST = 0.01, 3.0  # of the largest step: smaller ones tell none; and the factor by which one may change it

Run = Callable[[bytes], Array]
"""Force (N) and other outputs ``[1 + k, t]`` along displacements ``[t]`` (mm). Raises :class:`Failed`."""


@dataclass(frozen=True, eq=False)
class Balance:
    """A displacement ``[1, t]`` (mm) that agrees with the force that it causes; the specimen's stiffness (N/mm)."""

    displacement_mm: Array
    stiffness: Array


@dataclass(frozen=True, eq=False)
class Near:
    """Balances of one specimen to start from, by the digest of the protocol; calls leave theirs for later calls.

    Of all that is asked of a simulator with this object, the first row of each protocol is left, ``written``, and the
    others start from it: they should be small steps away.
    """

    balances: dict[str, Balance]
    written: set[str] = field(default_factory=set)


@dataclass(frozen=True)
class Around:
    """The simulator ``inner`` with ``effects`` around it; their parameters are the last of its models, in any order.

    ``near``: balances to start from. Raises :class:`ValueError` for an effect that acts inside the specimen.
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
        inside = [model.names.index(name) for name in own.names]
        outside = [model.names.index(name) for effect in self.effects for name in effect.names]
        near, key = self.near, protocol.digest
        enough = BALANCE if near is None else NEARER  # small differences between rows must not drown
        accident: Failed | None = None

        @lru_cache(SHARED)
        def shared(values: bytes, displacement: bytes) -> Array:
            moved = replace(protocol, displacement_mm=np.frombuffer(displacement).copy(), paced_by=protocol.pace)
            return run(own, np.frombuffer(values).copy()[np.newaxis], moved)

        def solve(values: Array) -> Array:
            nonlocal accident
            if accident is not None:  # the others start from the first row, so that they wait for it
                raise accident
            chosen = acting(self.effects, values[np.newaxis, outside])
            along = _Along(chosen, specimen, protocol, partial(shared, values[inside].tobytes()), enough)
            if near is None:
                return along.courses(None)[0]
            try:
                courses, balance = along.courses(near.balances.get(key))
            except Failed as failed:
                accident = failed if failed.status in RETRIED and key not in near.written else None
                raise
            if balance is not None and key not in near.written:
                near.balances[key] = balance
            near.written.add(key)
            return courses

        found = np.full((len(parameters), count, protocol.time_s.size), np.nan)
        return found, *row_by_row(model, parameters, solve, found)


def _first(done: Simulated | Compared, *courses: Array) -> Array:
    """The courses ``[k, t]`` of the only row, of ``courses`` each ``[1, t]``. Raises :class:`Failed`."""
    if done.status[0]:
        raise Failed(STATUSES[int(done.status[0])], done.messages[0])
    return np.concatenate(courses)


@dataclass(frozen=True, eq=False)
class _Along:
    """One specimen with effects around it, along one protocol; ``enough``: as ``BALANCE``."""

    chosen: Acting
    specimen: Specimen
    protocol: Protocol
    run: Run
    enough: float

    def courses(self, near: Balance | None) -> tuple[Array, Balance | None]:
        """The force as it is read, and the other outputs, ``[1 + k, t]``; and the balance, which may start another.

        ``near``: a balance to start from. Raises :class:`Failed`.
        """
        with np.errstate(all="ignore"):  # what is no number fails
            try:
                bars, others, balance = self._balanced(near)
            except Failed as failed:
                if near is None or failed.status not in NOT_SO_NEAR:
                    raise
                bars, others, balance = self._balanced(None)
            force = read(self.chosen, bars).force_N
        if not np.isfinite(force).all():
            raise Failed("diverged", "with its effects, the force is not a number")
        return np.concatenate([force, others]), balance

    def _balanced(self, near: Balance | None) -> tuple[Bars, Array, Balance | None]:
        """The specimen at the displacement that agrees with the force that it causes, and the other outputs there."""
        area = {"area_mm2": np.ones((1, 1))}  # times that of the simulator
        grips = with_constants(self.chosen, Bars.at_grips(self.protocol, self.specimen.length_mm, area, 1))
        if not gives_way(self.chosen):
            return *self._pulled(displaced(self.chosen, grips)), None
        largest = max(float(np.abs(grips.grips_mm).max()), np.finfo(float).tiny)
        if near is None or any(effect.asks_rigid for effect, _ in self.chosen):
            bars, others = self._pulled(grips)
            grips = replace(grips, rigid_N=bars.force_N)
            stiffness = _slopes(bars.displacement_mm[0], bars.force_N[0], MOVED * largest)
        if near is not None:
            bars, others = self._pulled(replace(grips, displacement_mm=near.displacement_mm))
            stiffness = near.stiffness
        residual = self._residual(grips, bars)
        steps, part, runs = _Steps(), 1.0, 1
        while np.abs(residual).max() > self.enough * largest:
            if runs == RUNS:
                raise Failed("diverged", f"no balance of force and displacement in {RUNS} runs of the simulator")
            runs += 1
            solve = partial(self._change, grips, bars, stiffness)
            step = part * steps.next(bars.displacement_mm[0], residual, solve)
            try:
                moved, given = self._pulled(replace(bars, displacement_mm=bars.displacement_mm + step))
                left = self._residual(grips, moved)
            except Failed as failed:  # a step too far
                if failed.status in RETRIED:
                    raise
                nearer = False
            else:
                stiffness = _secants(stiffness, step, (moved.force_N - bars.force_N)[0])
                nearer = bool(np.linalg.norm(left) < np.linalg.norm(residual))
            if nearer:
                bars, others, residual, part = moved, given, left, min(1.0, 2.0 * part)
            else:  # perhaps behind a kink, such as a grip that begins to slip: what was learned before it misleads
                steps, part = _Steps(), 0.5 * part
        return bars, others, Balance(bars.displacement_mm, stiffness)

    def _pulled(self, bars: Bars) -> tuple[Bars, Array]:
        """The specimen with its force at its displacement, and the other outputs ``[k, t]``. Raises :class:`Failed`."""
        if not np.isfinite(bars.displacement_mm).all():
            raise Failed("diverged", "with its effects, the displacement is not a number")
        found = self.run(bars.displacement_mm[0].tobytes())
        return replace(bars, force_N=bars.material["area_mm2"] * found[:1]), found[1:]

    def _residual(self, grips: Bars, bars: Bars) -> Array:
        """What grips and effects leave to the specimen ``[t]`` (mm), less its displacement. Raises :class:`Failed`."""
        left = displaced(self.chosen, replace(grips, force_N=bars.force_N)).displacement_mm - bars.displacement_mm
        if not np.isfinite(left).all():
            raise Failed("diverged", "with its effects, the displacement is not a number")
        return np.asarray(left[0])

    def _change(self, grips: Bars, bars: Bars, stiffness: Array, residual: Array) -> Array:
        """The change ``[t]`` (mm) that takes a residual away from a specimen with this ``stiffness`` ``[t]`` (N/mm)."""
        from sinew.tasks.simulate import memory  # its kernels are slow to import, and most effects need none

        nothing, change = np.zeros((1, residual.size)), np.empty((1, residual.size))
        memory.correction(  # of a bar without branches: its force follows its displacement
            *self.protocol.distinct_steps,
            *(np.empty(0, np.int64), np.empty((1, 0)), np.empty((1, 0)), np.ones((1, 1)), 0),
            np.ones_like(nothing),
            nothing,
            np.stack([stiffness[np.newaxis], nothing, nothing]),
            np.ones(1),
            1.0,
            *ways(self.chosen, replace(grips, force_N=bars.force_N)),
            residual[np.newaxis],
            change,
        )
        return np.asarray(change[0])


class _Steps:
    """The steps of a quasi-Newton method, each by what the last ones changed."""

    def __init__(self) -> None:
        self.places: list[Array] = []
        self.residuals: list[Array] = []

    def next(self, place: Array, residual: Array, solve: Callable[[Array], Array]) -> Array:
        """The step ``[t]`` from a ``place`` ``[t]``; ``solve`` gives one for a residual of which nothing is known."""
        self.places = [*self.places, place][-STEPS:]
        self.residuals = [*self.residuals, residual][-STEPS:]
        if len(self.places) == 1:
            return solve(residual)
        moved, changed = (np.diff(np.array(each), axis=0).T for each in (self.places, self.residuals))
        weights = np.linalg.lstsq(changed, residual, rcond=RANK)[0]
        return np.asarray(solve(residual - changed @ weights) - moved @ weights)


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
