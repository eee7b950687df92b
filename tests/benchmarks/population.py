"""Posteriors of a site of nine specimens: time, effective sample sizes, coverage, widths, and how far two seeds differ.

Each cohort is drawn from another normal population of all parameters that the force shows, in the middle of their
ranges, and inferred by `sinew infer` with two seeds on two workers.
"""

import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.stats import t as student

from sinew.tasks.benchmark.infer.drawn import Conditions, measured
from sinew.tasks.data.cohort import write_cohort
from sinew.tasks.model.parameters import bounds
from sinew.tasks.study.model import model_of
from sinew.tasks.study.study import read_study

COHORTS, SPECIMENS, SEEDS = 4, 9, (1, 2)
OF = "E_f"
STUDY = """name: population
seed: {seed}
cohort: cohort
simulator: uniaxial
cluster: {{name: local}}
model: {{parameters: {{nu_m: {{fixed: 0.2}}}}}}
tasks: [infer]
infer: {{method: likelihood, ess: 400}}
"""
Array = np.ndarray


def places_of(rng: np.random.Generator, size: int) -> tuple[Array, Array]:
    """Places in the ranges: a population's mean ``[size]``, and ``[specimens, size]`` of its specimens."""
    mean, spread = rng.uniform(0.35, 0.65, size), rng.uniform(0.05, 0.12, size)
    while True:
        found = rng.normal(mean, spread, (SPECIMENS, size))
        if ((found > 0.02) & (found < 0.98)).all():
            return mean, found


def inferred(folder: Path, seed: int) -> tuple[dict[str, object], float]:
    """The result of `sinew infer` and the seconds that it took."""
    (folder / "study.yaml").write_text(STUDY.format(seed=seed))
    started = time.perf_counter()
    out = folder / f"out{seed}"
    command = [sys.executable, "-m", "sinew", "infer", str(folder / "study.yaml"), "--out", str(out), "--quiet"]
    subprocess.run(command, check=True)
    return json.loads((out / "infer.json").read_text()), time.perf_counter() - started


def apart(one: dict[str, object], other: dict[str, object]) -> tuple[float, float]:
    """By how many standard deviations posterior means of two results differ at most: specimens, the population."""
    specimens = [
        abs(found["mean"] - other["specimens"][specimen][name]["mean"]) / found["sd"]
        for specimen, every in one["specimens"].items()
        for name, found in every.items()
    ]
    known, again = (each["sites"]["site"]["population"] for each in (one, other))
    population = [
        abs(found["mean"] - again[name]["mean"]) / ((found["high"] - found["low"]) / 3.92)
        for name, found in known.items()
    ]
    return max(specimens), max(population)


def main() -> None:
    held = np.zeros(2, dtype=int)
    for number in range(1, COHORTS + 1):
        rng = np.random.default_rng([20261203, number])
        with TemporaryDirectory() as made:
            folder = Path(made)
            (folder / "study.yaml").write_text(STUDY.format(seed=0))
            study = read_study(folder / "study.yaml")
            model = model_of(study.model, study.simulator.law)
            low, high = bounds(model.free)
            names = [one.name for one in model.free]
            mean, at = places_of(rng, len(names))
            every = [
                measured(rng, f"site/{n}", model, one, Conditions(rate_hz=100.0)) for n, one in enumerate(at, start=1)
            ]
            write_cohort(folder / "cohort", every)
            results = [inferred(folder, seed) for seed in SEEDS]
        of_population = low + (high - low) * mean
        truth = low + (high - low) * at
        best = student.ppf(0.975, SPECIMENS - 1) * truth[:, names.index(OF)].std(ddof=1) / np.sqrt(SPECIMENS)
        for result, seconds in results:
            ends = result["sites"]["site"]["population"]
            means = sum(
                ends[name]["low"] <= true <= ends[name]["high"] for name, true in zip(names, of_population, strict=True)
            )
            own = [result["specimens"][f"site/{n + 1}"][name] for n in range(SPECIMENS) for name in names]
            inside = sum(one["low"] <= true <= one["high"] for one, true in zip(own, truth.ravel(), strict=True))
            held += [inside, len(own)]
            print(
                f"  cohort {number}: {seconds:.0f} s, smallest effective sample size of the population "
                f"{min(one['ess'] for one in ends.values()):.0f}, largest R-hat "
                f"{max(one['rhat'] for one in ends.values()):.3f}; {inside} of {len(own)} values of specimens and "
                f"{means} of {len(names)} population means in their intervals; interval of the mean of {OF} / "
                f"Student's of the true values {(ends[OF]['high'] - ends[OF]['low']) / 2.0 / best:.2f}",
                flush=True,
            )
        of_specimens, of_means = apart(*(result for result, _ in results))
        print(f"  two seeds: means differ by {of_specimens:.3f} sd (specimens) and {of_means:.3f} (population) at most")
    print(
        f"  in all, {held[0]} of {held[1]} values of specimens in their 95 % intervals: {100 * held[0] / held[1]:.1f} %"
    )
