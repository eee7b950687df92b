"""The embedded simulator against a plain scalar loop over time, per evaluation of 73,735 points on one core."""

import math

import numba
import numpy as np

from sinew.tasks.model import Model
from sinew.tasks.simulate.evaluation import kept_points
from sinew.tasks.simulate.uniaxial import LANES, Uniaxial
from tests.benchmarks.common import median_line, rows, seconds, specimen

ROUNDS = 7


@numba.njit(nogil=True, error_model="numpy")
def plain(time_s, stretch, area, p, every_step, out):
    """One parameter set, one step at a time; decays once for all, or at every step as unequal steps need."""
    e_f, alpha, e_m = p[0], p[1], p[8]
    i0 = 1.01**2
    d = 4 * i0**1.5 * (1 + 2 * alpha * (i0 - 1) ** 2)
    xi = e_f * math.exp(-alpha * (i0 - 1) ** 2) / d
    b = e_f * (2 * i0 * (1.5 + 2 * alpha * (i0 - 1) ** 2) - 1) / d
    g = np.empty(6)
    tau = np.empty(6)
    decay = np.empty(6)
    gain = np.empty(6)
    h = np.zeros(6)
    for i in range(3):
        g[i], tau[i], g[3 + i], tau[3 + i] = p[9 + i], p[12 + i], p[2 + i], p[5 + i]
    matrix_before = fibre_before = 0.0
    for t in range(time_s.size):
        square = stretch[t] ** 2
        matrix = e_m * (square - 1) / 2
        if square <= 1:
            fibre = 0.0
        elif square < i0:
            fibre = 2 * xi * math.exp(alpha * (square - 1) ** 2) * (square - 1)
        else:
            fibre = 2 * b - e_f / stretch[t]
        total = matrix + fibre
        if t > 0:
            if every_step or t == 1:
                for i in range(6):
                    x = (time_s[t] - time_s[t - 1]) / tau[i]
                    decay[i] = math.exp(-x)
                    gain[i] = (1 - decay[i]) / x
            for i in range(6):
                change = matrix - matrix_before if i < 3 else fibre - fibre_before
                h[i] = h[i] * decay[i] + change * gain[i]
                total += g[i] * h[i]
        matrix_before, fibre_before = matrix, fibre
        out[t] = area * stretch[t] * total


def main() -> None:
    model, bar = Model(), specimen()
    sets = rows(4 * LANES)
    keeps = [kept_points(curve.protocol, 96) for curve in bar.curves]
    outs = [np.empty(curve.force_N.size) for curve in bar.curves]

    def loop(every_step: bool) -> None:
        for row in sets[:16]:
            for curve, out in zip(bar.curves, outs, strict=True):
                plain(curve.protocol.time_s, bar.stretch(curve.protocol), bar.area_mm2, row, every_step, out)

    def compare() -> None:
        for curve, keep in zip(bar.curves, keeps, strict=True):
            Uniaxial().compare(model, bar, curve, sets, keep)

    def simulate() -> None:
        for curve in bar.curves:
            Uniaxial().simulate(model, bar, curve.protocol, sets[:LANES])

    timed = {
        "plain loop, decays once": (lambda: loop(False), 16),
        "plain loop, decays at every step": (lambda: loop(True), 16),
        "uniaxial, distance to the measured curves": (compare, len(sets)),
        "uniaxial, all forces kept": (simulate, LANES),
    }
    found: dict[str, list[float]] = {name: [] for name in timed}
    for work, _ in timed.values():
        work()
    for _ in range(ROUNDS):
        for name, (work, count) in timed.items():
            found[name].append(seconds(work) / count)
    points = sum(curve.force_N.size for curve in bar.curves)
    print(f"  {points:,} points for each evaluation, {ROUNDS} rounds")
    medians = {name: median_line(name, values, "ms", 1e3) for name, values in found.items()}
    once, every, distance, forces = medians.values()
    print(f"  plain loop / uniaxial: {once / distance:.1f} (distances), {once / forces:.1f} (all forces kept)")
    print(f"  plain loop with unequal steps / uniaxial: {every / distance:.1f}, {every / forces:.1f}")
