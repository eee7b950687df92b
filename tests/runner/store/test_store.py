"""The hierarchy of a result folder: its study, its tables, its results, and disks that fill up."""

import errno
import json
import os
import pickle
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.store.store import Store, open_store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import contents, fill, some
from tests.small_disk import may_mount, small_disk


def test_it_stays_a_few_files(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(100_000))
    assert len(contents(tmp_path)) < 5000


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


def test_a_full_disk_is_named_and_loses_nothing(tmp_path, monkeypatch):
    def full(*_args, **_kwargs):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(30))
        with monkeypatch.context() as patched:
            patched.setattr("sinew.runner.store.durable.write_whole", full)
            with pytest.raises(StoreError, match="no space left on the disk"):
                fill(table, some(20, seed=1))
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        assert (table.status == 0).sum() == 30
        fill(table, some(20, seed=1))
        assert (table.status == 0).all()


@may_mount
def test_a_disk_that_really_fills_up():
    with small_disk(megabytes=3) as disk:
        with Store.writing(disk / "out", "study") as store:
            table = store.table(table_spec(points=500))
            evaluation = Quick(points=500)
            fill(table, some(200), evaluation)
            with pytest.raises(StoreError, match="no space left on the disk"):
                fill(table, some(5000, seed=1), evaluation)
        (disk / "out" / "lock").stat()
        subprocess.run(["mount", "-o", "remount,size=80m", disk], check=True)
        with Store.writing(disk / "out", "study") as store:
            table = store.table(table_spec(points=500))
            assert (table.status[:200] == 0).all()
            rows = fill(table, some(5000, seed=1), evaluation)
            assert (table.status[rows] == 0).all()


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
        assert store.read_result("sobol", parameter=["E_f", "alpha_f"]).identical(read)
        for names in (["alpha_f", "E_f"], ["E_f"]):
            with pytest.raises(StoreError, match="its coordinate parameter is not that of the result"):
                store.read_result("sobol", parameter=names)
        with pytest.raises(StoreError, match="its coordinate specimen is not that of the result"):
            store.read_result("sobol", specimen=["a"])


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


def test_what_stands_in_the_way_is_said_in_words(tmp_path):
    with Store.writing(tmp_path / "a", "first"):
        pass
    path = tmp_path / "a" / "store.zarr"
    with pytest.raises(StoreError) as error, Store.writing(tmp_path / "a", "second"):
        pass
    assert str(error.value) == (
        f"{path}: belongs to the study 'first', not to 'second'; give another --out or rename the study"
    )
    with pytest.raises(StoreError) as error:
        open_store(tmp_path / "b")
    assert str(error.value) == f"{tmp_path / 'b'}: holds no store.zarr; name a result folder, as given to --out"
    with pytest.raises(StoreError) as error:
        open_store(tmp_path / "a").table(table_spec())
    assert str(error.value) == f"{path}: holds no evaluations of specimen quick"
    with pytest.raises(StoreError) as error:
        open_store(tmp_path / "a").read_result("sobol")
    assert str(error.value) == f"{path}: holds no result 'sobol'"
    (tmp_path / "c" / "store.zarr").mkdir(parents=True)
    (tmp_path / "c" / "store.zarr" / "notes.txt").write_text("mine")
    with pytest.raises(StoreError) as error, Store.writing(tmp_path / "c", "study"):
        pass
    expected = "not a store of sinew (its zarr.json is missing); give another --out"
    assert str(error.value) == f"{tmp_path / 'c' / 'store.zarr'}: {expected}"


@pytest.mark.parametrize(
    ("attributes", "words"),
    [
        ({}, "a Zarr hierarchy, but not a store of sinew; give another --out"),
        ({"sinew_format": 1}, "a Zarr hierarchy, but not a store of sinew; give another --out"),
        ({"study": "study"}, "a Zarr hierarchy, but not a store of sinew; give another --out"),
        ({"sinew_format": 2, "study": "study"}, "format 2, but this sinew reads 1"),
    ],
)
def test_a_hierarchy_that_is_no_store_is_refused_in_words(tmp_path, attributes, words):
    zarr.open_group(tmp_path / "store.zarr", mode="w", attributes=attributes)
    with pytest.raises(StoreError) as error:
        open_store(tmp_path)
    assert str(error.value) == f"{tmp_path / 'store.zarr'}: {words}"


