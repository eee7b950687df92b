"""The embedded simulator: the tendon bar without finite elements, exact for one element in uniaxial stretch.

A solid mixture of two viscoelastic solids, matrix and fibre, with S the second Piola-Kirchhoff stress along the bar:

- matrix, "isotropic elastic": S = E_m (I - 1) / 2 with I = stretch^2. The lateral strain follows -nu_m E_zz, so nu_m
  never reaches the force.
- fibre, "fiber-exp-pow-linear" (Maas et al., FEBio theory manual, section 5; Pekedis 2025, eqs. 2-4): nothing in
  compression, an exponential-power toe up to lambda_0, then linear in the stretch.
- each Prony term by the recursion of Puso and Weiss (1998): H <- H exp(-dt/tau) + dS (1 - exp(-dt/tau)) tau / dt.

The first point of a protocol is taken as a state of rest: relaxed at the displacement it has.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np

from sinew.runner.store.schema import STATUSES
from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.simulate import Array, Capabilities, Compared, Simulated, impossible
from sinew.tasks.simulate.lateral import OUTPUTS, laterals, widths

# A term in a long hold decays into the subnormal numbers and stays there, as the smallest of them times any decay
# above one half is itself again. A processor takes some hundred cycles for each product with one.
SMALLEST_NORMAL = float(np.finfo(np.float64).smallest_normal)
FLUSH_EVERY = 64  # steps at constant stretch
CACHE_LINE = 64  # bytes; also the width of the widest vectors
LANES = 32  # parameter sets advanced together, enough to hide the latency of the recursion


@dataclass(frozen=True)
class Uniaxial:
    """Batches of parameter sets in one compiled pass over time; ``compared``: the outputs that it gives besides."""

    name: str = "uniaxial"
    compared: tuple[str, ...] = ()

    @property
    def capabilities(self) -> Capabilities:
        outputs = tuple(OUTPUTS[name] for name in self.compared)
        return Capabilities(LANES, quick=True, stresses=True, effects="embedded", outputs=outputs)

    def identity(self) -> dict[str, Any]:
        return {"name": self.name, "version": 1} | ({"outputs": list(self.compared)} if self.compared else {})

    def simulate(
        self, model: Model, specimen: Specimen, protocol: Protocol, parameters: Array, *, stresses: bool = False
    ) -> Simulated:
        keep = np.arange(protocol.time_s.size)
        force, matrix, fibre, _ = _run(model, specimen, protocol, parameters, keep, None, stresses=stresses)
        status, messages = _judge(model, parameters, force)
        for array in (force, matrix, fibre):
            array[status[: len(array)] > 0] = np.nan
        outputs = widths(self.compared, model, specimen, parameters, _strain(specimen, protocol), force)
        return Simulated(force, status, messages, matrix if stresses else None, fibre if stresses else None, outputs)

    def compare(self, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array) -> Compared:
        force, _, _, squares = _run(model, specimen, curve.protocol, parameters, keep, curve.force_N)
        rmse = np.sqrt(squares / curve.force_N.size)
        status, messages = _judge(model, parameters, np.column_stack([force, rmse]))
        force[status > 0] = np.nan
        rmse[status > 0] = np.nan
        done = Compared(rmse, force, status, messages)
        return self._with_outputs(done, model, specimen, curve, parameters, keep) if self.compared else done

    def _with_outputs(
        self, done: Compared, model: Model, specimen: Specimen, curve: Curve, parameters: Array, keep: Array
    ) -> Compared:
        strain = _strain(specimen, curve.protocol)
        values, summaries, rmse = laterals(self.compared, model, specimen, dict(curve.others), parameters, strain, keep)
        return without_width(replace(done, outputs=values, summaries=summaries, rmse=rmse))


def _strain(specimen: Specimen, protocol: Protocol) -> Array:
    """The Green-Lagrange strain ``[t]`` along the bar."""
    strain: Array = 0.5 * (specimen.stretch(protocol) ** 2 - 1.0)
    return strain


def without_width(done: Compared) -> Compared:
    """The same with rows failed that have lost their width; outputs of failed rows are NaN."""
    lost = ~np.all([np.isfinite(summary) for summary in done.summaries.values()], axis=0) & (done.status == 0)
    status = np.where(lost, STATUSES.index("diverged"), done.status).astype(np.int8)
    messages = tuple("nothing is left of the width" if gone else m for gone, m in zip(lost, done.messages, strict=True))
    for array in (done.rmse_N, done.force_N, *done.outputs.values(), *done.summaries.values(), *done.rmse.values()):
        array[status > 0] = np.nan
    return replace(done, status=status, messages=messages)


def _judge(model: Model, parameters: Array, numbers: Array) -> tuple[Array, tuple[str, ...]]:
    status = np.zeros(len(parameters), dtype=np.int8)
    reasons = dict.fromkeys(np.flatnonzero(~np.isfinite(numbers).all(axis=1)).tolist(), "the force is not finite")
    status[list(reasons)] = STATUSES.index("diverged")
    wrong = impossible(model, parameters)
    status[list(wrong)] = STATUSES.index("bad_input")
    reasons |= wrong
    return status, tuple(reasons.get(row, "") for row in range(len(parameters)))


def _run(
    model: Model,
    specimen: Specimen,
    protocol: Protocol,
    parameters: Array,
    keep: Array,
    measured: Array | None,
    *,
    stresses: bool = False,
) -> tuple[Array, Array, Array, Array]:
    """Force and stresses ``[n, k]`` at the kept points and summed squared residuals ``[n]`` over all points."""
    stretch = np.ascontiguousarray(specimen.stretch(protocol), dtype=np.float64)
    steps, step_of = protocol.distinct_steps
    slot = np.full(stretch.size, -1, dtype=np.int64)
    slot[keep] = np.arange(keep.size)
    count = len(parameters)
    padded = np.empty((-(-count // LANES) * LANES, parameters.shape[1]))
    padded[:count] = parameters
    padded[count:] = parameters[-1:]  # every pass has full lanes, so no row's numbers depend on its neighbours
    force = np.empty((len(padded), keep.size))
    parts = np.empty((2, *force.shape)) if stresses else np.empty((2, 0, 0))
    squares = np.empty(len(padded))
    columns = np.array([model.names.index(name) for name in _ORDER])
    for first in range(0, len(padded), LANES):
        block = slice(first, first + LANES)
        lanes = np.ascontiguousarray(padded[block, columns].T)
        coefficients = _coefficients(steps, lanes)
        _advance(
            stretch,
            step_of,
            coefficients,
            _fibre_constants(lanes, model.beta, model.lambda_0),
            lanes[_E_M],
            specimen.area_mm2,
            model.beta,
            model.lambda_0,
            np.zeros(0) if measured is None else measured,
            slot,
            force[block],
            parts[0, block],
            parts[1, block],
            squares[block],
        )
    return force[:count], parts[0, :count], parts[1, :count], squares[:count]


_ORDER = (
    *("E_f", "alpha_f", "E_m"),
    *("g_1m", "g_2m", "g_3m", "g_1f", "g_2f", "g_3f"),
    *("tau_1m", "tau_2m", "tau_3m", "tau_1f", "tau_2f", "tau_3f"),
)
_E_F, _ALPHA, _E_M, _G, _TAU = 0, 1, 2, 3, 9


def _coefficients(steps: Array, lanes: Array) -> Array:
    """Flat ``[k, 12, lanes]``: decay of each of the six Prony terms in a step, and gain per stress increment."""
    with np.errstate(all="ignore"):  # rows with impossible parameters get their status afterwards
        ratio = steps[:, np.newaxis, np.newaxis] / lanes[_TAU : _TAU + 6]
        gain = lanes[_G : _G + 6] * (-np.expm1(-ratio) / ratio)
        return np.concatenate([np.exp(-ratio), gain], axis=1).ravel()


def _fibre_constants(lanes: Array, beta: float, lambda_0: float) -> Array:
    """Flat ``[4, lanes]``: 2 xi exp(alpha (I0-1)^beta), alpha, 2 B, E_f; continuity at lambda_0 gives xi and B."""
    modulus, alpha = lanes[_E_F], lanes[_ALPHA]
    square = lambda_0**2
    power = (square - 1) ** beta
    with np.errstate(all="ignore"):
        d = 4 * square**1.5 * (beta - 1 + alpha * beta * power)
        toe = 2 * modulus * (square - 1) ** (2 - beta) / d
        linear = 2 * modulus * (2 * square * (beta - 0.5 + alpha * beta * power) - 1) / d
    return np.concatenate([toe, alpha, linear, modulus])


# Rows of the kernel's scratch memory. One flat array with constant offsets lets the compiler prove that no two rows
# overlap, and so use vector instructions without run-time checks; that is worth a factor of three.
_H = 0
_DECAY = 6 * LANES
_GAIN = 12 * LANES
_MATRIX = 18 * LANES
_FIBRE = 19 * LANES
_D_MATRIX = 20 * LANES
_D_FIBRE = 21 * LANES
_FORCE = 22 * LANES
_SQUARES = 23 * LANES
_HALF_E_M = 24 * LANES
_TOE = 25 * LANES
_ALPHAS = 26 * LANES
_LINEAR = 27 * LANES
_E_FS = 28 * LANES
_ROWS = 29 * LANES


_compiled = numba.njit(nogil=True, cache=True, error_model="numpy")
_part = numba.njit(nogil=True, error_model="numpy")  # LLVM inlines these; with inline="always" it takes 10 % longer


@_compiled
def _advance(  # type: ignore[no-untyped-def]
    stretch,
    step_of,
    coefficients,
    fibre_constants,
    matrix_modulus,
    area,
    beta,
    lambda_0,
    measured,
    slot,
    force,
    matrix_stress,
    fibre_stress,
    squares,
):
    """Advance all lanes over the whole history; writes kept forces and stresses, and summed squared residuals."""
    s = _aligned_zeros()
    _set_constants(s, fibre_constants, matrix_modulus)
    toe_end = lambda_0 * lambda_0
    toe_end_power = (toe_end - 1.0) ** beta
    compared = measured.size > 0
    stresses = matrix_stress.size > 0
    last_step = -1
    last_stretch = np.nan
    held = 0
    for t in range(stretch.size):
        stretched = stretch[t]
        scale = area * stretched
        truth = measured[t] if compared else 0.0
        step = step_of[t]
        if step != last_step:
            last_step = step
            _set_coefficients(s, coefficients, step)
        if stretched != last_stretch:
            last_stretch = stretched
            _set_fibre_stress(s, stretched, beta, toe_end, toe_end_power)
            _set_increments(s, stretched * stretched - 1.0)
            if t == 0:
                _clear_increments(s)  # at rest: fully relaxed
            _step_of_a_ramp(s, scale, truth)
        else:
            _step_of_a_hold(s, scale, truth)
            held += 1
            if held % FLUSH_EVERY == 0:
                _flush(s)
        k = slot[t]
        if k >= 0:
            for w in range(LANES):
                force[w, k] = s[_FORCE + w]
            if stresses:
                _keep_stresses(s, k, matrix_stress, fibre_stress)
    for w in range(LANES):
        squares[w] = s[_SQUARES + w]


@_part
def _aligned_zeros():  # type: ignore[no-untyped-def]
    """Scratch memory that starts a cache line: otherwise half of all wide vectors lie across two of them."""
    memory = np.zeros(_ROWS + CACHE_LINE // 8)
    first = -memory.ctypes.data % CACHE_LINE // 8
    return memory[first : first + _ROWS]


@_part
def _set_constants(s, fibre_constants, matrix_modulus):  # type: ignore[no-untyped-def]
    for w in range(4 * LANES):
        s[_TOE + w] = fibre_constants[w]
    for w in range(LANES):
        s[_HALF_E_M + w] = 0.5 * matrix_modulus[w]


@_part
def _set_coefficients(s, coefficients, step):  # type: ignore[no-untyped-def]
    """Take the decays and gains of a step of this length."""
    for w in range(12 * LANES):
        s[_DECAY + w] = coefficients[step * 12 * LANES + w]


@_part
def _set_fibre_stress(s, stretch, beta, toe_end, toe_end_power):  # type: ignore[no-untyped-def]
    """The fibres' elastic stress at a stretch, in the row of the force."""
    square = stretch * stretch
    if square <= 1.0:
        for w in range(LANES):
            s[_FORCE + w] = 0.0
    elif square < toe_end:
        power = (square - 1.0) ** beta
        slope = (square - 1.0) ** (beta - 1.0)
        for w in range(LANES):
            s[_FORCE + w] = s[_TOE + w] * math.exp(s[_ALPHAS + w] * (power - toe_end_power)) * slope
    else:
        inverse = 1.0 / stretch
        for w in range(LANES):
            s[_FORCE + w] = s[_LINEAR + w] - s[_E_FS + w] * inverse


