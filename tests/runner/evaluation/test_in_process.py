"""A run in this process: its end, its walltime, its errors, and what it leaves behind."""

import time

import numpy as np
import pytest

from sinew.runner.cluster import drain
from sinew.runner.errors import StoreError, WalltimeReached
from sinew.runner.evaluation.batch import evaluations
from sinew.runner.evaluation.ensemble import evaluate, failures
from sinew.runner.evaluation.policy import Policy
from sinew.runner.store.schema import STATUSES
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import some


@pytest.fixture
def table(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        yield store.table(table_spec())
    assert evaluations == {}, "no run leaves its evaluations behind"


def never():
    raise AssertionError("no cluster is needed")


def test_known_rows_need_no_cluster(table):
    rows = table.plan(some(5))
    evaluate(lambda: None, table, Quick(), rows)
    evaluate(never, table, Quick(bad="raise"), np.concatenate([rows, rows]))
    assert not table.status.any()


def test_rows_in_the_journal_are_known(table):
    rows = table.plan(some(5))
    evaluate(lambda: None, table, Quick(), rows[:3])
    table.plan(some(6))
    assert table.finished() == 3
    evaluate(lambda: None, table, Quick(), rows[3:])
    assert table.finished() == 5
    assert not table.segments()


def test_progress_begins_with_what_is_known_and_counts_equal_rows_once(table):
    parameters = some(8)
    parameters[[1, 6], 0] *= -1
    rows = table.plan(parameters)
    evaluate(lambda: None, table, Quick(bad="diverged"), rows[:3])
    said: list[tuple[int, ...]] = []
    asked = np.concatenate([rows, rows])
    evaluate(lambda: None, table, Quick(bad="diverged"), asked, lambda *numbers: said.append(numbers))
    assert said[0][0] > 3
    assert said[-1] == (8, 2, 0)
    assert failures(table, rows) == {"diverged": 2}


def test_chunks_are_committed_while_others_wait(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    monkeypatch.setattr("sinew.runner.store.table.FOLD_CHUNKS", 1)
    with Store.writing(tmp_path, "study") as store:
        table, committed = store.table(table_spec()), set()
        rows = table.plan(some(64))
        evaluate(lambda: None, table, Quick(), rows, lambda *_: committed.add(table.finished()), Policy(multiple=16))
    assert committed == {0, 16, 32, 48}


def test_failures_are_counted_by_status(table):
    rows = table.plan(some(6))
    evaluate(lambda: None, table, Quick(), rows)
    table.status[[0, 2, 3]] = [STATUSES.index(name) for name in ("timeout", "crashed", "timeout")]
    assert failures(table, rows) == {"timeout": 2, "crashed": 1}
    assert failures(table, [1, 2, 4]) == {"crashed": 1}
    assert failures(table, []) == {}


def test_a_policy_is_followed(table):
    parameters = some(6)
    parameters[0, 0] *= -1
    rows = table.plan(parameters)
    evaluate(lambda: None, table, Quick(bad="crashed"), rows, policy=Policy(retries=3))
    assert table.read("attempts", rows).tolist() == [4, 1, 1, 1, 1, 1]


def test_the_walltime_ends_a_run_before_a_batch_that_cannot_end(table, monkeypatch):
    monkeypatch.setattr(
        "sinew.runner.evaluation.batch_sizes.BatchSizes.expected_s",
        lambda self, rows: 100.0 if self.slowest else 0.0,
    )
    monkeypatch.setenv(drain.DEADLINE, str(time.time() + 60))
    rows = table.plan(some(5))
    with pytest.raises(WalltimeReached, match="the walltime is near: 1 of 5 rows are finished"):
        evaluate(lambda: None, table, Quick(), rows)
    assert table.waiting() == 1


class Alarming:
    """Quick, until the alarm of the deadline rings in the middle of a row."""

    def __init__(self, after: int) -> None:
        self.left = after

    def __call__(self, parameters):
        if self.left == 0:
            raise WalltimeReached("the alarm")
        self.left -= 1
        return Quick()(parameters)


def test_the_alarm_of_a_deadline_fails_no_row_and_is_said_with_what_is_finished(table):
    rows = table.plan(some(5))
    with pytest.raises(WalltimeReached, match="the walltime is near: 1 of 5 rows are finished"):
        evaluate(lambda: None, table, Alarming(after=1), rows)
    assert table.waiting() == 1
    assert table.finished() == 0


def test_errors_of_the_disk_stop_the_run(table):
    parameters = some(3)
    parameters[0, 0] *= -1
    rows = table.plan(parameters)
    with pytest.raises(StoreError, match=f"^{table.journal}: no space left on the disk"):
        evaluate(lambda: None, table, Quick(bad="disk"), rows)


@pytest.mark.parametrize("count", [1, 3])
def test_rows_that_have_no_outcome_in_the_end_are_an_error(table, monkeypatch, count):
    monkeypatch.setattr("sinew.runner.evaluation.ensemble.work_in_process", lambda run: None)
    with pytest.raises(StoreError) as error:
        evaluate(lambda: None, table, Quick(), table.plan(some(count)))
    words = f"{count} rows have no outcome although their batches ended; run again"
    assert str(error.value) == f"{table.journal}: {words}"


def test_finished_rows_are_brought_to_the_disk_while_others_are_evaluated(table, monkeypatch):
    finished = []
    monkeypatch.setattr(type(table), "sync", lambda one: finished.append(one.finished() + one.waiting()))
    policy = Policy(batch_s=0.05, sync_s=0.05)
    evaluate(lambda: None, table, Quick(seconds_per_row=0.05), table.plan(some(20)), policy=policy)
    assert finished[0] < 20
    assert len(finished) > 1
