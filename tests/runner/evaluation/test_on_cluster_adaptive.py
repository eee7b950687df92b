"""Adaptive runs on a cluster."""

import pytest
from distributed import CancelledError, KilledWorker
from distributed.comm.core import CommClosedError

from sinew.runner.errors import ClusterError
from sinew.runner.evaluation.adaptive import AdaptiveRun, RunClosed
from sinew.runner.evaluation.batch import evaluations
from sinew.runner.evaluation.ensemble import run_adaptive
from sinew.runner.store.store import Store
from tests.runner.evaluation.test_on_cluster import LOST, asks, table
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import some

__all__ = ["table"]


def test_results_are_told_to_who_asked(stand_in, table):
    assert run_adaptive(lambda: stand_in, [AdaptiveRun([(table, Quick())], 5, asks(some(5)))]) == [
        some(5)[:, 1].tolist()
    ]
    assert stand_in.priorities == []
    assert not table.segments()


def test_computations_go_first_and_their_errors_come_back(stand_in, table):
    def work(session):
        total = session.compute(max, 3, 5)
        try:
            session.compute(int, "x")
        except ValueError as error:
            return total, str(error)

    (found,) = run_adaptive(lambda: stand_in, [AdaptiveRun([(table, Quick())], 0, work)])
    assert found == (5, "invalid literal for int() with base 10: 'x'")
    assert stand_in.priorities == [1, 1]
    assert all(future.released for future in stand_in.futures)


def test_a_cluster_that_is_lost_in_a_computation_ends_the_run(stand_in, table):
    def lost():
        raise CommClosedError("closed")

    with pytest.raises(ClusterError) as error:
        run_adaptive(lambda: stand_in, [AdaptiveRun([(table, Quick())], 0, lambda session: session.compute(lost))])
    assert str(error.value) == LOST


@pytest.mark.parametrize(("kills", "goes_on"), [(3, True), (4, False)])
def test_a_computation_whose_workers_are_killed_is_tried_three_times_more(stand_in, table, kills, goes_on):
    tried = []

    def computation():
        tried.append(1)
        if len(tried) <= kills:
            raise KilledWorker("computation", None, 3)
        return "done"

    adaptive = AdaptiveRun([(table, Quick())], 0, lambda session: session.compute(computation))
    if goes_on:
        assert run_adaptive(lambda: stand_in, [adaptive]) == ["done"]
    else:
        with pytest.raises(ClusterError, match="a computation has no result: every worker that took it was killed"):
            run_adaptive(lambda: stand_in, [adaptive])
    assert len(tried) == 4


def test_a_worker_is_wanted_for_each_adaptive_run(stand_in, tmp_path):
    with Store.writing(tmp_path, "study") as store:
        runs = [
            AdaptiveRun([(store.table(table_spec(name)), Quick())], 1, asks(some(1, seed=seed)))
            for seed, name in enumerate("abc")
        ]
        assert len(run_adaptive(lambda: stand_in, runs)) == 3
    assert stand_in.cluster.wanted[0] == 3
    assert evaluations == {}


def test_a_computation_that_comes_too_late_is_refused(stand_in, tmp_path):
    refused = []

    def fails(session):
        raise LookupError("lost")

    def computes(session):
        try:
            session.next()  # until the run ends
        finally:
            try:
                session.compute(max, 1, 2)
            except RunClosed:
                refused.append(True)

    with Store.writing(tmp_path, "study") as store, pytest.raises(LookupError):
        runs = [AdaptiveRun([(store.table(table_spec(n)), Quick())], 1, w) for n, w in (("a", computes), ("b", fails))]
        run_adaptive(lambda: stand_in, runs)
    assert refused == [True]


def test_a_computation_on_a_cluster_that_is_lost_is_closed(stand_in, table):
    ends = []

    def lost():
        raise CancelledError("gone")

    def computes(session):
        try:
            session.compute(lost)
        except RunClosed as closed:
            ends.append(closed)
            raise

    with pytest.raises(ClusterError):
        run_adaptive(lambda: stand_in, [AdaptiveRun([(table, Quick())], 0, computes)])
    assert len(ends) == 1
