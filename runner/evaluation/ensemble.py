"""Evaluate many rows of parameters in batches, retry rows that fail, and commit every outcome.

:func:`evaluate` takes rows that are known beforehand. :func:`run_adaptive` serves adaptive runs, which choose the next
rows from the results of earlier ones. Several adaptive runs share one cluster, so that it has work while one of them
decides.

| module | content |
|---|---|
| ``ensemble`` | the two calls |
| ``adaptive`` | what an adaptive run sees: its session and row results |
| ``policy``, ``batch_sizes`` | how rows are cut into batches |
| ``source``, ``sessions``, ``counts``, ``run`` | the state of a run: its tables, its adaptive runs, its progress |
| ``in_process``, ``on_cluster`` | the two ways to work |
| ``batch`` | what a worker does with a batch |
| ``isolation``, ``external`` | processes: one for a row that may be deadly, one for each solver |
"""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from distributed import Client
from threadpoolctl import threadpool_limits

from sinew.runner.errors import StoreError, WalltimeReached
from sinew.runner.evaluation.adaptive import AdaptiveRun
from sinew.runner.evaluation.batch import Evaluation
from sinew.runner.evaluation.counts import Counts
from sinew.runner.evaluation.in_process import work_in_process
from sinew.runner.evaluation.on_cluster import WorkOnCluster
from sinew.runner.evaluation.policy import DEFAULT_POLICY, Policy
from sinew.runner.evaluation.run import Run
from sinew.runner.evaluation.sessions import Sessions
from sinew.runner.periodic import every
from sinew.runner.progress import Report
from sinew.runner.store.schema import STATUSES, Array
from sinew.runner.store.table import Table


def evaluate(
    client: Callable[[], Client | None],
    table: Table,
    evaluation: Evaluation,
    rows: Array,
    report: Report | None = None,
    policy: Policy = DEFAULT_POLICY,
) -> None:
    """Make sure that ``rows`` ``[n]`` (numbers from ``Table.plan``) have committed outcomes.

    Known rows cost a look-up. ``client`` is called only when rows are pending; when it returns None, the work is done
    in this process. After an interruption of any kind, committed outcomes stay and the same call goes on from there.
    Raises ``StoreError`` when results cannot be written, ``ClusterError`` when the cluster is lost, and
    ``WalltimeReached`` when this process's own job must end; finished rows are kept in that case too.
    """
    table.fold(table.segments())
    asked = np.unique(rows)
    total, failed = int(asked.size), int((table.status[asked] > 0).sum())
    pending = table.pending(asked)
    del asked
    if pending.size:
        got = client()
        run = _new_run(policy, Counts(report, total, failed))
        run.add(table, evaluation).put(pending)
        run.counts.done = total - run.left
        _work(run, got)
        if (left := table.pending(rows).size) > 0:
            raise StoreError(f"{table.journal}: {left} rows have no outcome although their batches ended; run again")


def run_adaptive(
    client: Callable[[], Client | None],
    runs: Sequence[AdaptiveRun],
    report: Report | None = None,
    policy: Policy = DEFAULT_POLICY,
) -> list[Any]:
    """Run several adaptive runs on one cluster; returns what their ``work`` returned. Raises as :func:`evaluate`.

    Every requested row is planned in its table, in the order of asking, and committed. An adaptive run whose rows are
    all known costs look-ups only. Linear algebra uses one thread, on workers and in ``work``, so that results do not
    depend on the number of cores.
    """
    if not runs:
        return []
    for adaptive in runs:
        for table, _ in adaptive.tables:
            table.fold(table.segments())
    with threadpool_limits(1):
        got = client()
        run = _new_run(policy, Counts(report, sum(adaptive.rows for adaptive in runs), 0))

        def sources(adaptive: AdaptiveRun) -> list[Any]:
            return [run.add(table, evaluation) for table, evaluation in adaptive.tables]

        with run.sessions.running(runs, sources, here=got is None):
            _work(run, got)
        return run.sessions.results()


def _new_run(policy: Policy, counts: Counts) -> Run:
    return Run(policy, counts, Sessions(counts))


def _work(run: Run, client: Client | None) -> None:
    try:
        with every(run.policy.sync_s, run.sync, "sinew-sync"):
            if client is None:
                work_in_process(run)
            else:
                WorkOnCluster(run, client).work()
    except WalltimeReached:  # the deadline's alarm may come anywhere, and does not know whether workers came in time
        raise run.walltime_reached() from None
    finally:
        run.sync()


def failures(table: Table, rows: Iterable[int]) -> dict[str, int]:
    """The number of failed ``rows`` by status."""
    status = table.status[np.fromiter(rows, dtype=np.int64)]
    return {name: int((status == i).sum()) for i, name in enumerate(STATUSES) if i and (status == i).any()}
