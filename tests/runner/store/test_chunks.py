"""Rows in several chunks: what is committed, reopened and read in each, and the array that an error names."""

import errno
from dataclasses import replace

import numpy as np
import pytest
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.store.schema import PENDING, STATUSES, Field
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from sinew.runner.store.table import Table
from tests.runner.evaluations import POINTS, Quick, table_spec
from tests.runner.stores import fill, some

ROWS = 40  # in chunks of 16
FAILED = [0, 3, 16, 35, 39]
DIVERGED = STATUSES.index("diverged")


@pytest.fixture(autouse=True)
def chunks_of_16(monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)


@pytest.fixture
def store(tmp_path):
    with Store.writing(tmp_path, "study") as opened:
        yield opened


def parameters() -> np.ndarray:
    found = some(ROWS)
    found[FAILED, 0] *= -1
    return found


def stored(store: Store) -> Table:
    """The table as another process reads it."""
    (table,) = open_store(store.folder).tables()
    return table


def outcomes(rows: list[int], value: float, status: int = 0, messages: tuple[str, ...] = ()) -> Segment:
    count = len(rows)
    numbers = {"objective": np.full((count, 1), value), "force": np.full((count, POINTS), value)}
    return Segment(
        np.array(rows), np.full(count, status, dtype=np.int8), np.ones(count, dtype=np.int16), np.ones(count),
        numbers, messages, "w",
    )  # fmt: skip


def test_only_failed_rows_are_reopened(store):
    table = store.table(table_spec())
    fill(table, parameters(), Quick(bad="diverged"))
    assert np.flatnonzero(table.status).tolist() == FAILED
    table.reopen(np.array([0, 3, 5, 16, 20, 35]))
    for each in (table, stored(store)):
        assert np.flatnonzero(each.status == PENDING).tolist() == [0, 3, 16, 35]
        assert np.flatnonzero(each.status > 0).tolist() == [39], "it was not asked for"
    assert np.isnan(table.read("objective", np.array([3]))).all()
    assert np.isfinite(table.read("objective", np.array([5]))).all(), "it has its outcome still"


def test_a_batch_may_lie_in_several_chunks(store):
    table = store.table(table_spec())
    rows = table.plan(some(ROWS))
    first, second = outcomes([1, 15, 16, 33], 1.0), outcomes([32, 31, 2, 16], 2.0)
    table.fold({store.folder / "first": first, store.folder / "second": second})
    for each in (table, stored(store)):
        done = np.flatnonzero(each.status == 0)
        assert done.tolist() == [1, 2, 15, 16, 31, 32, 33]
        assert each.read("force", done)[:, 3].tolist() == [1.0, 2.0, 1.0, 1.0, 2.0, 2.0, 1.0]
        assert each.read("wall_seconds", done).tolist() == [1.0] * 7
        assert np.isnan(each.read("objective", rows)[0]).all()


def test_segments_that_are_passed_are_not_read_again(store):
    table = store.table(table_spec())
    table.plan(some(3))
    broken = store.folder / "rows-1-00001.safetensors"
    broken.write_text("not a segment")
    table.fold({broken: outcomes([0], 1.0), store.folder / "is not there": outcomes([1], 1.0)})
    assert table.status.tolist() == [0, 0, PENDING]
    assert not broken.exists()


def test_later_batches_keep_what_stands_in_a_chunk(store):
    table = store.table(table_spec())
    rows = table.plan(some(ROWS))
    table.fold({store.folder / "a": outcomes([17, 18], 1.0, DIVERGED, ("one", "two"))})
    table.fold({store.folder / "b": outcomes([30, 19], 2.0)})
    assert table.read("message", rows[16:21]).tolist() == ["", "one", "two", "", ""]
    assert table.read("objective", rows[17:20])[:, 0].tolist() == [1.0, 1.0, 2.0]


def test_where_nothing_failed_there_are_no_files_of_messages(store):
    table = store.table(table_spec())
    fill(table, some(ROWS))
    files = store.path / table.group.path
    assert not list((files / "message").rglob("c/*"))
    assert len(list((files / "attempts").rglob("c/*"))) == 3


def test_a_failed_row_has_nothing_in_the_shape_of_its_field(store):
    table = store.table(table_spec())
    assert table.nothing("force").shape == (POINTS,)
    assert np.isnan(table.nothing("force")).all()
    assert table.nothing("objective").shape == (1,)


def test_a_table_opens_in_xarray(store):
    table = store.table(table_spec())
    fill(table, some(ROWS))
    dataset = table.dataset()
    assert dataset["force"].shape == (ROWS, POINTS)
    assert dataset["force"].attrs["units"] == "N"
    assert dataset["parameters"].dims == ("row", "parameter")


def full(*_args, **_kwargs):
    raise OSError(errno.ENOSPC, "No space left on device")


