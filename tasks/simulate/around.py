"""Effects of the machine around any simulator: compliance, slip, friction, lag, drift, and an error of the area.

Such effects change the displacement that reaches the specimen, or the force that is read, and nothing inside the
specimen. The simulator runs along the displacement that they leave, and they act on its force. Where that displacement
depends on the force, some runs bring both into balance by a quasi-Newton method. It begins with a specimen whose force
at each point follows the displacement there, with the stiffness that the last two runs had.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.model.effect import Bars, Effect, GivingWay, Values, in_order, model_without
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, Simulator, impossible, rmse_of

VERSION = 1  # of the forces that are computed here
BALANCE = 1e-5  # of the largest displacement: largest remaining difference of grips, machine and specimen
RUNS = 60  # of the simulator for one curve, at most
MEMORY, RANK = 8, 1e-8  # runs whose steps are mixed, and how far from each other they must be
MOVED = 1e-9  # of the largest displacement: smaller motions tell no stiffness
CLEAR, TRUST = 0.01, 3.0  # of the largest step: smaller ones tell none; and the factor by which one may change it

Run = Callable[[Protocol], tuple[Array, Any]]
"""Force ``[t]`` (N) along a protocol, and all that the simulator gave. Raises :class:`_Failed`."""


class _Failed(Exception):
    """A row without a curve: its ``status``, a position in the store's list, and the reason."""

    def __init__(self, status: int, words: str) -> None:
        super().__init__(words)
        self.status = status


@dataclass(frozen=True)
class Around:
    """The simulator ``inner`` with ``effects`` around it; their parameters are the last of its models, in any order.

    Raises :class:`ValueError` for an effect that acts inside the specimen.
    """

    inner: Simulator
    effects: tuple[Effect, ...]

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
        own = model_without(model, self.effects)

        def run(values: Array, moved: Protocol) -> tuple[Array, Any]:
            return _whole(self.inner.simulate(own, specimen, moved, values[np.newaxis]))

        force, status, messages, _ = self._rows(model, specimen, protocol, parameters, run)
        return Simulated(force, status, messages)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        own, every = model_without(model, self.effects), np.arange(curve.protocol.time_s.size)

        def run(values: Array, moved: Protocol) -> tuple[Array, Any]:
            along = replace(curve, protocol=moved)
            return _whole(self.inner.compare(own, specimen, along, values[np.newaxis], every))

        force, status, messages, runs = self._rows(model, specimen, curve.protocol, parameters, run)
        outputs, summaries, rmse = {}, {}, {}
        for output in self.inner.capabilities.outputs:
            values = force
            if output.name != self.inner.capabilities.force:
                nothing = np.full(every.size, np.nan)
                values = np.array([nothing if one is None else one.outputs[output.name][0] for one in runs])
            outputs[output.name], summaries[output.name] = values[:, keep], output.summarised(values)
            if output.name in curve.others:
                rmse[output.name] = rmse_of(values, curve.others[output.name])
        return Compared(rmse_of(force, curve.force_N), force[:, keep], status, messages, outputs, summaries, rmse)

    def _rows(
        self,
        model: Model,
        specimen: Specimen,
        protocol: Protocol,
        parameters: Array,
        run: Callable[[Array, Protocol], tuple[Array, Any]],
    ) -> tuple[Array, Array, tuple[str, ...], list[Any]]:
        """Forces ``[n, t]``, status ``[n]``, messages, and what the simulator gave in the end, None for failed rows."""
        own = [model.names.index(name) for name in model_without(model, self.effects).names]
        column = {name: model.names.index(name) for effect in self.effects for name in effect.names}
        force = np.full((len(parameters), protocol.time_s.size), np.nan)
        status, messages = np.zeros(len(parameters), dtype=np.int8), [""] * len(parameters)
        last: list[Any] = [None] * len(parameters)
        wrong = impossible(model, parameters)
        for row, values in enumerate(parameters):
            chosen = tuple((one, {n: values[[[column[n]]]] for n in one.names}) for one in in_order(self.effects))
            try:
                if row in wrong:
                    raise _Failed(STATUSES.index("bad_input"), wrong[row])
                along = _Along(chosen, specimen, protocol, partial(run, values[own]))
                force[row], last[row] = along.read()
            except _Failed as failed:
                status[row], messages[row] = failed.status, str(failed)
        return force, status, tuple(messages), last


def _whole(done: Any) -> tuple[Array, Any]:
    """The force of one row and all that was given with it. Raises :class:`_Failed`."""
    if done.status[0]:
        raise _Failed(int(done.status[0]), done.messages[0])
    return done.force_N[0], done


