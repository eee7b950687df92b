"""The sampler on the store against pyABC's own: one problem, evaluations that sleep for 0.1 s, 32 thread slots.

Efficiency is the time that the evaluations which decided who was accepted take on all slots, over the time it took.
"""

import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import dask
import numpy as np
import pyabc
from distributed import Client, LocalCluster

from runner.ensemble import Desk, Talk, converse
from runner.settings import SETTINGS
from runner.store import Store
from tasks.history import IN_MEMORY, close, keep
from tasks.priors import Alike, Normals
from tasks.sampler import Generation, StoredModel, StoreSampler
from tasks.stock_sampler import DirectModel, stock_sampler
from tasks.transitions import DefensiveNormal
from tests.benchmarks.common import median_line
from tests.tasks.analytic import NoisyMean

ROUNDS = 3
SLOTS, SECONDS = 32, 0.1
POPULATION, GENERATIONS, FIRST = 40, 8, 1.0
PENDING = 64


def described(values: dict[str, np.ndarray]) -> dict[str, float]:
    return {"y": float(values["y"])}


def same(values: np.ndarray) -> np.ndarray:
    return values


def distance(x: dict[str, float], observed: dict[str, float]) -> float:
    return abs(x["y"] - observed["y"])


def run(model: pyabc.Model, sampler: pyabc.sampler.Sampler, database: Path) -> None:
    prior = Normals(("mean",), np.zeros(1), np.ones(1), np.full(1, -1e6), np.full(1, 1e6))
    thresholds = pyabc.ListEpsilon([FIRST * 0.7**t for t in range(GENERATIONS)])  # the same for both
    abc = pyabc.ABCSMC(
        model, prior, distance, model_prior=Alike(1), transitions=DefensiveNormal(prior), population_size=POPULATION,
        eps=thresholds, sampler=sampler,
    )  # fmt: skip
    history = abc.new(IN_MEMORY, {"y": 0.7})
    abc.run(max_nr_populations=GENERATIONS)
    keep(history, database)
    close(history)


def ours(client: Client, evaluation: NoisyMean, folder: Path) -> list[Generation]:
    def work(desk: Desk) -> list[Generation]:
        sampler = StoreSampler(desk, (evaluation.salt,), PENDING)
        run(StoredModel("m", ["mean"], describe=described), sampler, folder / "ours.db")
        return sampler.generations

    with Store.writing(folder / "store", "benchmark") as store:
        return converse(lambda: client, [Talk([(store.table(evaluation.table()), evaluation)], 10_000, work)])[0]


def stock(client: Client, evaluation: NoisyMean, folder: Path, jobs_per_slot: int) -> list[Generation]:
    """``jobs_per_slot``: it asks for as many as there are slots, and can be told that there are more."""
    sampler = stock_sampler(client)
    if jobs_per_slot > 1:
        sampler.client_cores = lambda: jobs_per_slot * SLOTS
    run(DirectModel("m", ["mean"], evaluation, same, described), sampler, folder / "stock.db")
    return sampler.generations


def main() -> None:
    kinds: dict[str, Callable[[Client, NoisyMean, Path], list[Generation]]] = {
        "on the store": ours,
        "pyABC's": partial(stock, jobs_per_slot=1),
        "pyABC's, three jobs per slot": partial(stock, jobs_per_slot=3),
    }
    efficiency: dict[str, list[float]] = {name: [] for name in kinds}
    surplus: dict[str, list[float]] = {name: [] for name in kinds}
    # the stock sampler's keys of tasks say nothing of the run: results of one round must not serve the next
    for number in range(ROUNDS):
        for name, kind in kinds.items():
            with (
                dask.config.set(SETTINGS),
                LocalCluster(n_workers=4, threads_per_worker=SLOTS // 4, dashboard_address=None) as cluster,
                Client(cluster) as client,
                tempfile.TemporaryDirectory() as folder,
            ):
                client.wait_for_workers(4)
                started = time.perf_counter()
                generations = kind(client, NoisyMean(seconds=SECONDS, salt=number), Path(folder))
                taken = time.perf_counter() - started
            judged, asked = (sum(getattr(one, part) for one in generations) for part in ("judged", "asked"))
            efficiency[name].append(judged * SECONDS / SLOTS / taken)
            surplus[name].append(asked / judged - 1.0)
    print(f"  {SLOTS} slots, evaluations of {SECONDS:g} s, {GENERATIONS} generations of {POPULATION}, {ROUNDS} rounds")
    for name in kinds:
        median_line(f"{name}: efficiency", efficiency[name], "%", 100)
        median_line(f"{name}: superfluous evaluations", surplus[name], "%", 100)
