"""The sampler on the store against pyABC's own: one problem, evaluations that sleep for 0.1 s, 32 thread slots.

Efficiency is the part of the slots' time in which they evaluate; superfluous are those evaluations that no decision
needed, told beside it. Both say nothing of how many proposals a sampler takes to the same thresholds, so the time of a
round is told, too. With 40 particles a sampler that asks for no more than it needs is bounded by the problem: by
simulation, one that costs nothing but 20 ms between two generations reaches 83 %, with 100 particles 93 %. Ours goes on
with proposals of which the next generation makes use. Several inferences at once, as `sinew infer` runs its sites, fill
each other's gaps; pyABC's cannot. One round of each sampler goes before and is not counted: pyABC's database takes
0.2 s to be ready in a process that has not used it.
"""

import logging
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import dask
import numpy as np
import psutil
import pyabc
from distributed import Client, LocalCluster

from sinew.runner.cluster.dask_settings import SETTINGS
from sinew.runner.evaluation.adaptive import AdaptiveRun, Session
from sinew.runner.evaluation.ensemble import run_adaptive
from sinew.runner.store.store import Store
from sinew.tasks.infer.abc.history import IN_MEMORY, close, keep
from sinew.tasks.infer.abc.pyabc_priors import Alike, Normals
from sinew.tasks.infer.abc.sampler import Generation, StoredModel, StoreSampler
from sinew.tasks.infer.abc.stock_sampler import DirectModel, stock_sampler
from sinew.tasks.infer.abc.transitions import DefensiveNormal
from tests.benchmarks.common import median_line
from tests.tasks.analytic import NoisyMean

ROUNDS = {40: 5, 100: 3, 300: 3}  # by number of particles
SLOTS, SECONDS = 32, 0.1
GENERATIONS, FIRST = 8, 1.0
PENDING = 4 * SLOTS


def described(values: dict[str, np.ndarray]) -> dict[str, float]:
    return {"y": float(values["y"])}


def same(values: np.ndarray) -> np.ndarray:
    return values


def distance(x: dict[str, float], observed: dict[str, float]) -> float:
    return abs(x["y"] - observed["y"])


def run(model: pyabc.Model, sampler: pyabc.sampler.Sampler, population: int, database: Path) -> None:
    prior = Normals(("mean",), np.zeros(1), np.ones(1), np.full(1, -1e6), np.full(1, 1e6))
    thresholds = pyabc.ListEpsilon([FIRST * 0.7**t for t in range(GENERATIONS)])  # the same for both
    abc = pyabc.ABCSMC(
        model, prior, distance, model_prior=Alike(1), transitions=DefensiveNormal(prior), population_size=population,
        eps=thresholds, sampler=sampler,
    )  # fmt: skip
    history = abc.new(IN_MEMORY, {"y": 0.7})
    abc.run(max_nr_populations=GENERATIONS)
    keep(history, database)
    close(history)


def ours(client: Client, evaluation: NoisyMean, population: int, folder: Path, at_once: int = 1) -> list[Generation]:
    def work(salt: int, session: Session) -> list[Generation]:
        sampler = StoreSampler(session, (salt,), PENDING)
        run(StoredModel("m", ["mean"], describe=described), sampler, population, folder / f"{salt}.db")
        return sampler.generations

    with Store.writing(folder / "store", "benchmark") as store:
        runs = []
        for site in range(at_once):
            own = replace(evaluation, salt=at_once * evaluation.salt + site)
            runs.append(AdaptiveRun([(store.table(own.table()), own)], 100_000, partial(work, own.salt)))
        return [generation for found in run_adaptive(lambda: client, runs) for generation in found]


def stock(
    client: Client, evaluation: NoisyMean, population: int, folder: Path, jobs_per_slot: int = 1
) -> list[Generation]:
    """``jobs_per_slot``: it asks for as many as there are slots, and can be told that there are more."""
    sampler = stock_sampler(client)
    if jobs_per_slot > 1:
        sampler.client_cores = lambda: jobs_per_slot * SLOTS
    run(DirectModel("m", ["mean"], evaluation, same, described), sampler, population, folder / "stock.db")
    return sampler.generations


KINDS: dict[str, Callable[[Client, NoisyMean, int, Path], list[Generation]]] = {
    "on the store": ours,
    "on the store, three at once": partial(ours, at_once=3),
    "pyABC's": stock,
    "pyABC's, three jobs per slot": partial(stock, jobs_per_slot=3),
}


BOTH = ("on the store", "pyABC's")
POPULATIONS = {40: tuple(KINDS), 100: BOTH, 300: BOTH}


def processor_s() -> float:
    """Processor time of this process and all below it."""
    times = [process.cpu_times() for process in psutil.Process().children(recursive=True)]
    return time.process_time() + sum(one.user + one.system for one in times)


@dataclass(frozen=True)
class Took:
    efficiency: float
    superfluous: float
    processor_s: float  # for a proposal that was judged
    seconds: float


def one_round(kind: str, population: int, number: int) -> Took:
    with (
        dask.config.set(SETTINGS),
        LocalCluster(n_workers=1, threads_per_worker=SLOTS, dashboard_address=None) as cluster,
        Client(cluster) as client,
        tempfile.TemporaryDirectory() as folder,
    ):
        client.wait_for_workers(1)
        # the stock sampler's keys of tasks say nothing of the run: results of one round must not serve the next
        evaluation = NoisyMean(seconds=SECONDS, salt=number)
        started, before = time.perf_counter(), processor_s()
        generations = KINDS[kind](client, evaluation, population, Path(folder))
        taken, processor = time.perf_counter() - started, processor_s() - before
    judged, asked = (sum(getattr(one, part) for one in generations) for part in ("judged", "asked"))
    return Took(asked * SECONDS / SLOTS / taken, asked / judged - 1.0, processor / judged, taken)


def main() -> None:
    logging.getLogger("ABC").setLevel(logging.WARNING)
    for kind in BOTH:
        one_round(kind, min(POPULATIONS), max(ROUNDS.values()))
    for population, kinds in POPULATIONS.items():
        rounds: dict[str, list[Took]] = {kind: [] for kind in kinds}
        for number in range(ROUNDS[population]):
            for kind, took in rounds.items():
                took.append(one_round(kind, population, number))
        words = f"  {SLOTS} slots, evaluations of {SECONDS:g} s, {GENERATIONS} generations of {population}"
        print(f"{words}, {ROUNDS[population]} rounds")
        for kind, took in rounds.items():
            median_line(f"{kind}: efficiency", [one.efficiency for one in took], "%", 100)
            median_line(f"{kind}: superfluous evaluations", [one.superfluous for one in took], "%", 100)
            median_line(f"{kind}: time of a round", [one.seconds for one in took], "s", 1)
            median_line(f"{kind}: processor time for a proposal", [one.processor_s for one in took], "ms", 1000)
