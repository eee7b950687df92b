"""Calibration of 27 virtual specimens whose truth is known: how near the hybrid comes to the noise, and what Bayesian
optimisation is worth beside random search and scikit-optimize's own sequential loop, at equal numbers of evaluations.
"""

import sys
import tempfile
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from skopt import gp_minimize
from threadpoolctl import threadpool_limits

from sinew.tasks.calibrate.settings import Settings
from sinew.tasks.calibrate.task import run
from sinew.tasks.cluster.spec import cluster_of
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import Model, Specimen
from sinew.tasks.model.parameters import from_unit
from sinew.tasks.simulate.evaluation import SpecimenEvaluation
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.study import read_study
from sinew.tasks.study.workspace import open_workspace
from tests.benchmarks.common import median_line, seconds

SEED = 4711  # a cohort that nothing was tuned on
EVALUATIONS, BAYESIAN = 600, 100
WITHIN = 1.05  # of the RMSE at the true parameters
SEQUENTIAL = 9  # specimens for gp_minimize, which takes minutes for each
STUDY = f"""
name: calibration
seed: {SEED}
cohort: cohort
tasks: [calibrate]
cluster: {{name: local, workers: 2}}
calibrate: {{methods: [bayesian, hybrid], evaluations: {EVALUATIONS}, bayesian: {{evaluations: {BAYESIAN}}}}}
"""


def calibrated(specimens: list[Specimen], truth: dict[str, Any]) -> dict[str, Any]:
    """What `sinew calibrate` says of them."""
    with tempfile.TemporaryDirectory() as folder:
        write_cohort(Path(folder) / "cohort", specimens, truth)
        study = Path(folder) / "study.yaml"
        study.write_text(STUDY)
        read = read_study(study)
        with open_workspace(read, out=Path(folder) / "out", cluster=cluster_of(read), quiet=True) as workspace:
            return run(workspace, workspace.study.section(Settings))


def totals(specimen: Specimen, points: np.ndarray) -> np.ndarray:
    """Sum of the RMSEs ``[n]`` (N) at points of the unit cube; failures are far away."""
    evaluation = SpecimenEvaluation(Model(), specimen, Uniaxial(), 96)
    objective = evaluation(from_unit(Model(), points)).values["objective"].sum(axis=1)
    return np.where(np.isfinite(objective), objective, 1e4)


def random_search(specimen: Specimen, number: int) -> float:
    points = np.random.default_rng((SEED, 1, number)).random((BAYESIAN, len(Model().free)))
    return float(totals(specimen, points).min())


def sequential(specimen: Specimen, number: int) -> float:
    """The best of scikit-optimize's loop with its own settings."""
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it proposes points twice and says so
        found = gp_minimize(
            lambda point: float(totals(specimen, np.array([point]))[0]),
            [(0.0, 1.0)] * len(Model().free),
            n_calls=BAYESIAN,
            n_initial_points=10,
            random_state=SEED + number,
        )
    return float(found.fun)


def compared(name: str, values: Sequence[float]) -> None:
    median_line(f"{name}, {len(values)} specimens, {BAYESIAN} evaluations: best", list(values), "N")


def main() -> None:
    specimens, truth = virtual_cohort(seed=SEED)
    low, span = (np.array([p.minimum for p in Model().free]), [p.maximum - p.minimum for p in Model().free])
    floors = {}
    for specimen in specimens:
        at = truth["specimens"][specimen.name]["parameters"]
        floors[specimen.name] = float(totals(specimen, (np.array([list(at.values())]) - low) / np.array(span))[0])
    found: dict[str, Any] = {}
    taken = seconds(lambda: found.update(calibrated(specimens, truth)))
    told = [found["specimens"][specimen.name]["methods"] for specimen in specimens]
    ratios = [m["hybrid"]["total_N"] / floors[s.name] for m, s in zip(told, specimens, strict=True)]
    near = sum(ratio <= WITHIN for ratio in ratios)
    print(f"  {len(specimens)} specimens at 100 Hz, two workers: {taken:.0f} s")
    median_line(f"hybrid, at most {EVALUATIONS} evaluations: RMSE / RMSE at the truth", ratios, "")
    print(f"  within {WITHIN:g} of it: {near} of {len(specimens)}", flush=True)
    bayesian = [method["bayesian"]["total_N"] for method in told]
    compared("Bayesian optimisation", bayesian)
    compared("random search", [random_search(specimen, number) for number, specimen in enumerate(specimens)])
    chosen = list(range(0, len(specimens), len(specimens) // SEQUENTIAL))
    compared("Bayesian optimisation", [bayesian[number] for number in chosen])
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        compared("gp_minimize", list(pool.map(sequential, [specimens[number] for number in chosen], chosen)))
    sys.stdout.flush()
