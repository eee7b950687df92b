"""What it costs that a loss of power loses nothing: the 20,000-point study with fsync and without, in turn."""

import os
import shutil
import tempfile
import time
from pathlib import Path

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

ROUNDS = 10


def main() -> None:
    design = saltelli(Model(), base_samples(20_000, block_of(16, False)), False, 1).rows
    work = evaluation()
    policy = Policy(multiple=work.simulator.capabilities.batch_multiple)
    taken: dict[bool, list[float]] = {True: [], False: []}
    fsync = os.fsync
    count = 0

    def counted(descriptor: int) -> None:
        nonlocal count
        count += 1
        fsync(descriptor)

    with open_client(Local(2)) as client:
        for number in range(-1, 2 * ROUNDS):
            synced = number % 4 in (0, 3)  # neither is always the first of its pair
            folder = Path(tempfile.mkdtemp())
            os.fsync = counted if synced else lambda _: None  # only this process synchronises
            try:
                started = time.perf_counter()
                with Store.writing(folder / "out", "benchmark") as store:
                    table = store.table(work.table())
                    parameters = rows(4 * CHUNK_ROWS) if number < 0 else design  # the first round only warms up
                    evaluate(lambda: client, table, work, table.plan(parameters), policy=policy)
                seconds = time.perf_counter() - started
            finally:
                os.fsync = fsync
            shutil.rmtree(folder)
            if number >= 0:
                taken[synced].append(seconds)
    print(f"  {len(design):,} rows, {ROUNDS} pairs of rounds in turn, {count / ROUNDS:.0f} calls of fsync in each")
    calm = median_line("without fsync", taken[False], "s")
    safe = median_line("with fsync", taken[True], "s")
    print(f"  cost: {100 * (safe / calm - 1):.1f} % of the time")
