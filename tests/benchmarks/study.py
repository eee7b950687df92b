"""The 20,000-point study through Dask with two workers, store included, against the bare kernel on two cores."""

import multiprocessing
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from sinew.runner.cluster.client import open_client
from sinew.runner.cluster.local import Local
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.schema import CHUNK_ROWS
from sinew.runner.store.store import Store
from sinew.tasks.model import Model
from sinew.tasks.simulate.block import base_samples, block_of
from sinew.tasks.simulate.saltelli import saltelli
from tests.benchmarks.common import evaluation, median_line, rows

ROUNDS = 5


def bare(parameters: np.ndarray, begin: "multiprocessing.synchronize.Barrier", queue: "multiprocessing.Queue") -> None:
    """Evaluate in one process: no cluster, no store, the same batches."""
    work = evaluation()
    work(parameters[:CHUNK_ROWS])
    for _ in range(ROUNDS):
        begin.wait()
        started = time.perf_counter()
        for start in range(0, len(parameters), CHUNK_ROWS):
            work(parameters[start : start + CHUNK_ROWS])
        queue.put(time.perf_counter() - started)


def main() -> None:
    design = saltelli(Model(), base_samples(20_000, block_of(16, False)), False, 1).rows
    context = multiprocessing.get_context("spawn")
    queue, begin = context.Queue(), context.Barrier(3)
    halves = [context.Process(target=bare, args=(half, begin, queue)) for half in np.array_split(design, 2)]
    for process in halves:
        process.start()
    work = evaluation()
    policy = Policy(multiple=work.simulator.capabilities.batch_multiple)
    alone: list[float] = []
    through: list[float] = []
    with open_client(Local(2)) as client:
        for round_number in range(-1, ROUNDS):
            folder = Path(tempfile.mkdtemp())
            with Store.writing(folder, "benchmark") as store:
                table = store.table(work.table())
                parameters = rows(4 * CHUNK_ROWS) if round_number < 0 else design  # the first round only warms up
                started = time.perf_counter()
                evaluate(lambda: client, table, work, table.plan(parameters), policy=policy)
                taken = time.perf_counter() - started
            shutil.rmtree(folder)
            if round_number >= 0:
                through.append(taken)
                begin.wait()
                alone.append(max(queue.get(), queue.get()))
    for process in halves:
        process.join()
    print(f"  {len(design):,} rows, {ROUNDS} rounds in turn")
    kernel = median_line("bare kernel, two processes", alone, "s")
    study = median_line("through Dask into the store, two workers", through, "s")
    ratios = [a / b for a, b in zip(alone, through, strict=True)]
    print(f"  speed of the study / bare kernel: {kernel / study:.2f} (rounds: {min(ratios):.2f} to {max(ratios):.2f})")
    print(f"  {len(design) / study:,.0f} rows/s")