def test_an_empty_folder_becomes_a_store(tmp_path):
    (tmp_path / "deep" / "out" / "store.zarr").mkdir(parents=True)
    with Store.writing(tmp_path / "deep" / "out", "study") as store:
        assert store.writable
        assert store.study == "study"
        assert (store.folder / "journal").is_dir()
    assert not open_store(tmp_path / "deep" / "out").writable
    with Store.writing(tmp_path / "other" / "out", "study") as store:
        assert store.path.is_dir()


def test_writes_that_were_cut_short_are_swept_away(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(3))
    folder = tmp_path / "store.zarr" / "x.partial"
    folder.mkdir()
    with (
        pytest.raises(StoreError, match=r"x\.partial: is a folder, in the place of a file; remove it"),
        Store.writing(tmp_path, "study"),
    ):
        pass
    folder.rmdir()
    partial = next((tmp_path / "store.zarr").rglob("force")) / "zarr.01.partial"
    partial.write_text("{")
    with Store.writing(tmp_path, "study"):
        assert not partial.exists()


@pytest.mark.parametrize(
    ("title", "slug"),
    [("S01 Uniaxial", "s01-uniaxial"), ("-Größe 2-", "gr--e-2"), ("x" * 99, "x" * 60), ("µ", "table"), ("", "table")],
)
def test_a_table_is_called_by_its_title_and_key(tmp_path, title, slug):
    spec = replace(table_spec(), title=title)
    with Store.writing(tmp_path, "study") as store:
        assert store.table(spec).name == f"{slug}-{spec.key[:12]}"


def test_tables_are_sorted_by_name(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        for title in "cab":
            store.table(replace(table_spec(title), title=title))
        assert [table.title for table in store.tables()] == ["a", "b", "c"]
        assert store.table(table_spec("b")).title == "b"


def test_results_may_hold_texts(tmp_path):
    dataset = xr.Dataset({"name": ("specimen", np.array(["s01", "s2"])), "n": ("specimen", np.arange(2))})
    with Store.writing(tmp_path, "study") as store:
        store.write_result("deep/names", dataset)
        assert store.read_result("deep/names")["name"].to_numpy().tolist() == ["s01", "s2"]
        assert store.read_result("deep/names")["n"].to_numpy().tolist() == [0, 1]


def test_a_hierarchy_that_cannot_be_read_or_written_is_named(tmp_path, monkeypatch):
    def fails(*_args, **_kwargs):
        raise OSError(errno.EIO, "Input/output error")

    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(3))
        store.write_result("one", xr.Dataset({"n": ("a", np.arange(2))}))
        for patched, work in (
            ("zarr.Group.get", store.tables),
            ("zarr.Group.get", store.repair),
            ("zarr.Group.get", lambda: store.table(table_spec())),
            ("xarray.Dataset.to_zarr", lambda: store.write_result("two", xr.Dataset())),
            ("xarray.open_zarr", lambda: store.read_result("one")),
            ("zarr.open_group", lambda: open_store(tmp_path)),
        ):
            with monkeypatch.context() as patch, pytest.raises(StoreError) as error:
                patch.setattr(patched, fails)
                work()
            place = store.path / "one" if patched == "xarray.open_zarr" else store.path
            assert str(error.value) == f"{place}: Input/output error", patched
    with monkeypatch.context() as patch, pytest.raises(StoreError) as error:
        patch.setattr("zarr.open_group", fails)
        with Store.writing(tmp_path, "study"):
            pass
    assert str(error.value) == f"{store.path}: Input/output error"
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=f"^{tmp_path / 'file'}: File exists$"), Store.writing(tmp_path / "file", "s"):
        pass