@dataclass(frozen=True, eq=False)
class _Along:
    """One specimen with the effects' values along one protocol."""

    chosen: tuple[tuple[Effect, Values], ...]
    specimen: Specimen
    protocol: Protocol
    run: Run

    def read(self) -> tuple[Array, Any]:
        """The force ``[t]`` as it is read, and what the simulator gave. Raises :class:`_Failed`."""
        with np.errstate(all="ignore"):  # what is no number fails
            bars, done = self._balanced()
            for effect, own in self.chosen:
                if effect.reading:
                    bars = replace(bars, force_N=effect.reading(bars, own))
        if not np.isfinite(bars.force_N).all():
            raise _Failed(STATUSES.index("diverged"), "with its effects, the force is no number")
        return bars.force_N[0], done

    def _balanced(self) -> tuple[Bars, Any]:
        """The specimen at the displacement that agrees with the force that it causes."""
        grips = self._at_grips()
        gives_way = any(effect.giving_way for effect, _ in self.chosen)
        bars, done = self._pulled(grips if gives_way else self._left(grips))
        if not gives_way:
            return bars, done
        grips = replace(grips, rigid_N=bars.force_N)
        largest = max(float(np.abs(grips.grips_mm).max()), np.finfo(float).tiny)
        stiffness = _slopes(bars.displacement_mm[0], bars.force_N[0], MOVED * largest)
        steps, part = _Steps(), 1.0
        best, failed = (np.inf, bars, np.empty(0)), False
        for _ in range(RUNS - 1):
            residual = self._residual(grips, bars)
            if np.abs(residual).max() <= BALANCE * largest:
                return bars, done
            if not failed and (size := float(np.linalg.norm(residual))) < best[0]:
                best, part = (size, bars, residual), min(1.0, 2.0 * part)
            else:  # no run, or behind a kink, such as a grip that begins to slip: what was learned before it misleads
                steps, part = _Steps(), 0.5 * part
                _, bars, residual = best
            failed = False
            solve = partial(self._change, grips, bars, stiffness)
            step = part * steps.next(bars.displacement_mm[0], residual, solve)
            try:
                moved, done = self._pulled(replace(bars, displacement_mm=bars.displacement_mm + step))
            except _Failed:  # a step too far; the next one is half as long
                failed = True
                continue
            stiffness = _secants(stiffness, step, (moved.force_N - bars.force_N)[0])
            bars = moved
        words = f"no balance of force and displacement in {RUNS} runs of the simulator"
        raise _Failed(STATUSES.index("diverged"), words)

    def _at_grips(self) -> Bars:
        displacement = np.asarray(self.protocol.displacement_mm, dtype=np.float64)[np.newaxis]
        nothing = np.zeros_like(displacement)
        return Bars(
            np.asarray(self.protocol.time_s, dtype=np.float64),
            self.specimen.length_mm,
            {"area_mm2": np.ones((1, 1))},  # times that of the simulator
            displacement,
            displacement,
            stretch=nothing,
            fibre_stretch=nothing,
            matrix_MPa=nothing,
            fibre_MPa=nothing,
            force_N=nothing,
            rigid_N=nothing,
        )

    def _pulled(self, bars: Bars) -> tuple[Bars, Any]:
        """The specimen with its force at its displacement, and what the simulator gave."""
        if not np.isfinite(bars.displacement_mm).all():
            raise _Failed(STATUSES.index("diverged"), "with its effects, the displacement is no number")
        moved = replace(self.protocol, displacement_mm=bars.displacement_mm[0], paced_by=self.protocol.pace)
        force, done = self.run(moved)
        factor = bars.material["area_mm2"]
        for effect, own in self.chosen:
            if effect.material:
                factor = factor * effect.material(bars, own)["area_mm2"]
        return replace(bars, force_N=factor * force[np.newaxis]), done

    def _left(self, bars: Bars) -> Bars:
        """The displacement of the specimen under its force."""
        for effect, own in self.chosen:
            if effect.displacement:
                bars = replace(bars, displacement_mm=effect.displacement(bars, own))
        return bars

    def _residual(self, grips: Bars, bars: Bars) -> Array:
        """What grips and effects leave to the specimen ``[t]`` (mm), less its displacement."""
        left = (self._left(replace(grips, force_N=bars.force_N)).displacement_mm - bars.displacement_mm)[0]
        if not np.isfinite(left).all():
            raise _Failed(STATUSES.index("diverged"), "with its effects, the displacement is no number")
        return np.asarray(left)

    def _change(self, grips: Bars, bars: Bars, stiffness: Array, residual: Array) -> Array:
        """The change of the displacement ``[t]`` (mm) of a specimen with this ``stiffness`` ``[t]`` (N/mm)."""
        state = replace(grips, force_N=bars.force_N)
        ways = [way for effect, own in self.chosen if effect.giving_way for way in effect.giving_way(state, own)]
        return _changed(ways, stiffness, residual)


class _Steps:
    """Steps of a quasi-Newton method, from what the last ones changed (Anderson 1965; Fang and Saad 2009)."""

    def __init__(self) -> None:
        self.places: list[Array] = []
        self.residuals: list[Array] = []

    def next(self, place: Array, residual: Array, solve: Callable[[Array], Array]) -> Array:
        """The step ``[t]`` from a ``place`` ``[t]``; ``solve`` gives one for a residual of which nothing is known."""
        self.places = [*self.places, place][-MEMORY:]
        self.residuals = [*self.residuals, residual][-MEMORY:]
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


def _changed(ways: list[GivingWay], stiffness: Array, residual: Array) -> Array:
    """The change ``[t]`` (mm) that takes a ``residual`` ``[t]`` away, point by point: ways remember what is lost."""
    compliance = np.array([way.compliance[0] for way in ways])
    kept = np.array([way.kept[0] for way in ways])
    lost = np.zeros(len(ways))
    change = np.empty_like(residual)
    for t in range(residual.size):
        before = kept[:, t] * lost
        change[t] = (residual[t] - before.sum()) / (1.0 + stiffness[t] * compliance[:, t].sum())
        lost = before + compliance[:, t] * stiffness[t] * change[t]
    return change


def _slopes(displacement: Array, force: Array, least: float) -> Array:
    """A first guess of the stiffness ``[t]`` (N/mm): of the last motion, or the next one before the first."""
    steps = np.diff(displacement)
    moving = np.flatnonzero(np.abs(steps) > least)
    if not moving.size:
        return np.zeros_like(force)
    slopes = np.abs(np.diff(force)[moving] / steps[moving])
    at = np.clip(np.searchsorted(moving, np.arange(force.size) - 1, side="right") - 1, 0, None)
    return np.asarray(slopes[at])
