"""Rows are found by content, keep their order, and count once their status is committed."""

import contextlib
import dataclasses

import numpy as np
import pytest
import xarray as xr
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from sinew.runner.errors import StoreError
from sinew.runner.store.schema import CHUNK_ROWS, PENDING, STATUSES
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from sinew.runner.store.table import Table
from tests.runner.evaluations import POINTS, Quick, table_spec
from tests.runner.stores import contents, fill, some


def test_rows_come_back_in_the_order_of_asking(tmp_path):
    parameters = some(CHUNK_ROWS + 500)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, parameters)
        assert np.array_equal(rows, np.arange(len(parameters)))
        assert np.array_equal(table.parameters(rows[::-1]), parameters[::-1])
        assert np.allclose(table.read("objective", rows)[:, 0], parameters[:, 1] ** 2)
        assert np.array_equal(table.read("force", rows, slice(2, 4)), table.read("force", rows)[:, 2:4])


def test_known_rows_are_not_evaluated_again(tmp_path):
    notes = tmp_path / "notes"
    with Store.writing(tmp_path / "out", "study") as store:
        fill(store.table(table_spec()), some(50), Quick(notes))
    with Store.writing(tmp_path / "out", "study") as store:
        table = store.table(table_spec())
        both = np.concatenate([some(50), some(10, seed=1), some(50)])
        rows = fill(table, both, Quick(notes))
        assert len(table) == 60
        assert np.array_equal(rows, [*range(50), *range(50, 60), *range(50)])
    assert len(notes.read_text().splitlines()) == 60


