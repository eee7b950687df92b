"""The state of a run: turns of its tables, what is ahead, walltimes, and errors of the disk."""

import errno
import logging
import queue
import time
from types import SimpleNamespace

import numpy as np
import pytest

from sinew.runner.cluster import drain
from sinew.runner.errors import StoreError
from sinew.runner.evaluation.batch import Batch, evaluations, run_batch
from sinew.runner.evaluation.counts import Counts
from sinew.runner.evaluation.policy import DEFAULT_POLICY, Policy
from sinew.runner.evaluation.run import Run, store_error
from sinew.runner.evaluation.sessions import Sessions
from sinew.runner.store.store import Store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import some


def new_run(total: int = 10, report=None, policy: Policy = DEFAULT_POLICY) -> Run:
    counts = Counts(report, total, 0)
    return Run(policy, counts, Sessions(counts))


@pytest.fixture
def tables(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        yield [store.table(table_spec(name)) for name in "abc"]
    evaluations.clear()


def test_a_table_gets_a_key_that_no_other_run_has(tables):
    one, other = new_run(policy=Policy(multiple=4)), new_run()
    source = one.add(tables[0], Quick())
    assert source.key == f"{tables[0].key}-{one.name}"
    assert one.name != other.name
    assert len(one.name) == 8
    assert tables[0].journal.is_dir()
    assert source.sizes.multiple == 4
    assert one.add(tables[0], Quick()).table is tables[0], "its journal may be there already"
    assert one.sources[0] is source


def test_tables_take_turns(tables):
    run = new_run(policy=Policy(retries=7))
    for table, count in zip(tables, (2, 0, 3), strict=True):
        run.add(table, Quick()).put(table.plan(some(count)))
    assert run.left == 5
    taken = [run.next_batch(100, 0) for _ in range(5)]
    assert [tables.index(source.table) for source, _ in taken] == [0, 2, 0, 2, 2]
    assert [batch.rows.tolist() for _, batch in taken] == [[0], [0], [1], [1], [2]]
    assert {batch.retries for _, batch in taken} == {7}
    assert run.left == 0


def test_complete_chunks_are_committed_only_when_they_are_many(tables, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.table.FOLD_CHUNKS", 2)
    run = new_run()
    for table, chunks in zip(tables, (1, 2, 2), strict=True):
        source = run.add(table, Quick())
        source.put(table.plan(some(chunks * table.chunk_rows)))
        evaluations[source.key] = source.evaluation
    run.sources[2].open = True
    while run.left:
        source, batch = run.next_batch(1, 0)
        run_batch(batch)
        run.note(source, batch)
    run.commit_many()
    assert [table.finished() for table in tables] == [0, len(tables[1]), 0], "an adaptive run commits when it ends"
    run.commit()
    assert [table.finished() for table in tables] == [len(table) for table in tables]


def test_the_size_of_a_batch_follows_from_all_tables(tables):
    run = new_run(policy=Policy(batch_s=0.2))
    for table in tables[:2]:
        source = run.add(table, Quick())
        source.put(table.plan(some(30)))
        source.sizes.largest = 1000
        source.sizes.measured(0.01)
    assert run.next_batch(1, 0)[1].rows.size == 20
    assert run.next_batch(4, 0)[1].rows.size == 10, "40 rows are left for four workers"


def test_finished_batches_are_counted_and_reported(tables):
    said = []
    run = new_run(report=lambda *numbers: said.append(numbers))
    parameters = some(4)
    parameters[1, 0] *= -1
    source = run.add(tables[0], Quick(bad="diverged"))
    source.put(tables[0].plan(parameters))
    evaluations[source.key] = source.evaluation
    for _ in range(2):
        batch = source.take(2, 0)
        run_batch(batch)
        run.note(source, batch)
    assert said == [(2, 1, 0), (4, 1, 0)]


def test_short_batches_wait_on_their_worker_and_long_ones_do_not(tables):
    run = new_run(policy=Policy(batches_per_worker=3))
    assert run.ahead() == 3
    sources = [run.add(table, Quick()) for table in tables[:2]]
    assert run.ahead() == 3, "nothing is known yet"
    sources[0].sizes.largest = 2
    sources[0].sizes.measured(1.9)
    assert run.ahead() == 3
    sources[1].sizes.largest = 2
    sources[1].sizes.measured(2.0)
    assert run.ahead() == 1, "2 rows x 2 s x 1.25 are five seconds"


def batch_of(seconds: float, tmp_path) -> Batch:
    batch = Batch("key", np.arange(3), some(3), tmp_path, 0)
    batch.expected_s = seconds
    return batch


def test_a_batch_ends_in_time_with_the_one_before_it(tmp_path, monkeypatch):
    run = new_run()
    assert run.in_time(batch_of(10.0**9, tmp_path)), "there is no walltime"
    monkeypatch.setattr(drain, "seconds_left", lambda: 30.0)
    assert run.in_time(batch_of(9.9, tmp_path))
    assert not run.in_time(batch_of(10.0, tmp_path)), "two batches and ten seconds to stop"
    monkeypatch.setattr(run, "ahead", lambda: 1)
    assert run.in_time(batch_of(19.9, tmp_path))


def test_a_walltime_is_said_with_what_is_finished():
    run = new_run(total=12_345)
    run.counts.done = 1_234
    assert str(run.walltime_reached()) == (
        "the walltime is near: 1,234 of 12,345 rows are finished and kept; run the same command again to go on"
    )
    run.sessions._states = {"one": "session"}
    assert "1,234 of at most 12,345 rows" in str(run.walltime_reached())


def test_a_run_has_worked_if_it_had_workers_for_a_quarter_of_its_walltime(monkeypatch):
    run = new_run()
    monkeypatch.setattr(time, "monotonic", lambda: run.began + 25.0)
    for walltime, worked in ((99.0, True), (100.0, False)):
        monkeypatch.setenv(drain.WALLTIME, str(walltime))
        assert run.walltime_reached().worked == worked
    run.had_workers = False
    monkeypatch.setenv(drain.WALLTIME, "8")
    assert not run.walltime_reached().worked


def test_an_error_of_the_disk_names_the_file_or_else_the_journal(tmp_path):
    batch = batch_of(1.0, tmp_path / "journal")
    named = OSError(errno.EACCES, "Permission denied", "/some/file")
    assert str(store_error(named, batch)) == "/some/file: Permission denied"
    assert str(store_error(OSError(errno.EIO, "broken"), batch)) == f"{tmp_path / 'journal'}: broken"


def test_without_anybody_to_report_to_nothing_is_reported():
    Counts(None, 1, 0).show()


def test_a_disk_that_cannot_keep_up_is_noted_in_the_log(tables, monkeypatch, caplog):
    run = new_run()
    for table in tables[:2]:
        run.add(table, Quick())
    synced = []

    def sync(table):
        synced.append(table)
        raise StoreError("no space left")

    monkeypatch.setattr(type(tables[0]), "sync", sync)
    with caplog.at_level(logging.WARNING, "sinew"):
        run.sync()
    assert synced == tables[:2], "the other tables are synced all the same"
    assert [(one.message, one.error) for one in caplog.records] == [("sync", "no space left")] * 2


@pytest.mark.parametrize("wait", [False, True])
def test_listening_waits_for_a_message_only_where_it_is_asked_to(monkeypatch, wait):
    sessions, waited = Sessions(Counts(None, 1, 0)), []

    def get(block, timeout):
        waited.append((block, timeout))
        raise queue.Empty

    monkeypatch.setattr(sessions, "inbox", SimpleNamespace(get=get))
    sessions.listen(None, **({"wait": True} if wait else {}))
    assert waited == [(wait, 0.2 if wait else None)]