class Marking:
    """Unpickled, it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def test_metadata_beside_those_of_the_root_are_not_believed(tmp_path):
    """They may name codecs that unpickle, which those of the arrays themselves (Zarr 3) cannot."""
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(20))
    before = open_store(tmp_path).tables()[0].status.tolist()
    root = tmp_path / "store.zarr"
    nodes = {
        path.parent.relative_to(root).as_posix(): json.loads(path.read_bytes()) for path in root.rglob("zarr.json")
    }
    top = nodes.pop(".")
    for name, node in nodes.items():
        if node["node_type"] == "array":
            size = node["shape"]
            codecs = {"compressor": None, "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]}
            plain = {"zarr_format": 2, "shape": size, "chunks": size, "dtype": "|O", "fill_value": None, "order": "C"}
            nodes[name] = {**plain, **codecs, "attributes": node["attributes"]}
            (root / name / ".".join("0" * len(size))).write_bytes(pickle.dumps(Marking(tmp_path / "ran")))
    top["consolidated_metadata"] = {"kind": "inline", "must_understand": False, "metadata": nodes}
    (root / "zarr.json").write_text(json.dumps(top))
    assert open_store(tmp_path).tables()[0].status.tolist() == before
    assert not (tmp_path / "ran").exists()


def test_metadata_of_a_table_describe_no_arrays(tmp_path):
    """Zarr would believe those in the group, while all that checks an array reads its own."""
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(20))
        store.write_result("sobol", xr.Dataset({"S1": ("parameter", np.arange(2.0))}))
    for path in [
        *(tmp_path / "store.zarr" / "evaluations").glob("*/zarr.json"),
        tmp_path / "store.zarr/sobol/zarr.json",
    ]:
        content = json.loads(path.read_text())
        content["consolidated_metadata"] = {"kind": "inline", "must_understand": False, "metadata": {}}
        path.write_text(json.dumps(content))
    with pytest.raises(StoreError, match=r"damaged \(it holds metadata of its arrays"):
        open_store(tmp_path).tables()
    with pytest.raises(StoreError, match=r"damaged \(it holds metadata of its arrays"):
        open_store(tmp_path).read_result("sobol")
    with Store.writing(tmp_path, "study") as store:
        assert "computed again" in store.repair().removed[0]


@pytest.mark.parametrize("encoding", [{"name": "default", "configuration": {"separator": "."}}, {"name": "v2"}])
@pytest.mark.parametrize(
    "place", ["evaluations/*/worker", "evaluations/*/parameter", "evaluations/*/force", "sobol/S1"]
)
def test_chunks_have_the_names_that_are_checked(tmp_path, encoding, place):
    """Else a small file beside them, under another name, is decompressed unchecked."""
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(20))
        store.write_result("sobol", xr.Dataset({"S1": ("parameter", np.arange(2.0))}))
    (path,) = (tmp_path / "store.zarr").glob(f"{place}/zarr.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"chunk_key_encoding": encoding}))
    with pytest.raises(StoreError, match="its chunks are named"):
        if place == "sobol/S1":
            open_store(tmp_path).read_result("sobol")
        else:
            (table,) = open_store(tmp_path).tables()
            table.coordinate("parameter")
            table.read(path.parent.name, np.arange(20))


def test_a_table_of_something_else_than_its_key_says_is_refused(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        store.table(table_spec())
    (place,) = (tmp_path / "store.zarr" / "evaluations").glob("specimen-*")
    content = json.loads((place / "zarr.json").read_text())
    identity = json.loads(content["attributes"]["identity"])
    content["attributes"]["identity"] = json.dumps(identity | {"simulator": "another"})
    (place / "zarr.json").write_text(json.dumps(content))
    with pytest.raises(StoreError, match="is of something else than its key says"):
        open_store(tmp_path).table(table_spec())
