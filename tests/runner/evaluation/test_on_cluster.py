"""What a run asks of a cluster, and what it makes of workers that die, leave or never come."""

import threading
import time

import numpy as np
import pytest
from distributed import CancelledError
from distributed.comm.core import CommClosedError

from sinew.runner.cluster import drain
from sinew.runner.errors import ClusterError, StoreError, WalltimeReached
from sinew.runner.evaluation import on_cluster
from sinew.runner.evaluation.adaptive import AdaptiveRun, RunClosed
from sinew.runner.evaluation.batch import evaluations, run_batch
from sinew.runner.evaluation.ensemble import evaluate, run_adaptive
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.store import Store
from tests.runner.evaluation.stand_in_client import Completed, StandIn
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import some

LOST = "the cluster was lost; run the same command again, finished rows are kept"


@pytest.fixture
def table(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        yield store.table(table_spec())
    assert evaluations == {}, "the plugin left nothing behind"


def run(stand_in: StandIn, table, count: int = 6, policy: Policy | None = None, report=None) -> np.ndarray:
    rows = table.plan(some(count))
    evaluate(lambda: stand_in, table, Quick(), rows, report, policy or Policy(batches_per_worker=1))
    return rows


def asks(parameters, **more):
    return lambda session: [float(one.values["force"][0]) for one in session.ask_all(parameters)]


def test_rows_come_back_and_nothing_is_left_on_the_cluster(stand_in, table):
    rows = run(stand_in, table)
    assert not table.status[rows].any()
    assert np.array_equal(table.read("force", rows)[:, 0], some(6)[:, 1])
    assert stand_in.plugins == {drain.Leave.name: stand_in.plugins[drain.Leave.name]}
    assert stand_in.topics == {}
    assert all(future.released for future in stand_in.futures)
    assert stand_in.cancelled == []
    assert stand_in.patience == "5 s", "a worker that has just died is not waited for at the end"
    assert stand_in.cluster.wanted[0] == 6, "as many workers as there are rows"
    assert stand_in.cluster.wanted[-1] == 0, "nobody is needed any more"


def test_workers_have_as_many_batches_as_they_may(stand_in, table):
    run(stand_in, table, 5, Policy(batches_per_worker=2))
    assert stand_in.messages[0] == [[0], [1], [2], [3]]
    assert stand_in.messages[1][0][0] == 4


def test_a_cluster_without_workers_at_the_moment_gets_a_batch(stand_in, table):
    stand_in.slots = 0
    run(stand_in, table, 2)
    assert stand_in.messages[0] == [[0]]


def test_many_batches_go_out_in_messages_of_64(stand_in, table):
    stand_in.slots = 100
    run(stand_in, table, 80)
    assert [len(message) for message in stand_in.messages] == [64, 16]


def test_batches_in_multiples_need_fewer_workers(stand_in, table):
    run(stand_in, table, 6, Policy(multiple=4))
    assert stand_in.cluster.wanted[0] == 2


def test_progress_is_reported_with_what_runs(stand_in, table):
    said = []
    run(stand_in, table, 6, report=lambda *numbers: said.append(numbers))
    assert said[-1][:2] == (6, 0)
    assert [done for done, *_ in said] == sorted(done for done, *_ in said)


def test_chunks_are_committed_while_workers_have_others(stand_in, tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    monkeypatch.setattr("sinew.runner.store.table.FOLD_CHUNKS", 1)
    with Store.writing(tmp_path, "study") as store:
        table, committed = store.table(table_spec()), set()
        run(stand_in, table, 96, Policy(multiple=16, batches_per_worker=1), lambda *_: committed.add(table.finished()))
    assert committed & {16, 32, 48, 64, 80}


def test_a_batch_whose_workers_die_is_tried_row_by_row_apart(stand_in, table):
    stand_in.kills = {2: 1}
    rows = run(stand_in, table, 6, Policy(multiple=3))
    assert not table.status[rows].any()
    assert [(row, apart) for row, apart, _ in stand_in.apart] == [(0, 1), (1, 1), (2, 1)]


def test_what_a_dead_worker_finished_counts(stand_in, table):
    """It wrote the segment, and died before it could say so."""
    stand_in.kills = {0: 1}
    sent = stand_in._sent

    def finished_and_died(batch):
        future = sent(batch)
        if future.error is not None:
            run_batch(batch)
        return future

    stand_in._sent = finished_and_died
    rows = run(stand_in, table, 2)
    assert not table.status[rows].any()
    assert stand_in.apart == []


def test_a_row_that_is_always_killed_is_given_up_and_the_others_are_kept(stand_in, table):
    stand_in.kills = {2: 99}
    with pytest.raises(ClusterError) as error:
        run(stand_in, table)
    assert str(error.value) == (
        "1 rows have no outcome (row 2): every worker that took one was killed, though the row did not kill its own "
        "process; do workers have enough memory? Run again to try once more, all other rows are kept"
    )
    assert [apart for row, apart, _ in stand_in.apart if row == 2] == [1, 2, 3]
    assert table.waiting() == 5, "they are in the journal"
    assert stand_in.cluster.wanted[-1] == 0


def test_of_many_rows_that_are_given_up_five_are_named(stand_in, table):
    stand_in.kills = dict.fromkeys(range(6), 99)
    with pytest.raises(ClusterError, match=r"^6 rows have no outcome \(row 0, 1, 2, 3, 4, \.\.\.\): every"):
        run(stand_in, table)
    stand_in.kills = dict.fromkeys(range(5), 99)
    with pytest.raises(ClusterError, match=r"^5 rows have no outcome \(row 0, 1, 2, 3, 4\): every"):
        run(stand_in, table)


def test_an_adaptive_run_cannot_go_on_without_a_row(stand_in, table):
    stand_in.kills = {1: 99}
    with pytest.raises(ClusterError) as error:
        run_adaptive(lambda: stand_in, [AdaptiveRun([(table, Quick())], 3, asks(some(3)))])
    assert str(error.value) == (
        "row 1 has no outcome: every worker that took it was killed, though the row did not kill its own process; do "
        "workers have enough memory? Run again, all other rows are kept"
    )


@pytest.mark.parametrize("lost", [CancelledError("gone"), CommClosedError("closed")])
def test_a_cluster_that_is_lost_is_one_clear_line(stand_in, table, lost):
    stand_in.dying = [lost]
    with pytest.raises(ClusterError) as error:
        run(stand_in, table)
    assert str(error.value) == LOST


def test_an_error_of_the_disk_names_the_journal(stand_in, table):
    stand_in.dying = [OSError(28, "No space left on device")]
    with pytest.raises(StoreError, match=f"^{table.journal}: no space left on the disk"):
        run(stand_in, table)
    assert len(stand_in.cancelled) == 1, "what still runs is not waited for"


@pytest.mark.parametrize(("errors", "goes_on"), [(4, True), (5, False)])
def test_workers_that_do_not_answer_are_asked_five_times(stand_in, table, errors, goes_on):
    stand_in.meeting = [ValueError("no"), OSError("closed")] * 2 + [OSError("at last")] * (errors - 4)
    if goes_on:
        run(stand_in, table)
        return
    with pytest.raises(ClusterError) as error:
        run(stand_in, table)
    assert str(error.value) == "the cluster's workers do not answer (at last); run the same command again"


def test_jobs_that_do_not_start_are_reported_while_it_waits(stand_in, table):
    waited = []

    def fails(n_workers, timeout):
        waited.append(timeout)
        stand_in.cluster.failure = ClusterError("the jobs end at once")
        raise TimeoutError

    stand_in.wait_for_workers = fails
    with pytest.raises(ClusterError, match="the jobs end at once"):
        run(stand_in, table)
    assert len(waited) == 1
    assert stand_in.cluster.wanted == [6, 6]


# ---- walltimes


def test_a_batch_that_cannot_end_in_time_is_not_begun(stand_in, table, monkeypatch):
    """The first batch tells that a row takes long; its deadline is in 30 s, of which closing takes 10."""
    monkeypatch.setattr("sinew.runner.evaluation.batch_sizes.BatchSizes.expected_s", lambda self, rows: 25.0)
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 30))
    monkeypatch.setenv(drain.WALLTIME, "100")
    with pytest.raises(WalltimeReached) as error:
        run(stand_in, table)
    assert str(error.value) == (
        "the walltime is near: 0 of 6 rows are finished and kept; run the same command again to go on"
    )
    assert not error.value.worked, "it had workers for less than a quarter of its walltime"
    assert stand_in.messages == []
    evaluations.clear()  # the workers end with the run


