"""Memory of the client and the scheduler (one process on a local cluster) as the number of rows grows.

Peaks of the whole process, from drawing the parameters over planning to the last commit.
"""

import multiprocessing
import resource
import shutil
import tempfile
from pathlib import Path

from sinew.runner.cluster.client import open_client
from sinew.runner.cluster.local import Local
from sinew.runner.evaluation.ensemble import evaluate
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.store import Store
from tests.benchmarks.common import evaluation, rows

SIZES = (2_000, 20_000, 200_000)


def peak(count: int, queue: "multiprocessing.Queue") -> None:
    work = evaluation()
    folder = Path(tempfile.mkdtemp())
    with open_client(Local(2)) as client, Store.writing(folder, "benchmark") as store:
        policy = Policy(multiple=work.simulator.capabilities.batch_multiple)
        table = store.table(work.table())
        evaluate(lambda: client, table, work, table.plan(rows(count)), policy=policy)
    shutil.rmtree(folder)
    queue.put(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main() -> None:
    context = multiprocessing.get_context("spawn")
    found = []
    for count in SIZES:
        queue = context.Queue()
        process = context.Process(target=peak, args=(count, queue))
        process.start()
        found.append(queue.get())
        process.join()
        print(
            f"  {count:,} rows: peak {found[-1]:.0f} MB, of which the parameters themselves {count * 16 * 8 / 1e6:.1f}"
        )
    print(f"  growth from {SIZES[0]:,} to {SIZES[-1]:,} rows: {found[-1] - found[0]:.0f} MB")