def test_equal_rows_in_one_request_share_a_row(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert table.plan(np.array([[1.0, 2.0], [0.0, 1.0], [1.0, 2.0], [-0.0, 1.0]])).tolist() == [0, 1, 0, 1]


finite = st.floats(-1e6, 1e6, allow_subnormal=False)


@settings(max_examples=25, deadline=None)
@given(st.lists(st_numpy.arrays(float, st.tuples(st.integers(1, 12), st.just(2)), elements=finite), max_size=5))
def test_any_sequence_of_requests_keeps_one_row_for_each_content(tmp_path_factory, requests):
    known: dict[tuple[float, ...], int] = {}
    with Store.writing(tmp_path_factory.mktemp("store"), "study") as store:
        table = store.table(table_spec())
        for request in requests:
            for row, parameters in zip(fill(table, request), request, strict=True):
                assert known.setdefault(tuple(parameters + 0.0), int(row)) == row
        assert len(table) == len(known)
        again = Table(store.folder, table.group, writable=True)
        for parameters, row in known.items():
            assert again.find(np.array([parameters])).tolist() == [row]


def test_parameters_of_a_chunk_that_grows_are_read_anew(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        first = table.plan(some(20)[:5])
        assert np.array_equal(table.parameters(first[3:]), some(20)[3:5])
        rows = table.plan(some(20))
        assert np.array_equal(table.parameters(rows[4:8]), some(20)[4:8])
        assert np.array_equal(table.parameters(rows[::-1]), some(20)[::-1])
        table.parameters(rows[:2])[:] = 0.0
        assert np.array_equal(table.parameters(rows[:2]), some(20)[:2]), "what was given is a copy"


def test_numbers_that_are_not_finite_are_refused(tmp_path):
    with Store.writing(tmp_path, "study") as store, pytest.raises(ValueError, match="finite"):
        store.table(table_spec()).plan(np.array([[np.nan, 1.0]]))


def test_xarray_opens_it_with_names_and_units(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(10))
        name = table.name
    tree = xr.open_datatree(tmp_path / "store.zarr", engine="zarr", consolidated=False)
    data = tree[f"evaluations/{name}"].to_dataset()
    assert data["force"].dims == ("row", "time")
    assert data["force"].attrs["units"] == "N"
    assert list(data["parameter"].to_numpy()) == ["a", "b"]
    assert (data["status"] == 0).all()
    assert data["status"].attrs["flag_meanings"].split()[1:] == list(STATUSES)
    assert list(data["parameter_unit"].to_numpy()) == ["MPa", "s"]


@pytest.mark.parametrize("array", ["objective", "force", "attempts", "message", "status"])
def test_dying_in_a_commit_loses_nothing(tmp_path, monkeypatch, array):
    class Died(BaseException):
        pass

    real = zarr.Array.__setitem__

    def dying(self, selection, value):
        if self.basename == array:
            raise Died
        real(self, selection, value)

    first, second = some(30), some(20, seed=1)
    with Store.writing(tmp_path / "a", "study") as store:
        table = store.table(table_spec())
        fill(table, first)
        with monkeypatch.context() as patched:
            patched.setattr(zarr.Array, "__setitem__", dying)
            with pytest.raises(Died):
                fill(table, second)
    with Store.writing(tmp_path / "a", "study") as store:
        table = store.table(table_spec())
        assert (table.status[:30] == 0).all()
        assert (table.status[30:] == PENDING).all()
        assert table.segments()
        fill(table, second, Quick(bad="raise"))  # nothing left to evaluate
        assert not table.segments()
    with Store.writing(tmp_path / "b", "study") as store:
        table = store.table(table_spec())
        fill(table, first)
        fill(table, second)
    assert contents(tmp_path / "a" / "store.zarr") == contents(tmp_path / "b" / "store.zarr")


def test_dying_while_planning_loses_nothing(tmp_path, monkeypatch):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(30))
        with monkeypatch.context() as patched:
            patched.setattr(zarr.Array, "__setitem__", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
            with pytest.raises(KeyboardInterrupt):
                table.plan(some(20, seed=1))
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert len(table) == 30
        assert np.array_equal(fill(table, some(20, seed=1)), np.arange(30, 50))


@pytest.mark.parametrize("died_after", range(0, 60, 7))
def test_dying_while_a_table_is_created_or_planned_leaves_a_usable_store(tmp_path, monkeypatch, died_after):
    """Cut off after any number of files, as a kill would."""
    from zarr.storage import _local

    class Died(BaseException):
        pass

    real, left = _local._put, [died_after]

    def dying(*args, **kwargs):
        if left[0] == 0:
            raise Died
        left[0] -= 1
        return real(*args, **kwargs)

    with Store.writing(tmp_path / "a", "study") as store, monkeypatch.context() as patched:
        patched.setattr(_local, "_put", dying)
        with contextlib.suppress(Died):
            store.table(table_spec()).plan(some(CHUNK_ROWS + 50))
    for folder in ("a", "b"):
        with Store.writing(tmp_path / folder, "study") as store:
            rows = fill(store.table(table_spec()), some(CHUNK_ROWS + 50))
            assert np.array_equal(rows, np.arange(CHUNK_ROWS + 50))
    assert contents(tmp_path / "a" / "store.zarr") == contents(tmp_path / "b" / "store.zarr")


def test_equal_content_of_another_name_is_the_same_table(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        first = store.table(table_spec())
        fill(first, some(10))
        renamed = store.table(dataclasses.replace(table_spec(), title="another name"))
        assert renamed.group.path == first.group.path
        assert not renamed.pending(renamed.plan(some(10))).size


def test_a_row_that_succeeds_after_all_keeps_no_old_words(tmp_path):
    parameters = some(10)
    parameters[3, 0] *= -1
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, parameters, Quick(bad="diverged"))
        assert table.read("message", rows)[3] == "it broke"
        table.reopen(rows)
        fill(table, parameters)
        assert (table.read("message", rows) == "").all()


def test_no_old_words_stay_where_all_rows_of_a_chunk_had_failed(tmp_path):
    parameters = -some(10)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, parameters, Quick(bad="diverged"))
        assert (table.read("message", rows) == "it broke").all()
        table.reopen(rows)
        fill(table, parameters, lambda chosen: dataclasses.replace(Quick()(chosen), messages=()))
        assert (table.status[rows] == 0).all()
        assert (table.read("message", rows) == "").all()


def test_rows_that_were_noted_but_not_settled_are_planned_when_the_store_opens(tmp_path):
    for name, settle in (("noted", False), ("settled", True)):
        with Store.writing(tmp_path / name, "study") as store:
            table = store.table(table_spec())
            assert table.plan(some(5), settle=settle).tolist() == [0, 1, 2, 3, 4]
            assert table.plan(some(8)[::-1], settle=settle).tolist() == [5, 6, 7, 4, 3, 2, 1, 0]
            assert np.array_equal(table.parameters(np.array([7, 2, 5])), some(8)[[5, 2, 7]])
            assert table.settled == (8 if settle else 0)
        with Store.writing(tmp_path / name, "study") as store:
            table = store.table(table_spec())
            assert len(table) == table.settled == 8
            assert table.find(some(8)).tolist() == [0, 1, 2, 3, 4, 7, 6, 5]
            assert not (table.journal / "planned").exists()
    assert contents(tmp_path / "noted" / "store.zarr") == contents(tmp_path / "settled" / "store.zarr")


def outcomes(rows: list[int], value: float) -> Segment:
    """A segment whose numbers are all ``value``."""
    count = len(rows)
    return Segment(
        np.array(rows),
        np.zeros(count, dtype=np.int8),
        np.full(count, int(value), dtype=np.int16),
        np.full(count, value),
        {"objective": np.full((count, 1), value), "force": np.full((count, POINTS), value)},
        (),
        f"worker {value:g}",
    )


@pytest.mark.parametrize("together", [True, False])
def test_a_committed_row_stays_as_it_is(tmp_path, together):
    """Two workers may finish the same row; what counts is the outcome that was committed first."""
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(3))
        paths = [table.journal / f"rows-00000000{i}-0-00002.safetensors" for i in range(2)]
        table.journal.mkdir()
        outcomes([0, 1], 1.0).write(paths[0])
        outcomes([1, 2], 2.0).write(paths[1])
        for fold in [paths] if together else [paths[:1], paths[1:]]:
            table.fold(fold)
        assert not table.segments()
        assert table.read("objective", rows)[:, 0].tolist() == [1.0, 1.0, 2.0]
        assert table.read("force", rows)[:, -1].tolist() == [1.0, 1.0, 2.0]
        assert table.read("attempts", rows).tolist() == [1, 1, 2]
        assert table.read("worker", rows).tolist() == ["worker 1", "worker 1", "worker 2"]


