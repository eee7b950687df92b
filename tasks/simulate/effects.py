"""The embedded simulator with effects: the same bar as :mod:`sinew.tasks.simulate.uniaxial`, with any effects in it.

The stages, in this order (:mod:`sinew.tasks.model.effect` says what an effect can change in each):
displacement -> stretch -> elastic stress -> memory -> force -> reading. Where the displacement of the gauge length
depends on the force, both are found together by Newton's method on the whole curve; where it fails,
:mod:`sinew.tasks.simulate.in_time` finds them from the first point to the last.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen, fibre
from sinew.tasks.model.acting import Acting, acting, displaced, gives_way, read, ways, with_constants
from sinew.tasks.model.effect import Bars, Branch, Effect, Law, Values, model_without
from sinew.tasks.model.effects import effect_named
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, impossible, memory, rmse_of
from sinew.tasks.simulate.in_time import balanced_in_time
from sinew.tasks.simulate.lateral import OUTPUTS, laterals, widths
from sinew.tasks.simulate.uniaxial import without_width

VERSION = 6  # of the forces that are computed here
_DRIVERS = ("matrix", "fibre", "strain")
BALANCE = 1e-10  # of the largest displacement: largest remaining difference of grips, machine and gauge length
NEAR_BALANCE = 1e-6  # the same, where another step of Newton's method follows, which squares it
NEAR_ENOUGH, NEAR_STEPS = 1e-3, 3  # of the difference, that is left to rows beside one in balance; steps, at most
ITERATIONS = 60
HALVINGS = 8  # of a step, at most
_STRETCH_STEP = 1e-7  # of the differences that give tangents: their errors slow Newton's method only


@dataclass(frozen=True)
class UniaxialWith:
    """The embedded simulator for studies whose model has effects, by their ``names``.

    Its models are those of :func:`sinew.tasks.model.effect.model_with`: the effects' parameters stand behind the
    baseline's. ``compared``: the outputs that it gives besides the force.
    """

    names: tuple[str, ...]
    name: str = "uniaxial"
    compared: tuple[str, ...] = ()

    @property
    def capabilities(self) -> Capabilities:
        return Capabilities(8, effects="embedded", outputs=tuple(OUTPUTS[name] for name in self.compared))

    def identity(self) -> dict[str, Any]:
        known = {"name": self.name, "version": VERSION, "effects": list(self.names)}
        return known | ({"outputs": list(self.compared)} if self.compared else {})

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        if stresses:
            raise ValueError("with effects there are no stresses of the constituents")
        done, strain = self._pulled(model, specimen, protocol, parameters)
        return replace(done, outputs=widths(self.compared, model, specimen, parameters, strain, done.force_N))

    def _pulled(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array
    ) -> tuple[Simulated, Array]:
        """The forces, and the Green-Lagrange strain of the gauge length ``[n, t]``."""
        effects = tuple(effect_named(name) for name in self.names)
        bare = model_without(model, effects)
        own = len(bare.parameters)
        bars = bars_with(bare, effects, specimen, protocol, parameters[:, :own], parameters[:, own:])
        force = bars.force_N
        status, wrong = np.zeros(len(force), dtype=np.int8), impossible(model, parameters)
        reasons = dict.fromkeys(np.flatnonzero(~np.isfinite(force).all(axis=1)).tolist(), "no force was found")
        status[list(reasons)] = STATUSES.index("diverged")
        status[list(wrong)] = STATUSES.index("bad_input")
        reasons |= wrong
        force[status > 0] = np.nan
        return Simulated(force, status, tuple(reasons.get(row, "") for row in range(len(force)))), bars.strain

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        done, strain = self._pulled(model, specimen, curve.protocol, parameters)
        compared = Compared(rmse_of(done.force_N, curve.force_N), done.force_N[:, keep], done.status, done.messages)
        if not self.compared:
            return compared
        values, summaries, errors = laterals(
            self.compared, model, specimen, dict(curve.others), parameters, strain, keep
        )
        return without_width(replace(compared, outputs=values, summaries=summaries, rmse=errors))


def simulate_with(
    model: Model,
    effects: tuple[Effect, ...],
    specimen: Specimen,
    protocol: Protocol,
    parameters: Array,
    values: Array,
    *,
    sudden: bool = False,
    nearby: bool = False,
) -> Array:
    """Force ``[n, t]`` (N) along ``protocol`` for ``parameters`` ``[n, d]`` and the effects' ``values`` ``[n, k]``.

    The columns of ``values`` are the parameters of ``effects``, in the order given; that order changes nothing else.
    With no effect, or all at their null values, the forces are those of :mod:`sinew.tasks.simulate.uniaxial`. The first
    point is at rest; with ``sudden`` it is free of stress, and prestretch comes with the first step, as when the solver
    starts at zero displacement. Rows with impossible parameters, or for which no balance of force and displacement
    is found, are NaN.

    With ``nearby``, for derivatives, all rows are small steps away from the first. Newton's method then finds the
    balance of the first, and mostly one step from there, with its tangents, finds those of the others: its error is the
    square of these steps.
    """
    return bars_with(model, effects, specimen, protocol, parameters, values, sudden=sudden, nearby=nearby).force_N


def bars_with(
    model: Model,
    effects: tuple[Effect, ...],
    specimen: Specimen,
    protocol: Protocol,
    parameters: Array,
    values: Array,
    *,
    sudden: bool = False,
    nearby: bool = False,
) -> Bars:
    """The bars with the forces of :func:`simulate_with`, and the stretch of their gauge length."""
    chosen = acting(effects, values)
    with np.errstate(all="ignore"):  # rows with impossible parameters end as NaN
        run = _Run(chosen, protocol, sudden or any(effect.unrelaxed for effect, _ in chosen))
        bars = _bars(model, specimen, protocol, parameters, chosen)
        if not gives_way(chosen):
            bars = run.pulled(displaced(chosen, bars))
        else:
            bars = run.balanced_nearby(bars) if nearby else run.balanced(bars)
        bars = read(chosen, bars)
    bars.force_N[~np.isfinite(bars.force_N).all(axis=1)] = np.nan
    return bars


def _bars(model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, chosen: Acting) -> Bars:
    """The bars at the displacement of the grips, with the material constants that the effects give them."""
    count = len(parameters)
    constants = {"beta": model.beta, "lambda_0": model.lambda_0, "area_mm2": specimen.area_mm2}
    material = {name: parameters[:, [column]] for column, name in enumerate(model.names)}
    material |= {name: np.full((count, 1), value) for name, value in constants.items()}
    return with_constants(chosen, Bars.at_grips(protocol, specimen.length_mm, material, count))


class _Memory(NamedTuple):
    """The viscous branches as the compiled recursions take them."""

    driver: Array
    viscosity: Array
    time_s: Array
    slowing: Array
    slowed: int


@dataclass(frozen=True, eq=False)
class _Run:
    """What stays constant while force and displacement are brought into balance."""

    chosen: Acting
    protocol: Protocol
    sudden: bool

    def pulled(self, bars: Bars) -> Bars:
        """The bars with their force at the displacement of their gauge length."""
        bars = self._elastic(bars)
        total = self._stress(bars, self._memory(bars))
        return replace(bars, force_N=bars.material["area_mm2"] * bars.stretch * total)

    def balanced(self, bars: Bars, precision: float = BALANCE) -> Bars:
        """The bars with the displacement of the gauge length that agrees with the force that it causes."""
        largest = max(float(np.abs(bars.displacement_mm).max()), np.finfo(float).tiny)
        limit, finest = precision * largest, BALANCE * largest
        bars, grips = self.pulled(bars), bars
        grips = replace(grips, rigid_N=bars.force_N)
        residual = self.left(grips, bars.force_N) - bars.displacement_mm
        can = ~np.isnan(residual).any(axis=1)
        for _ in range(ITERATIONS):
            worst = np.abs(residual).max(axis=1)
            left = worst > limit  # rows that are NaN stay so
            if not left.any():
                break
            # a balanced row is not changed, so it does not depend on its neighbours
            step = self.correction(grips, bars, np.where(left[:, np.newaxis], residual, 0.0))
            bars, residual = self._moved(grips, bars, step, np.where(left, worst, np.inf))
        # a row that was no number at first is one of impossible parameters
        for row in np.flatnonzero(can & ~(np.abs(residual).max(axis=1) <= limit)).tolist():
            alone = replace(self, chosen=tuple((effect, _row(own, row)) for effect, own in self.chosen))
            bars = bars.with_row(row, balanced_in_time(alone, grips.row(row), bars.row(row), finest))
        return bars

    def balanced_nearby(self, bars: Bars) -> Bars:
        """The bars as :meth:`balanced` leaves them, if they are small steps away from the first of them."""
        alone = replace(self, chosen=tuple((effect, _row(own, 0)) for effect, own in self.chosen))
        first = bars.row(0)
        begun = alone.balanced(first, NEAR_BALANCE)
        count = len(bars.displacement_mm)
        rigid = self.pulled(bars).force_N if any(effect.asks_rigid for effect, _ in self.chosen) else bars.rigid_N
        grips, grip = replace(bars, rigid_N=rigid), replace(first, rigid_N=rigid[:1])
        bars = self.pulled(replace(bars, displacement_mm=np.repeat(begun.displacement_mm, count, axis=0)))
        residual = self.left(grips, bars.force_N) - bars.displacement_mm
        enough = NEAR_ENOUGH * np.abs(residual).max(axis=1)
        for _ in range(NEAR_STEPS):
            step = alone.correction(grip, begun, residual)
            bars = self.pulled(replace(bars, displacement_mm=bars.displacement_mm + step))
            residual = self.left(grips, bars.force_N) - bars.displacement_mm
            if not (np.abs(residual).max(axis=1) > enough).any():
                break
        return bars

    def _moved(self, grips: Bars, bars: Bars, step: Array, worst: Array) -> tuple[Bars, Array]:
        """The bars after a step ``[n, t]`` (mm), or a part of it where all of it leaves more than ``worst`` ``[n]``.

        Without halving, compliances that fall with the force would make the iteration oscillate.
        """
        part = np.ones_like(worst)
        for _ in range(HALVINGS):
            moved = self.pulled(replace(bars, displacement_mm=bars.displacement_mm + part[:, np.newaxis] * step))
            residual = self.left(grips, moved.force_N) - moved.displacement_mm
            farther = ~(np.abs(residual).max(axis=1) < worst) & np.isfinite(worst)
            if not farther.any():
                break
            part[farther] *= 0.5
        return moved, residual

    def left(self, grips: Bars, force: Array) -> Array:
        """Displacement ``[n, t]`` (mm) of the gauge length under ``force`` ``[n, t]`` (N)."""
        return displaced(self.chosen, replace(grips, force_N=force)).displacement_mm

    def _elastic(self, bars: Bars) -> Bars:
        stretch = 1.0 + bars.displacement_mm / bars.length_mm
        bars = replace(bars, stretch=stretch, fibre_stretch=stretch)
        for effect, own in self.chosen:
            if effect.fibre_stretch:
                bars = replace(bars, fibre_stretch=effect.fibre_stretch(bars, own))
        law: Law = partial(fibre.stress, material=bars.material)
        for effect, own in self.chosen:
            if effect.fibre_law:
                law = effect.fibre_law(law, own)
        bars = replace(bars, matrix_MPa=bars.material["E_m"] * bars.strain, fibre_MPa=law(bars.fibre_stretch))
        for effect, own in self.chosen:
            if effect.matrix_stress:
                bars = replace(bars, matrix_MPa=effect.matrix_stress(bars, own))
            if effect.fibre_stress:
                bars = replace(bars, fibre_MPa=effect.fibre_stress(bars, own))
        return bars

    def _memory(self, bars: Bars) -> _Memory:
        """The baseline's six branches, whose times can be slowed, then those of the effects."""
        p = bars.material
        branches = [
            Branch("matrix" if c == "m" else "fibre", p[f"g_{i}{c}"] * p[f"tau_{i}{c}"], p[f"tau_{i}{c}"])
            for c in "mf"
            for i in (1, 2, 3)
        ]
        slowing = None
        for effect, own in self.chosen:
            if effect.slowing:
                factor = effect.slowing(bars, own)
                slowing = factor if slowing is None else slowing * factor
            if effect.branches:
                branches += effect.branches(bars, own)
        return _Memory(
            np.array([_DRIVERS.index(branch.driver) for branch in branches]),
            np.concatenate([branch.viscosity for branch in branches], axis=1),
            np.concatenate([branch.time_s for branch in branches], axis=1),
            np.ones((1, 1)) if slowing is None else slowing,
            0 if slowing is None else 6,
        )

    def _stress(self, bars: Bars, branches: _Memory) -> Array:
        total = np.empty_like(bars.stretch)
        memory.stress(
            *self.protocol.distinct_steps,
            *branches,
            bars.matrix_MPa,
            bars.fibre_MPa,
            bars.strain,
            self.sudden,
            total,
        )
        return total

    def correction(self, grips: Bars, bars: Bars, residual: Array) -> Array:
        """The change of the displacement ``[n, t]`` (mm) in one step of Newton's method.

        The bars are as many as the rows of ``residual``, or one for all of them.
        """
        nudged = self._elastic(replace(bars, displacement_mm=bars.displacement_mm + _STRETCH_STEP * bars.length_mm))
        tangents = (_drivers(nudged) - _drivers(bars)) / _STRETCH_STEP
        branches = self._memory(bars)
        area = np.ascontiguousarray(bars.material["area_mm2"][:, 0])
        result = np.empty_like(residual)
        memory.correction(
            *self.protocol.distinct_steps,
            *branches,
            bars.stretch,
            bars.force_N / (area[:, np.newaxis] * bars.stretch),
            tangents,
            area,
            bars.length_mm,
            *ways(self.chosen, replace(grips, force_N=bars.force_N)),
            residual,
            result,
        )
        return result


def _row(values: Values, row: int) -> Values:
    return {name: value[row : row + 1] for name, value in values.items()}


def _drivers(bars: Bars) -> Array:
    return np.stack([bars.matrix_MPa, bars.fibre_MPa, bars.strain])