def test_a_walltime_that_ends_while_it_waits_for_workers_ends_the_run(stand_in, table, monkeypatch):
    monkeypatch.setenv(drain.WALLTIME, "0")

    def never(n_workers, timeout):
        monkeypatch.setenv(drain.DEADLINE, str(time.time() + 9))
        raise TimeoutError

    stand_in.wait_for_workers = never
    with pytest.raises(WalltimeReached) as error:
        run(stand_in, table)
    assert not error.value.worked, "it had no workers"


def test_a_run_that_had_workers_for_long_has_worked(stand_in, table, monkeypatch):
    monkeypatch.setattr("sinew.runner.evaluation.batch_sizes.BatchSizes.expected_s", lambda self, rows: 25.0)
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 30))
    monkeypatch.setenv(drain.WALLTIME, "0")
    with pytest.raises(WalltimeReached) as error:
        run(stand_in, table)
    assert error.value.worked
    evaluations.clear()  # the workers end with the run


def test_workers_whose_walltime_is_too_short_are_reported(stand_in, table, monkeypatch):
    """A worker says so while the run waits for its batch."""

    class Late(Completed):
        def has_ready(self):
            return bool(said) and super().has_ready()

        def update(self, futures):
            super().update(futures)
            stand_in.topics[drain.TOO_SHORT](("time", {"walltime_s": 60.0, "needed_s": 90.0}))

    said: list[str] = []
    monkeypatch.setattr(on_cluster, "as_completed", Late)
    with pytest.raises(ClusterError) as error:
        run(stand_in, table, 6, Policy(multiple=2))
    assert str(error.value) == (
        "the workers' walltime of 60 s is too short: one evaluation takes at least 45 s; ask for more time, finished "
        "rows are kept"
    )


