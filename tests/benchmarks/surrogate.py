"""Emulators of forces along time: errors as told and at fresh points, intervals there, and what growth is worth.

The tendon of three protocols, with four parameters and with all 16. Each row is the median over seeds of the largest
error of a course, in parts of its spread, and the mean part of fresh points inside 95 % intervals.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.fitting.emulator import SDS, Emulator, LeftOut, trained, widening
from sinew.tasks.fitting.growth import next_runs
from sinew.tasks.model import Model
from sinew.tasks.simulate.growing import TURN, sizes_up_to
from sinew.tasks.simulate.plain_design import shares
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.surrogate.reading import apart
from sinew.tasks.surrogate.task import POOL, split

Array = np.ndarray
FOUR = ("E_f", "alpha_f", "E_m", "tau_1f")
KEPT = 10  # every tenth point of a curve of 1 Hz
FRESH = 1000


@dataclass(frozen=True)
class Step:
    """What was found with so many ``runs``: errors in parts of the spread, part ``inside``, and ``seconds`` taken."""

    runs: int
    told: float
    true: float
    inside: float
    seconds: float


class Tendon:
    """Forces of the first virtual specimen with some parameters free, the others at their references."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.model = Model()
        self.free = [one for one in self.model.parameters if one.name in names]
        self.specimen = virtual_cohort(seed=1, per_site=1, rate_hz=1.0)[0][0]

    def courses(self, share: Array) -> list[Array]:
        rows = np.tile([one.reference for one in self.model.parameters], (len(share), 1))
        for column, one in enumerate(self.free):
            rows[:, self.model.names.index(one.name)] = one.minimum + (one.maximum - one.minimum) * share[:, column]
        simulator = Uniaxial()
        return [
            simulator.simulate(self.model, self.specimen, curve.protocol, rows).force_N[:, ::KEPT]
            for curve in self.specimen.curves
        ]


def grown(tendon: Tendon, growth: str, seed: int, most: int) -> list[Step]:
    size = len(tendon.free)
    fresh = np.random.default_rng(99).random((FRESH, size))
    truth = tendon.courses(fresh)
    share, fits, found, emulator = np.empty((0, size)), (), [], None
    for step, runs in enumerate(sizes_up_to(most)):
        began = perf_counter()
        if emulator is None or growth == "even":
            new = shares(size, runs, seed, TURN)[len(share) :]
        else:
            pool = qmc.Sobol(size, scramble=True, seed=np.random.default_rng([seed, step])).random_base2(POOL)
            new = pool[next_runs(emulator, pool, np.ones(len(pool)), runs - len(share))]
        share = np.concatenate([share, new])
        values = tendon.courses(share)
        courses, spreads = apart(values)
        fits, left = trained(share, courses, fits)
        emulator = Emulator(share, courses, fits)
        seconds = perf_counter() - began
        mean, sd = emulator.predict(fresh)
        told, true, inside = [], [], []
        parts = (split(each, values) for each in (left.mean, left.sd, mean, sd))
        for value, whole, spread, out, out_sd, at, at_sd in zip(values, truth, spreads, *parts, strict=True):
            factor = widening(value, LeftOut(out, out_sd), size)
            told.append(np.sqrt(np.mean((value - out) ** 2)) / spread)
            true.append(np.sqrt(np.mean((whole - at) ** 2)) / np.sqrt(np.mean(np.var(whole, axis=0))))
            inside.append(np.mean(np.abs(whole - at) <= SDS * factor * at_sd + 1e-12 * spread))
        found.append(Step(runs, max(told), max(true), float(np.mean(inside)), seconds))
    return found


def main() -> None:
    every = {"4": (Tendon(FOUR), 144, 6), "16": (Tendon(Model().names), 400, 2)}
    print("| parameters | growth | runs | error, left out | error, fresh | fresh, inside 95 % | s |")
    print("|---|---|---|---|---|---|---|")
    with threadpool_limits(1):
        for name, (tendon, most, seeds) in every.items():
            for growth in ("even", "active"):
                runs = [grown(tendon, growth, seed, most) for seed in range(seeds)]
                for steps in zip(*runs, strict=True):
                    told, true, seconds = (np.median([getattr(one, key) for one in steps])
                                           for key in ("told", "true", "seconds"))  # fmt: skip
                    inside = np.mean([one.inside for one in steps])
                    print(f"| {name} | {growth} | {steps[0].runs} | {100 * told:.2g} % | {100 * true:.2g} % | "
                          f"{100 * inside:.0f} % | {seconds:.1f} |", flush=True)  # fmt: skip