@pytest.mark.parametrize("array", ["objective", "attempts", "status"])
def test_a_disk_that_fills_up_in_a_commit_is_reported_with_the_array(store, monkeypatch, array):
    table = store.table(table_spec())
    table.plan(some(3))
    real = zarr.Array.__setitem__
    monkeypatch.setattr(
        zarr.Array, "__setitem__", lambda self, *args: (full if self.basename == array else real)(self, *args)
    )
    with pytest.raises(StoreError) as error:
        table.fold({store.folder / "a": outcomes([0], 1.0)})
    assert str(error.value).startswith(f"{store.path / table.group.path / array}: no space left on the disk; free some")
    assert table.status.tolist() == [PENDING] * 3


def test_what_fails_is_named(store, monkeypatch):
    table = store.table(table_spec())
    fill(table, parameters(), Quick(bad="diverged"))
    arrays = store.path / table.group.path
    with monkeypatch.context() as patched:
        patched.setattr(zarr.Array, "__setitem__", full)
        for array, work in (
            ("status", lambda: table.reopen(np.array([3]))),
            ("parameters", lambda: table.plan(some(1, seed=5))),
        ):
            with pytest.raises(StoreError) as error:
                work()
            assert str(error.value).startswith(f"{arrays / array}: no space")
    monkeypatch.setattr(zarr.Array, "__getitem__", full)
    for array, work in (
        ("force", lambda: table.read("force", np.array([1]))),
        ("status", lambda: Table(store.folder, table.group, writable=False)),
        ("parameters", lambda: table.parameters(np.array([1]))),
    ):
        with pytest.raises(StoreError) as error:
            work()
        assert str(error.value).startswith(f"{arrays / array}: no space")


def test_rows_in_the_arrays_and_rows_that_are_only_noted_have_parameters(store):
    table = store.table(table_spec())
    rows = table.plan(some(20))
    rows = np.concatenate([rows, table.plan(some(5, seed=1), settle=False), table.plan(some(3, seed=2), settle=False)])
    expected = np.concatenate([some(20), some(5, seed=1), some(3, seed=2)])
    assert table.settled == 20
    mixed = np.array([27, 3, 20, 19, 24, 25])
    assert np.array_equal(table.parameters(rows[mixed]), expected[mixed])
    assert table.settled == 20, "to ask for parameters enters nothing into the arrays"


def test_a_row_that_is_only_noted_has_no_outcome(store):
    table = store.table(table_spec())
    table.plan(some(1), settle=False)
    assert np.isnan(table.read("objective", np.array([0]))).all()


def test_a_field_may_have_two_axes(store):
    time, protocol = table_spec().coordinates[::-1]
    field = Field("both", ("time", "protocol"), "N", "force")
    two = replace(protocol, values=np.array(["pull", "hold"], dtype=object))
    table = store.table(replace(table_spec("both"), fields=(field,), coordinates=(two, time)))
    rows = table.plan(some(2))
    numbers = np.arange(2.0 * POINTS * 2).reshape(2, POINTS, 2)
    table.fold({store.folder / "a": replace(outcomes([0, 1], 1.0), values={"both": numbers})})
    assert np.array_equal(table.read("both", rows), numbers)
    assert np.array_equal(table.read("both", rows[::-1], slice(2, 5)), numbers[::-1, 2:5])


def test_a_table_that_xarray_cannot_open_is_named(store, monkeypatch):
    table = store.table(table_spec())
    monkeypatch.setattr("xarray.open_zarr", full)
    with pytest.raises(StoreError, match=f"^{store.path / table.group.path}: no space"):
        table.dataset()


def test_rows_that_are_planned_later_begin_in_the_middle_of_a_chunk(store):
    table = store.table(table_spec())
    parts = [some(5), some(40, seed=1), some(30, seed=2)]
    rows = np.concatenate([table.plan(part) for part in parts])
    assert rows.tolist() == list(range(75))
    assert np.array_equal(stored(store).parameters(rows), np.concatenate(parts))


@pytest.mark.parametrize("settle", [True, False])
def test_a_negative_zero_is_stored_as_zero(store, settle):
    table = store.table(table_spec())
    table.plan(np.array([[-0.0, 1.0]]), settle=settle)
    assert not np.signbit(table.parameters(np.array([0]))).any()
    table.settle()
    assert not np.signbit(stored(store).parameters(np.array([0]))).any()


def lose(store: Store, table: Table, chunk: int) -> None:
    """As a repair does with a damaged chunk of parameters."""
    for file in (store.path / table.group.path / "parameters" / "c" / str(chunk)).rglob("*"):
        file.unlink()


