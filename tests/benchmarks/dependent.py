"""How often 95 % intervals hold the indices of parameters that depend on each other."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from SALib.test_functions import Ishigami

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate.inputs import Inputs
from sinew.tasks.simulate.saltelli import saltelli
from sinew.tasks.sobol.estimate import estimator
from sinew.tasks.sobol.method import Intervals
from tests.benchmarks.sobol import SCRAMBLES, SEEDS, TENDON_SEEDS, objective, tell
from tests.tasks.sobol.test_dependent import COVARIANCES, linear_truth, model_of, normal_inputs

Array = np.ndarray
TRUTH = {"Ishigami": 2**17, "tendon": 2**14}  # base samples
INDICES = ("S1", "ST", "Sh")


@dataclass(frozen=True)
class Case:
    """A function of rows ``[n, d]`` of a model's free parameters, and its true indices by their names."""

    name: str
    model: Model
    inputs: Inputs
    function: Callable[[Array], Array]
    truth: dict[str, Array] | None = None


def estimates(case: Case, base: int, seed: int) -> dict[str, Array]:
    design = saltelli(case.model, base, False, seed, SCRAMBLES, case.inputs)
    outcomes = case.function(design.rows)
    found = estimator(design, design.features(), np.isfinite(outcomes), Intervals(10, 0.95, seed))
    return {key: values[:, 0] for key, values in found.of(outcomes[:, np.newaxis]).items()}


def known(case: Case) -> dict[str, Array]:
    """The truth, or what a large design of another seed finds."""
    if case.truth is not None:
        return case.truth
    found = estimates(case, TRUTH[case.name], 10**6)
    half = ", ".join(f"{key} {found[f'{key}_conf'].max():.4f}" for key in INDICES)
    print(f"  {case.name}: truth from {TRUTH[case.name]} base samples, half-widths up to {half}", flush=True)
    return found


def linear() -> Case:
    """A sum of five normal parameters, each two of which are correlated by 0.4; the truth is known."""
    slopes, covariance = np.array([1.0, -0.5, 2.0, 0.3, 0.0]), COVARIANCES[5]
    truth = linear_truth(slopes, covariance, [(j,) for j in range(5)])
    return Case("sum", model_of(5), normal_inputs(covariance), lambda rows: rows @ slopes, truth)


def ishigami() -> Case:
    """Ishigami's function, of which the first and the third parameter are correlated (Kucherenko et al. 2012)."""
    model = Model(tuple(own_parameter(f"x{j}", "1", -np.pi, np.pi) for j in range(3)))
    return Case("Ishigami", model, Inputs(correlations={"x0": {"x2": 0.5}}), Ishigami.evaluate)


def tendon() -> Case:
    """The objective of one virtual specimen, two pairs of whose parameters are correlated."""
    inputs = Inputs(correlations={"E_f": {"alpha_f": -0.6}, "E_m": {"g_1m": 0.5}})
    return Case("tendon", Model(), inputs, objective())


def main() -> None:
    for case, seeds in ((linear(), SEEDS), (ishigami(), SEEDS), (tendon(), TENDON_SEEDS)):
        truth = known(case)
        for base in (256, 2048):
            every = [estimates(case, base, seed) for seed in range(seeds)]
            tell(f"{case.name}, {base} base samples", every, {key: truth[key] for key in INDICES})
