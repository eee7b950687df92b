"""What the store promises: content addresses, commits that count last, damage with a name, and order."""

import contextlib
import dataclasses
import errno
import multiprocessing
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

import runner.store as store_module
from runner.ensemble import evaluate
from runner.errors import StoreError
from runner.store import CHUNK_ROWS, PENDING, STATUSES, Segment, Store, Table, open_store
from tests.runner.evaluations import Quick, table_spec


def fill(table: Table, parameters: np.ndarray, evaluation: Quick | None = None) -> np.ndarray:
    """Evaluate in this process."""
    rows = table.plan(parameters)
    evaluate(lambda: None, table, evaluation or Quick(), rows)
    return rows


def some(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((count, 2))


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a store except what differs between equal runs: when, where and how often rows were tried."""
    provenance = ("wall_seconds", "worker", "attempts")
    files = [file for file in sorted(folder.rglob("*")) if file.is_file()]
    return {str(f.relative_to(folder)): f.read_bytes() for f in files if not set(f.parts) & set(provenance)}


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
        again = Table(store, table.group)
        for parameters, row in known.items():
            assert again.find(np.array([parameters])).tolist() == [row]


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


def test_it_stays_a_few_files(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(100_000))
    assert len(contents(tmp_path)) < 5000


def test_wide_curves_get_chunks_of_fewer_rows():
    assert table_spec().chunk_rows == CHUNK_ROWS
    wide = table_spec(points=40_667).chunk_rows
    assert wide * 40_667 * 8 <= 2**25
    assert wide >= 16


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


def test_half_a_segment_is_named(tmp_path):
    path = tmp_path / "rows-000000000-00002.safetensors"
    one = np.zeros(1)
    values = {"y": np.zeros((1, 9))}
    Segment(np.array([0]), one.astype(np.int8), one.astype(np.int16), one, values, ("",), "w").write(path)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(StoreError, match=path.name):
        Segment.read(path)


@pytest.mark.parametrize("array", ["force", "objective", "status", "parameters", "wall_seconds"])
def test_a_truncated_chunk_is_named_and_repaired(tmp_path, array):
    parameters = some(CHUNK_ROWS + 100)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, parameters)
        whole = table.read("force", rows)
        chunk = next((store.path / table.group.path / array / "c").rglob("1*"))
        chunk = chunk if chunk.is_file() else next(f for f in chunk.rglob("*") if f.is_file())
    chunk.write_bytes(chunk.read_bytes()[:-7])
    with pytest.raises(StoreError, match=f"{array}.*damaged.*sinew repair"), Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.read(array, table.plan(parameters))
    with Store.writing(tmp_path, "study") as store:
        lost = store.repair()
        assert lost == 100
        table = store.table(table_spec())
        notes = tmp_path / "notes"
        rows = fill(table, parameters, Quick(notes))
        assert len(notes.read_text().splitlines()) == 100
        assert np.array_equal(table.read("force", rows), whole)


def test_a_store_of_another_study_is_refused(tmp_path):
    with Store.writing(tmp_path, "first"):
        pass
    expected = pytest.raises(StoreError, match=r"belongs to the study 'first', not to 'second'")
    with expected, Store.writing(tmp_path, "second"):
        pass


def test_a_foreign_or_newer_hierarchy_is_refused(tmp_path):
    zarr.open_group(tmp_path / "a" / "store.zarr", mode="w")
    with pytest.raises(StoreError, match="not a store of sinew"), Store.writing(tmp_path / "a", "study"):
        pass
    zarr.open_group(tmp_path / "b" / "store.zarr", mode="w", attributes={"sinew_format": 99, "study": "study"})
    with pytest.raises(StoreError, match="format 99"):
        open_store(tmp_path / "b")
    with pytest.raises(StoreError, match=r"holds no store\.zarr"):
        open_store(tmp_path / "c")


def _hold(folder: Path, opened: "multiprocessing.synchronize.Event", end: "multiprocessing.synchronize.Event") -> None:
    with Store.writing(folder, "study"):
        opened.set()
        end.wait(30)


def test_a_second_writer_is_refused_and_told_who_is_first(tmp_path):
    context = multiprocessing.get_context("spawn")
    opened, end = context.Event(), context.Event()
    process = context.Process(target=_hold, args=(tmp_path, opened, end))
    process.start()
    assert opened.wait(30)
    try:
        with pytest.raises(StoreError, match=f"in use by process {process.pid} on "), Store.writing(tmp_path, "study"):
            pass
    finally:
        process.kill()
        process.join(10)
    with Store.writing(tmp_path, "study"):  # the lock died with its holder
        pass


def test_a_full_disk_is_named_and_loses_nothing(tmp_path, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(30))
        with monkeypatch.context() as patched:
            patched.setattr("zarr.storage._local._put", full)
            with pytest.raises(StoreError, match="no space left on the disk"):
                fill(table, some(20, seed=1))
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert (table.status == 0).sum() == 30
        fill(table, some(20, seed=1))
        assert (table.status == 0).all()


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting a small disk needs root")
def test_a_disk_that_really_fills_up(tmp_path):
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(tmp_path)], check=True)
    try:
        with Store.writing(tmp_path / "out", "study") as store:
            table = store.table(table_spec(points=500))
            evaluation = Quick(points=500)
            fill(table, some(200), evaluation)
            with pytest.raises(StoreError, match="no space left on the disk"):
                fill(table, some(5000, seed=1), evaluation)
        (tmp_path / "out" / "lock").stat()
        subprocess.run(["mount", "-o", "remount,size=80m", str(tmp_path)], check=True)
        with Store.writing(tmp_path / "out", "study") as store:
            table = store.table(table_spec(points=500))
            assert (table.status[:200] == 0).all()
            rows = fill(table, some(5000, seed=1), evaluation)
            assert (table.status[rows] == 0).all()
    finally:
        subprocess.run(["umount", "-l", str(tmp_path)], check=True)


def test_results_stand_beside_the_evaluations(tmp_path):
    dataset = xr.Dataset({"S1": ("parameter", np.arange(2.0))}, {"parameter": np.array(["E_f", "alpha_f"])})
    with Store.writing(tmp_path, "study") as store:
        store.write_result("sobol", dataset)
        store.write_result("sobol", dataset + 1)
        read = store.read_result("sobol")
        assert read["S1"].to_numpy().tolist() == [1.0, 2.0]
        assert read["parameter"].to_numpy().tolist() == ["E_f", "alpha_f"]
        with pytest.raises(StoreError, match="no result 'nothing'"):
            store.read_result("nothing")


def test_the_key_names_the_content():
    assert table_spec("a").key == table_spec("a").key
    assert table_spec("a").key != table_spec("b").key
    assert store_module.FORMAT == 1


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


def test_who_looks_while_another_writes_sees_whole_tables(tmp_path):
    """Zarr writes a file under another name first, and makes folders before what is in them."""
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(3))
    tables = tmp_path / "store.zarr" / "evaluations"
    (tables / "zarr.0123.partial").write_text("{")
    (tables / "begun").mkdir()
    (tables / "begun" / "zarr.4567.partial").write_text("{")
    (table,) = open_store(tmp_path).tables()
    assert len(table) == 3


def test_a_missing_chunk_file_is_named_and_repaired(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, some(CHUNK_ROWS + 100))
        next((store.path / table.group.path / "objective" / "c").rglob("1*/0")).unlink()
        with pytest.raises(StoreError, match="objective: 100 rows with an outcome have no numbers; `sinew repair"):
            table.read("objective", rows)
        assert store.repair() == 100
        table = store.table(table_spec())
        rows = fill(table, some(CHUNK_ROWS + 100))
        assert np.isfinite(table.read("objective", rows)).all()


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


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "lock").symlink_to(tmp_path / "victim")
    with pytest.raises(StoreError, match="lock"), Store.writing(tmp_path / "out", "study"):
        pass
    assert (tmp_path / "victim").read_text() == "precious"


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


@pytest.mark.parametrize("harm", ["cut", "flip", "twice"])
def test_damaged_notes_of_planned_rows_end_the_plan_there(tmp_path, harm):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        table.plan(some(6), settle=False)
        notes = table.journal / "planned"
    whole = notes.read_bytes()
    size = len(whole) // 6
    if harm == "cut":
        notes.write_bytes(whole[: 3 * size + 5])
    elif harm == "flip":
        notes.write_bytes(whole[: 3 * size + 9] + bytes([whole[3 * size + 9] ^ 1]) + whole[3 * size + 10 :])
    else:
        notes.write_bytes(whole[: 3 * size] * 2)
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert len(table) == 3
        assert np.array_equal(table.parameters(np.arange(3)), some(3))
        assert table.plan(some(6), settle=False).tolist() == [0, 1, 2, 3, 4, 5]