def test_large_chunks_are_written_apart(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    monkeypatch.setattr("sinew.runner.store.table.CHUNK_BYTES", 2 * 16 * POINTS * 8)
    with Store.writing(tmp_path, "study") as store:
        assert store.table(table_spec()).fold_chunks == 2


@pytest.mark.parametrize(("most", "loaded"), [(2, 2**20), (8, 2**20), (8, 0)])
def test_chunks_written_together_have_the_bytes_of_chunks_written_apart(tmp_path, monkeypatch, most, loaded):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    monkeypatch.setattr("sinew.runner.store.table.LOADED_BYTES", loaded)
    batches = [range(16, 32), range(8), range(32, 60), range(100, 116), [9, 8, 70], range(12, 18)]
    found = []
    for together in (1, most):
        monkeypatch.setattr("sinew.runner.store.table.FOLD_CHUNKS", together)
        with Store.writing(tmp_path / str(together), "study") as store:
            table = store.table(table_spec())
            table.plan(some(120))
            table.journal.mkdir()
            paths = [table.journal / f"rows-00000000{i}-0-00002.safetensors" for i in range(len(batches))]
            for i, (rows, path) in enumerate(zip(batches, paths, strict=True)):
                outcomes(list(rows), float(i)).write(path)
            table.fold(paths[:4])
            table.fold(paths[4:])
            assert not table.segments()
            assert table.read("objective", np.array([5, 8, 9, 17, 59, 60, 70, 115]))[:, 0].tolist() == pytest.approx(
                [1.0, 4.0, 4.0, 0.0, 2.0, np.nan, 4.0, 3.0], nan_ok=True
            )
        found.append(contents(tmp_path / str(together) / "store.zarr"))
    assert found[0] == found[1]


def test_two_parameter_sets_with_one_hash_are_reported(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.table.hash_rows", lambda p, _: np.ones(len(p), dtype=np.uint64))
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.plan(some(1))
        with pytest.raises(StoreError, match="two parameter sets share one hash"):
            table.plan(some(1, seed=1))


def test_finished_rows_are_counted_before_and_after_they_are_folded_in(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(5))
        table.journal.mkdir()
        outcomes([1, 3], 1.0).write(table.journal / "rows-000000001-0-00002.safetensors")
        assert (table.finished(), table.waiting()) == (0, 2)
        table.fold(table.segments())
        assert (table.finished(), table.waiting()) == (2, 0)
        assert table.pending(rows[::-1]).tolist() == [0, 2, 4]


def test_a_table_knows_its_parameters_and_what_outcomes_depend_on(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec("quick"))
        fill(table, some(2))
    (read,) = open_store(tmp_path).tables()
    for one in (table, read):
        assert one.names == ["a", "b"]
        assert one.identity == {"evaluation": "quick"}
    assert read.coordinate("none of these") is None


@pytest.mark.parametrize("text", ["", "[", "null", "3", f'{{"a": "{"x" * 2**22}"}}'], ids=len)
def test_a_damaged_identity_is_one_line(tmp_path, text):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.group.attrs["identity"] = text
        with pytest.raises(StoreError, match=r"zarr\.json: "):
            _ = table.identity