def test_rows_that_are_tried_apart_say_how_long_one_takes(stand_in, table, monkeypatch):
    monkeypatch.setattr("sinew.runner.evaluation.batch_sizes.BatchSizes.expected_s", lambda self, rows: 0.5 * rows)
    stand_in.kills = {1: 1}
    run(stand_in, table, 3, Policy(multiple=3))
    assert {expected for _, _, expected in stand_in.apart} == {0.5}


class Hesitant(Completed):
    """Nothing is ready at the first look."""

    looked = False

    def has_ready(self):
        if self.ready and not self.looked:
            self.looked = True
            return False
        return super().has_ready()


def test_while_it_waits_a_run_says_what_it_could_use_and_what_runs(stand_in, table, monkeypatch):
    monkeypatch.setattr(on_cluster, "as_completed", Hesitant)
    said = []
    run(stand_in, table, 7, report=lambda *numbers: said.append(numbers))
    assert said[0] == (0, 0, 2)
    assert stand_in.cluster.wanted[1] == 7, "five rows wait, and two are with workers"


@pytest.mark.parametrize("error", [OSError("closed"), ValueError("not idle"), CancelledError("gone")])
def test_a_cluster_that_is_gone_at_the_end_hides_no_error(stand_in, table, error):
    def gone(futures):
        raise error

    stand_in.dying = [OSError(28, "No space left on device")]
    stand_in.cancel = gone
    with pytest.raises(StoreError, match="no space left on the disk"):
        run(stand_in, table)
    evaluations.clear()  # the plugin could not


def test_workers_that_close_at_the_end_hide_no_error(stand_in, table):
    """Of a cancelled study the workers end with the run: those that are closing have dropped the plugin already."""

    def closing(name):
        raise KeyError(name)

    stand_in.dying = [OSError(28, "No space left on device")]
    stand_in.unregister_worker_plugin = closing
    with pytest.raises(StoreError, match="no space left on the disk"):
        run(stand_in, table)
    assert stand_in.cluster.wanted[-1] == 0, "jobs that end now are not replaced"
    evaluations.clear()  # the plugin could not


@pytest.mark.parametrize("stop", [SystemExit(143), KeyboardInterrupt(), WalltimeReached("near")])
def test_a_run_that_is_stopped_waits_for_no_worker_job(stand_in, table, stop):
    """The worker jobs are ended with it; the batch system kills it when it takes long."""
    stand_in.dying = [stop]
    stand_in.unregister_worker_plugin = lambda name: pytest.fail("waits for workers")
    with pytest.raises(type(stop)):
        run(stand_in, table)
    assert stand_in.cluster.wanted[-1] == 0
    evaluations.clear()  # the workers are gone with it


def test_on_a_cluster_that_stays_a_run_that_is_stopped_leaves_nothing_behind(stand_in, table):
    stand_in.cluster = None
    stand_in.dying = [SystemExit(143)]
    with pytest.raises(SystemExit):
        run(stand_in, table)
    assert list(stand_in.plugins) == [drain.Leave.name]


def test_a_computation_under_way_is_closed_when_the_run_ends(stand_in, tmp_path, monkeypatch):
    class Never(Completed):
        def has_ready(self):
            return False

    sent, ends = threading.Event(), []

    def compute():
        sent.set()

    def computes(session):
        try:
            ends.append(session.compute(compute))
        except RunClosed as closed:
            ends.append(closed)

    def fails(session):
        sent.wait(10)
        raise LookupError("lost")

    monkeypatch.setattr(on_cluster, "as_completed", Never)
    with Store.writing(tmp_path, "study") as store, pytest.raises(LookupError):
        runs = [AdaptiveRun([(store.table(table_spec(n)), Quick())], 1, w) for n, w in (("a", computes), ("b", fails))]
        run_adaptive(lambda: stand_in, runs)
    assert [type(end) for end in ends] == [RunClosed]
    assert len(stand_in.cancelled) == 1
