"""How far posteriors are from the truth where the model lacks something, without and beside a discrepancy.

Of five parameters of virtual specimens, around the best fit: an effect at half its typical size, an uneven screw, or
nothing that the model lacks.
"""

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import norm

from sinew.tasks.infer.likelihood.discrepancy import model_error
from tests.tasks.infer.likelihood.specimens import fitted, target

SPECIMENS, STRENGTH, SCREW, RATE_HZ = 8, 0.5, 0.01, 20.0
EFFECTS = (
    "machine-compliance", "preload", "grip-slip", "force-drift", "friction", "time-lag",
    "softening", "creep", "permanent-set", "relaxation-mode", "rate-viscosity", "toe-exponent",
)  # fmt: skip
CASES = ["nothing", "screw", *EFFECTS]


@dataclass(frozen=True)
class Found:
    """Of one specimen: distances of all parameters from the truth, and how much wider the discrepancy makes them."""

    misfit: float
    without: np.ndarray
    beside: np.ndarray
    wider: float


def found(case: str, number: int) -> Found:
    effect, screw = (case if case in EFFECTS else ""), (SCREW if case == "screw" else 0.0)
    bare, truth = target(number, effect, screw, STRENGTH, RATE_HZ)
    error = model_error(bare, (number,))
    _, without, narrow = fitted(bare, truth)
    _, beside, wide = fitted(replace(bare, whitening=error.white), truth)
    return Found(error.misfit, without, beside, float(np.median(wide / narrow)))


def main() -> None:
    inside = norm.ppf(0.975)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for case in CASES:
            every = list(pool.map(partial(found, case), range(SPECIMENS)))
            without, beside = (np.array([getattr(one, name) for one in every]) for name in ("without", "beside"))
            shares = [100 * np.mean(np.abs(apart) < inside) for apart in (without, beside)]
            sizes = [np.sqrt(np.mean(np.square(apart))) for apart in (without, beside)]
            print(
                f"  {case}: misfit {np.median([one.misfit for one in every]):.2f} times the noise; true values within "
                f"95 %: {shares[0]:.0f} % without, {shares[1]:.0f} % beside a discrepancy; distance from the truth in "
                f"standard deviations (root mean square): {sizes[0]:.1f}, {sizes[1]:.1f}; intervals "
                f"{np.median([one.wider for one in every]):.2f} times as wide",
                flush=True,
            )