@pytest.mark.parametrize(
    ("chunks", "length", "found"),
    [([2], 32, range(32)), ([0], 40, range(16, 40)), ([0, 2], 32, range(16, 32)), ([1, 2], 16, range(16)),
     ([0, 1, 2], 0, [])],
)  # fmt: skip
def test_planned_rows_without_parameters_are_cut_off_at_the_end_and_forgotten_elsewhere(store, chunks, length, found):
    table = store.table(table_spec())
    table.plan(some(ROWS))
    for chunk in chunks:
        lose(store, table, chunk)
    (again,) = store.tables()
    assert len(again) == length
    assert np.flatnonzero(again.find(some(ROWS)) >= 0).tolist() == list(found)
    assert again.find(some(ROWS))[list(found)].tolist() == list(found)
    assert len(again.plan(some(ROWS))) == ROWS
    assert (again.find(some(ROWS)) >= 0).all()


def test_rows_with_an_outcome_and_without_parameters_are_damage(store):
    table = store.table(table_spec())
    fill(table, some(ROWS))
    lose(store, table, 1)
    with pytest.raises(StoreError) as error:
        store.tables()
    assert str(error.value) == (
        f"{store.path / table.group.path / 'parameters'}: parameters are missing for rows with an outcome; "
        f"`sinew repair {store.folder}` makes those rows pending"
    )


def test_two_parameter_sets_with_one_hash_are_reported_with_the_array(store, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.table.hash_rows", lambda p, _: np.ones(len(p), dtype=np.uint64))
    table = store.table(table_spec())
    table.plan(some(1))
    with pytest.raises(StoreError) as error:
        table.plan(some(1, seed=1))
    assert str(error.value) == (
        f"{store.path / table.group.path / 'parameters'}: two parameter sets share one hash; please report this"
    )


def test_each_table_has_a_journal_of_its_own(store):
    tables = [store.table(table_spec(name)) for name in "ab"]
    assert [table.key for table in tables] == [table_spec(name).key for name in "ab"]
    assert [table.journal for table in tables] == [store.folder / "journal" / table.key[:12] for table in tables]
    assert [table.title for table in tables] == ["specimen a", "specimen b"]
    assert tables[0].fields == ("objective", "force")


def test_who_only_reads_leaves_noted_rows_to_the_writer(store):
    table = store.table(table_spec())
    table.plan(some(3), settle=False)
    assert len(stored(store)) == 0
    assert (table.journal / "planned").is_file()
    (again,) = store.tables()
    assert len(again) == 3


def test_what_is_no_number_is_refused(store):
    with pytest.raises(ValueError, match=r"^parameters must be finite numbers$"):
        store.table(table_spec()).plan(np.array([[np.inf, 1.0]]))


@pytest.mark.parametrize("first", [0, 3])
def test_rows_of_a_batch_may_come_in_any_order(store, first):
    """Sessions of an adaptive run ask for rows as they need them, also for those that an earlier run had planned."""
    table = store.table(table_spec())
    table.plan(some(first + 4))
    table.journal.mkdir(parents=True)
    path = table.journal / "rows-000000003-00004.safetensors"
    rows = [first, first + 2, first + 1, first + 3]
    numbers = {"objective": np.array(rows, dtype=float)[:, None], "force": np.ones((4, POINTS))}
    replace(outcomes(rows, 0.0), values=numbers).write(path)
    table.fold(table.segments())
    assert table.read("objective", np.sort(rows))[:, 0].tolist() == sorted(rows)


def test_rows_that_were_never_planned_are_refused(store):
    table = store.table(table_spec())
    table.plan(some(8))
    table.journal.mkdir(parents=True)
    outcomes([7, 8], 1.0).write(table.journal / "rows-000000007-00002.safetensors")
    with pytest.raises(StoreError, match="rows that were never planned"):
        table.fold(table.segments())


def test_values_of_another_width_are_refused_and_repaired(store):
    """Zarr would repeat one value for all points."""
    table = store.table(table_spec())
    rows = table.plan(some(8))
    table.journal.mkdir(parents=True)
    path = table.journal / "rows-000000000-00008.safetensors"
    one = {"objective": np.ones((8, 1)), "force": np.ones((8, 1))}
    replace(outcomes(list(range(8)), 1.0), values=one).write(path)
    wrong = f"{path}: holds values of 'force' with another shape than those of its table"
    with pytest.raises(StoreError, match=f"^{wrong}; delete it"):
        table.fold(table.segments())
    (line,) = store.repair().removed
    assert line == f"{wrong}; it is removed, its rows are computed again"
    assert not path.exists()
    assert table.pending(rows).size == 8


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinite_outcomes_are_no_numbers(store, value):
    """No worker writes them: a row without finite numbers has failed."""
    table = store.table(table_spec())
    rows = table.plan(some(2))
    table.journal.mkdir(parents=True)
    outcomes([0, 1], value).write(table.journal / "rows-000000000-00002.safetensors")
    table.fold(table.segments())
    with pytest.raises(StoreError, match="2 rows with an outcome have no numbers"):
        table.read("force", rows)
    assert store.repair().rows == 2
