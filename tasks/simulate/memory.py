"""The stress of viscous branches along a history, for any number of branches: the recursion of Puso and Weiss (1998).

Each branch keeps H <- H exp(-dt/tau) + dS viscosity (1 - exp(-dt/tau)) / dt, where S is the quantity that drives it.
Viscosity is strength times tau; tau = 0 is a bare dashpot with a backward difference. A step during which relaxation
times change is divided into parts.
"""

import math

import numba
import numpy as np

PARTS = 8  # of a step during which relaxation times change

_compiled = numba.njit(nogil=True, cache=True, error_model="numpy")
_inlined = numba.njit(inline="always", error_model="numpy")  # as plain functions, the loops take 25 % longer


@_compiled
def stress(  # type: ignore[no-untyped-def]
    steps,
    step_of,
    driver,
    viscosity,
    times,
    slowing,
    slowed,
    matrix,
    fibre,
    strain,
    sudden,
    total,
):
    """Write the stress ``total`` ``[n, t]``: the constituents' elastic stress and that of all branches.

    Branch k is driven by the elastic stress of the ``matrix`` or of the ``fibre`` (MPa) or by the ``strain``, all
    ``[n, t]``, as ``driver[k]`` is 0, 1 or 2, with ``viscosity`` and ``times`` ``[n, k]``. The times of the first
    ``slowed`` branches are multiplied by ``slowing`` ``[n, t]``. The first point is at rest, unless ``sudden``: then
    the bars are free of stress there, and their load comes with the first step.
    """
    count = driver.size
    h, decay, gain, change = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(3)
    for row in range(total.shape[0]):
        h[:] = 0.0
        last_step, last_former, last_factor = -1, 1.0, 1.0
        m, f, e = (0.0, 0.0, 0.0) if sudden else (matrix[row, 0], fibre[row, 0], strain[row, 0])
        total[row, 0] = m + f
        for t in range(1, total.shape[1]):
            former = slowing[row, t - 1] if slowed > 0 else 1.0
            factor = slowing[row, t] if slowed > 0 else 1.0
            if step_of[t] != last_step or former != last_former or factor != last_factor:
                last_step, last_former, last_factor = step_of[t], former, factor
                _set_coefficients(decay, gain, steps[last_step], former, factor, slowed, viscosity[row], times[row])
            change[0], change[1], change[2] = matrix[row, t] - m, fibre[row, t] - f, strain[row, t] - e
            m, f, e = matrix[row, t], fibre[row, t], strain[row, t]
            summed = m + f
            for k in range(count):
                h[k] = h[k] * decay[k] + change[driver[k]] * gain[k]
                summed += h[k]
            total[row, t] = summed


@_compiled
def correction(  # type: ignore[no-untyped-def]
    steps,
    step_of,
    driver,
    viscosity,
    times,
    slowing,
    slowed,
    stretch,
    stress,
    tangents,
    area,
    length,
    compliance,
    kept,
    residual,
    result,
):
    """Write the change of displacement ``[n, t]`` (mm) that removes ``residual`` ``[n, t]`` (mm), to first order.

    Displacement s lost outside the gauge length follows s <- kept s + compliance dF, with ``compliance`` (mm/N) and
    ``kept`` ``[m, n, t]``.
    ``tangents`` ``[3, n, t]`` are the derivatives of the drivers by the stretch. As the past is known, each point is
    one linear equation. Where the bars are one and residuals are many, all of them are of that bar.
    """
    count = driver.size
    h, decay, gain = np.zeros(count), np.zeros(count), np.zeros(count)
    slipped = np.zeros(compliance.shape[0])
    for row in range(result.shape[0]):
        h[:], decay[:], gain[:] = 0.0, 0.0, 0.0
        slipped[:] = 0.0
        last_step, last_former, last_factor = -1, 1.0, 1.0
        before = 0.0
        bar = row if stretch.shape[0] > 1 else 0
        for t in range(result.shape[1]):
            former = slowing[bar, t - 1] if slowed > 0 and t > 0 else 1.0
            factor = slowing[bar, t] if slowed > 0 else 1.0
            if t > 0 and (step_of[t] != last_step or former != last_former or factor != last_factor):
                last_step, last_former, last_factor = step_of[t], former, factor
                _set_coefficients(decay, gain, steps[last_step], former, factor, slowed, viscosity[bar], times[bar])
            stiffness, history = _response(t, tangents[:, bar], driver, h, decay, gain, before)
            scale = area[bar] * stretch[bar, t]
            instant = (area[bar] * stress[bar, t] + scale * stiffness) / length
            past = scale * history
            soft, lost = 0.0, 0.0
            for m in range(slipped.size):
                slipped[m] *= kept[m, bar, t]
                soft += compliance[m, bar, t]
                lost += slipped[m]
            moved = (residual[row, t] - lost - soft * past) / (1.0 + soft * instant)
            pulled = instant * moved + past
            for m in range(slipped.size):
                slipped[m] += compliance[m, bar, t] * pulled
            now = moved / length
            _advance(t, tangents[:, bar], driver, h, decay, gain, before, now)
            before = now
            result[row, t] = moved


@_inlined
def _response(t, tangents, driver, h, decay, gain, before):  # type: ignore[no-untyped-def]
    """How stress follows the stretch at point ``t``, and the part of the stress that the past has decided already."""
    stiffness = tangents[0, t] + tangents[1, t]
    history = 0.0
    for k in range(driver.size):
        stiffness += tangents[driver[k], t] * gain[k]
        history += h[k] * decay[k]
        if t > 0:
            history -= tangents[driver[k], t - 1] * before * gain[k]
    return stiffness, history


@_inlined
def _advance(t, tangents, driver, h, decay, gain, before, now):  # type: ignore[no-untyped-def]
    """Take the branches to point ``t``, where the stretch changes by ``now``; at the point before, by ``before``."""
    for k in range(driver.size):
        change = tangents[driver[k], t] * now
        if t > 0:
            change -= tangents[driver[k], t - 1] * before
        h[k] = h[k] * decay[k] + change * gain[k]


@_inlined
def _set_coefficients(decay, gain, step, former, factor, slowed, viscosity, times):  # type: ignore[no-untyped-def]
    """Decays and gains of a step during which the times of ``slowed`` branches are multiplied by these factors."""
    decay[:], gain[:] = 1.0, 0.0
    parts = 1 if former == factor else PARTS
    for part in range(parts):
        during = factor if parts == 1 else former * (factor / former) ** ((part + 0.5) / parts)
        for k in range(slowed):
            _go_on(decay, gain, k, step, step / parts, during, viscosity[k], times[k])
    for k in range(slowed, decay.size):
        _go_on(decay, gain, k, step, step, 1.0, viscosity[k], times[k])


@_inlined
def _go_on(decay, gain, k, step, part, factor, viscosity, time):  # type: ignore[no-untyped-def]
    """Take decay and gain of branch ``k`` over a ``part`` of a ``step`` (s) with a ``factor`` on its time."""
    lost = math.expm1(-part / (time * factor))
    decay[k] *= 1.0 + lost
    gain[k] = gain[k] * (1.0 + lost) - viscosity * factor * lost / step