@_part
def _set_increments(s, strain):  # type: ignore[no-untyped-def]
    """The elastic stresses, and how much they have changed; the fibres' new stress is in the row of the force."""
    for w in range(LANES):
        elastic = s[_HALF_E_M + w] * strain
        s[_D_MATRIX + w] = elastic - s[_MATRIX + w]
        s[_MATRIX + w] = elastic
        elastic = s[_FORCE + w]
        s[_D_FIBRE + w] = elastic - s[_FIBRE + w]
        s[_FIBRE + w] = elastic


@_part
def _clear_increments(s):  # type: ignore[no-untyped-def]
    for w in range(2 * LANES):
        s[_D_MATRIX + w] = 0.0


@_part
def _step_of_a_ramp(s, scale, truth):  # type: ignore[no-untyped-def]
    """The six terms decay and take up the increments; then the force."""
    for w in range(LANES):
        h0 = s[_H + w] * s[_DECAY + w] + s[_D_MATRIX + w] * s[_GAIN + w]
        h1 = s[_H + LANES + w] * s[_DECAY + LANES + w] + s[_D_MATRIX + w] * s[_GAIN + LANES + w]
        h2 = s[_H + 2 * LANES + w] * s[_DECAY + 2 * LANES + w] + s[_D_MATRIX + w] * s[_GAIN + 2 * LANES + w]
        h3 = s[_H + 3 * LANES + w] * s[_DECAY + 3 * LANES + w] + s[_D_FIBRE + w] * s[_GAIN + 3 * LANES + w]
        h4 = s[_H + 4 * LANES + w] * s[_DECAY + 4 * LANES + w] + s[_D_FIBRE + w] * s[_GAIN + 4 * LANES + w]
        h5 = s[_H + 5 * LANES + w] * s[_DECAY + 5 * LANES + w] + s[_D_FIBRE + w] * s[_GAIN + 5 * LANES + w]
        s[_H + w] = h0
        s[_H + LANES + w] = h1
        s[_H + 2 * LANES + w] = h2
        s[_H + 3 * LANES + w] = h3
        s[_H + 4 * LANES + w] = h4
        s[_H + 5 * LANES + w] = h5
        total = scale * ((s[_MATRIX + w] + ((h0 + h1) + h2)) + (s[_FIBRE + w] + ((h3 + h4) + h5)))
        s[_FORCE + w] = total
        s[_SQUARES + w] += (total - truth) * (total - truth)


