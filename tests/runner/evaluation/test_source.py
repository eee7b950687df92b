"""The rows of one table on their way through a run."""

import numpy as np
import pytest

from sinew.runner.evaluation import source as source_module
from sinew.runner.evaluation.batch import evaluations, run_batch
from sinew.runner.evaluation.batch_sizes import BatchSizes
from sinew.runner.evaluation.source import Source
from sinew.runner.store.schema import PENDING, STATUSES
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store
from tests.runner.evaluations import POINTS, Quick, table_spec
from tests.runner.stores import fill, some


@pytest.fixture
def table(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    with Store.writing(tmp_path, "study") as store:
        opened = store.table(table_spec())
        opened.journal.mkdir(parents=True)
        yield opened


@pytest.fixture
def source(table):
    """Of a table with chunks of 16 rows; what it evaluates is done by :func:`finish`."""
    yield Source(table, Quick(), "key", BatchSizes(1))
    evaluations.clear()


def finish(source: Source, size: int, bad: str = "") -> int:
    """Take a batch, evaluate it in this process, and take in its outcome."""
    evaluations["key"] = Quick(bad=bad)
    batch = source.take(size, retries=0)
    run_batch(batch)
    return source.note(batch)


@pytest.mark.parametrize("restarts", [False, True])
def test_rows_that_go_on_where_they_were_interrupted_need_not_end_before_a_walltime(source, table, restarts):
    source.sizes.measured(100.0)
    if restarts:
        source.evaluation = type("Restarting", (Quick,), {"restarts": True})()
    source.put(table.plan(some(2)))
    batch = source.take(2, retries=0)
    assert batch.restarts == restarts
    assert [one.restarts for one in batch.rows_apart()] == [restarts] * 2
    assert (batch.expected_s == 0.0) == restarts


def test_batches_are_taken_in_order_and_never_beyond_a_chunk(source, table):
    source.put(table.plan(some(20)))
    assert source.left == 20
    first, second, third = (source.take(10, retries=3) for _ in range(3))
    assert [batch.rows.tolist() for batch in (first, second, third)] == [
        list(range(10)), list(range(10, 16)), list(range(16, 20)),
    ]  # fmt: skip
    assert source.left == 0
    assert np.array_equal(second.parameters, some(20)[10:16])
    assert (first.key, first.retries, first.segment.parent) == ("key", 3, table.journal)


def test_a_batch_ends_where_a_row_of_another_chunk_comes(source, table):
    table.plan(some(20))
    source.put(np.array([14, 15, 16, 3]))
    taken = [source.take(4, retries=0).rows.tolist() for _ in range(3)]
    assert taken == [[14, 15], [16], [3]]
    assert source.left == 0


def test_rows_may_be_added_while_others_are_taken(source, table):
    source.put(table.plan(some(4)))
    source.take(3, 0)
    source.put(table.plan(some(8))[4:])
    assert source.left == 5
    assert source.take(9, 0).rows.tolist() == [3, 4, 5, 6, 7]
    assert source.left_in_chunk == {0: 8}


def test_a_batch_says_how_long_it_may_take(source, table):
    source.put(table.plan(some(8)))
    assert source.take(2, 0).expected_s == 0.0
    source.sizes.measured(2.0)
    assert source.take(4, 0).expected_s == 10.0


def test_the_size_of_a_batch_is_limited_by_the_chunk_and_shared(source, table):
    source.put(table.plan(some(40)))
    source.sizes.measured(0.02)
    source.sizes.largest = 1000
    assert source.batch_size(1, 0.5, 40, 0) == 16
    assert source.batch_size(10, 0.5, 40, 0) == 4
    source.open = True
    assert source.batch_size(10, 0.5, 40, 40) == 4, "half of what waits and runs"
    source.sizes = BatchSizes(1, 1000)
    source.sizes.measured(0.05)
    source.waiting = set(range(8))
    assert source.batch_size(1, 0.5, 40, 0) == 4, "many wait"


def test_chunks_are_committed_together_once_they_are_complete(source, table):
    source.put(table.plan(some(60)))
    seen = []
    for _ in range(4):
        assert finish(source, 10) == 0
        source.commit(at_least=2)
        seen.append((table.finished(), table.waiting()))
    assert seen == [(0, 10), (0, 16), (0, 26), (32, 0)], "two chunks of 16 rows, the second in two batches"
    for _ in range(3):
        finish(source, 10)
        source.commit(at_least=2)
    assert (table.finished(), table.waiting(), len(source.finished)) == (32, 26, 2)
    finish(source, 10)
    source.commit(at_least=2)
    assert (table.finished(), table.waiting(), len(source.finished)) == (60, 0, 0)


def test_what_is_complete_at_the_end_is_committed_and_nothing_else(source, table):
    source.put(table.plan(some(40)))
    for _ in range(3):
        finish(source, 10)
    source.commit()
    assert (table.finished(), table.waiting()) == (16, 10)
    assert list(source.finished) == [1]
    assert len(source.sizes.slowest) == 3


def test_failed_rows_are_counted(source, table):
    parameters = some(4)
    parameters[[0, 2], 0] *= -1
    source.put(table.plan(parameters))
    assert finish(source, 4, "diverged") == 2


# ---- rows of adaptive runs


def test_known_rows_are_looked_up_and_new_ones_wait(source, table):
    fill(table, some(3))
    source.open = True
    assert source.ask(some(5)) == [0, 1, 2, 3, 4]
    assert sorted(source.results) == [0, 1, 2]
    assert source.results[1].status == 0
    a, b = some(5)[1]
    assert source.results[1].values["force"].tolist() == (a * np.arange(POINTS) + b).tolist()
    assert source.waiting == {3, 4}
    assert source.left == 2


def test_equal_rows_are_evaluated_once(source):
    source.open = True
    assert source.ask(some(2)[[0, 1, 0]]) == [0, 1, 0]
    assert source.ask(some(2)) == [0, 1]
    assert source.left == 2


def test_a_row_whose_result_is_there_is_not_evaluated_again(source):
    source.open = True
    source.ask(some(2))
    finish(source, 2)
    assert source.ask(some(2)) == [0, 1]
    assert (source.left, source.waiting) == (0, set())


def test_results_are_there_as_soon_as_a_batch_is_finished(source, table):
    source.open = True
    parameters = some(3)
    parameters[1, 0] *= -1
    source.ask(parameters)
    finish(source, 3, "diverged")
    assert source.waiting == set()
    assert [source.results[row].status for row in range(3)] == [0, STATUSES.index("diverged"), 0]
    assert np.isnan(source.results[1].values["force"]).all()
    assert source.results[2].values["objective"].tolist() == [pytest.approx(parameters[2, 1] ** 2)]
    assert table.finished() == 0, "more rows of this chunk may come"
    source.close()
    assert table.finished() == 3
    assert source.fresh == {}
    assert not source.open


def test_a_batch_that_failed_as_a_whole_has_nothing_in_the_shape_of_its_fields(source):
    source.open = True
    parameters = some(1)
    parameters[0, 0] *= -1
    source.ask(parameters)
    finish(source, 1, "raise")
    values = source.results[0].values
    assert values["force"].shape == (POINTS,)
    assert np.isnan(values["force"]).all()
    assert sorted(values) == ["force", "objective"]


def test_a_result_that_was_handed_out_is_found_again(source, table):
    """First in the segment, then in the chunk."""
    source.open = True
    source.ask(some(3))
    finish(source, 3)
    expected = source.results[2].values["force"].tolist()
    for _ in range(2):
        source.results.clear()
        assert source.ask(some(3)[2:]) == [2]
        assert list(source.results) == [2]
        assert source.results[2].values["force"].tolist() == expected
        assert source.left == 0
        source.close()
        source.open = True


def test_rows_of_other_chunks_and_rows_that_came_later_are_read_back(source, table):
    parameters = some(36)
    fill(table, parameters[:18])
    source.open = True
    for rows in ([17, 1], [3], [16]):
        source.results.clear()
        assert source.ask(parameters[rows]) == rows
        for row in rows:
            assert source.results[row].values["objective"][0] == pytest.approx(parameters[row, 1] ** 2)
    fill(table, parameters[18:20])
    source.results.clear()
    source.ask(parameters[[19]])
    assert source.results[19].values["objective"][0] == pytest.approx(parameters[19, 1] ** 2)


def test_a_row_that_was_committed_after_its_chunk_was_read_is_read_again(source, table):
    parameters = some(4)
    table.plan(parameters)
    fill(table, parameters[:1])
    source.open = True
    source.ask(parameters[:1])
    fill(table, parameters[3:])
    assert source.ask(parameters[3:]) == [3]
    assert source.results[3].status == 0
    assert source.results[3].values["objective"][0] == pytest.approx(parameters[3, 1] ** 2)
    assert table.status[1] == PENDING


def test_many_segments_of_a_chunk_are_folded_now_and_then(source, table, monkeypatch):
    monkeypatch.setattr(source_module, "SEGMENTS_KEPT", 3)
    source.open = True
    source.ask(some(7))
    left = []
    for _ in range(7):
        finish(source, 1)
        left.append(table.waiting())
    assert left == [1, 2, 0, 1, 2, 0, 1]
    assert sorted(source.fresh) == [6]
    source.close()
    assert table.finished() == 7


def test_what_is_not_complete_at_the_end_stays_in_the_journal(source, table):
    source.open = True
    source.ask(some(20))
    finish(source, 10)
    finish(source, 10)
    finish(source, 2)
    source.close()
    assert (table.finished(), table.waiting()) == (16, 2)
    assert sorted(source.fresh) == [16, 17]


def test_a_segment_is_read_at_once_only_for_those_who_wait(source, table, monkeypatch):
    asked = []
    real = Segment.read
    monkeypatch.setattr(Segment, "read", lambda path, whole=False: asked.append(whole) or real(path, whole=whole))
    source.put(table.plan(some(2)))
    finish(source, 2)
    source.open = True
    source.ask(some(2) + 1.0)
    finish(source, 2)
    assert asked == [False, True]
