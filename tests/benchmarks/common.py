"""What benchmarks share: a virtual specimen at the full rate of the tests, and random rows."""

import time
from collections.abc import Callable

import numpy as np

from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.simulate import Simulator
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial


def specimen(rate_hz: float = 100.0) -> Specimen:
    return virtual_cohort(seed=1, per_site=1, rate_hz=rate_hz)[0][0]


def evaluation(simulator: Simulator | None = None, rate_hz: float = 100.0) -> SpecimenEvaluation:
    return SpecimenEvaluation(Model(), specimen(rate_hz), simulator or Uniaxial(), 96)


def rows(count: int, seed: int = 0) -> np.ndarray:
    low, high = (np.array([getattr(p, side) for p in Model().parameters]) for side in ("minimum", "maximum"))
    drawn = np.random.default_rng(seed).random((count, low.size))
    drawn *= high - low  # in place: the memory benchmark counts every copy
    drawn += low
    return drawn


def seconds(function: Callable[[], object]) -> float:
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def median_line(name: str, values: list[float], unit: str, scale: float = 1.0) -> float:
    found = float(np.median(values))
    print(f"  {name}: {found * scale:.4g} {unit} (from {min(values) * scale:.4g} to {max(values) * scale:.4g})")
    return found