@_part
def _step_of_a_hold(s, scale, truth):  # type: ignore[no-untyped-def]
    """The six terms only decay; then the force."""
    for w in range(LANES):
        h0 = s[_H + w] * s[_DECAY + w]
        h1 = s[_H + LANES + w] * s[_DECAY + LANES + w]
        h2 = s[_H + 2 * LANES + w] * s[_DECAY + 2 * LANES + w]
        h3 = s[_H + 3 * LANES + w] * s[_DECAY + 3 * LANES + w]
        h4 = s[_H + 4 * LANES + w] * s[_DECAY + 4 * LANES + w]
        h5 = s[_H + 5 * LANES + w] * s[_DECAY + 5 * LANES + w]
        s[_H + w] = h0
        s[_H + LANES + w] = h1
        s[_H + 2 * LANES + w] = h2
        s[_H + 3 * LANES + w] = h3
        s[_H + 4 * LANES + w] = h4
        s[_H + 5 * LANES + w] = h5
        total = scale * ((s[_MATRIX + w] + ((h0 + h1) + h2)) + (s[_FIBRE + w] + ((h3 + h4) + h5)))
        s[_FORCE + w] = total
        s[_SQUARES + w] += (total - truth) * (total - truth)


@_part
def _flush(s):  # type: ignore[no-untyped-def]
    """Terms that have decayed below the normal numbers become zero."""
    for w in range(6 * LANES):
        if abs(s[_H + w]) < SMALLEST_NORMAL:
            s[_H + w] = 0.0


@_part
def _keep_stresses(s, k, matrix_stress, fibre_stress):  # type: ignore[no-untyped-def]
    for w in range(LANES):
        matrix_stress[w, k] = s[_MATRIX + w] + (s[_H + w] + s[_H + LANES + w] + s[_H + 2 * LANES + w])
        fibre_stress[w, k] = s[_FIBRE + w] + (s[_H + 3 * LANES + w] + s[_H + 4 * LANES + w] + s[_H + 5 * LANES + w])
