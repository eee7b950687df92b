"""The arrays of a task's result: what is missing, or larger than what was written, is said and not shown."""

import json
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numcodecs import Zstd

from sinew.runner.errors import StoreError
from sinew.runner.store.results import ARRAYS
from sinew.runner.store.store import Store, open_store

DATASET = xr.Dataset(
    {"S1": ("parameter", [1.0, 2.0]), "gap": ("parameter", [np.nan, np.nan]), "one": ((), 3.0), "none": ("x", [])},
    {"parameter": np.array(["E_f", "alpha_f"])},
    {"inputs": "key"},
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with Store.writing(tmp_path, "study") as store:
        store.write_result("sobol", DATASET)
        store.write_result("sobol/inner", DATASET)
    return tmp_path


def test_arrays_are_read_as_they_were_written(folder):
    for name in ("sobol", "sobol/inner"):
        xr.testing.assert_identical(open_store(folder).read_result(name), DATASET)


def test_arrays_of_a_store_without_a_list_are_read(folder):
    """Stores of version 0.1; where all of a chunk was empty, they have no file."""
    edit(folder / "store.zarr" / "sobol", lambda group: group["attributes"].pop(ARRAYS))
    shutil.rmtree(folder / "store.zarr" / "sobol" / "gap" / "c")
    xr.testing.assert_identical(open_store(folder).read_result("sobol"), DATASET)


def test_an_array_without_a_list_has_no_more_chunks_than_files(folder):
    """Zarr would look for the file of each."""
    group = folder / "store.zarr" / "sobol"
    edit(group, lambda one: one["attributes"].pop(ARRAYS))
    shape([2**24], [1])(group)
    with pytest.raises(StoreError, match="S1 claims 16,777,216 chunks"):
        open_store(folder).read_result("sobol")


def edit(place: Path, change: Callable[[Any], Any]) -> None:
    content = json.loads((place / "zarr.json").read_text())
    change(content)
    (place / "zarr.json").write_text(json.dumps(content))


def shape(value: list[int], chunk: list[int]) -> Callable[[Path], None]:
    def change(content: Any) -> None:
        content["shape"] = value
        content["chunk_grid"]["configuration"]["chunk_shape"] = chunk

    return lambda group: edit(group / "S1", change)


def bomb(name: str) -> Callable[[Path], Any]:
    return lambda group: (group / name / "c" / "0").write_bytes(Zstd().encode(np.zeros(2**29, dtype="u1")))


DAMAGE: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no metadata": (lambda group: (group / "S1" / "zarr.json").unlink(), "the array S1 is missing"),
    "no array": (lambda group: shutil.rmtree(group / "S1"), "the array S1 is missing"),
    "no chunk": (lambda group: (group / "S1" / "c" / "0").unlink(), "a chunk of S1 is missing"),
    "no name": (lambda group: shutil.rmtree(group / "parameter" / "c"), "a chunk of parameter is missing"),
    "metadata of a group": (
        lambda group: (group / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "array"})), "damaged",
    ),
    "huge": (shape([10**13], [2]), "the shape of S1"),
    "huge in one chunk": (shape([2**31], [2**31]), "the shape of S1"),
    "chunks of nothing": (shape([2], [0]), ""),
    "negative": (shape([-1], [2]), ""),
    "two dimensions": (shape([2, 2], [2, 2]), ""),
    "text as shape": (lambda group: edit(group / "S1", lambda one: one.update(shape="two")), ""),
    "many arrays": (
        lambda group: edit(group, lambda one: one["attributes"].update({ARRAYS: 7})), "its list of arrays is 7",
    ),
    "bomb": (bomb("S1"), "a chunk of S1 claims to hold too much"),
    "bomb of text": (bomb("parameter"), "a chunk of parameter claims to hold too much"),
    "cut": (lambda group: (group / "S1" / "c" / "0").write_bytes(b"\x28\xb5"), "a chunk of S1"),
    "another codec": (
        lambda group: edit(group / "S1", lambda one: one.update(codecs=[{"name": "bytes"}])), "the codecs of S1",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", DAMAGE)
def test_what_was_not_written_is_one_line(folder, kind):
    damage, words = DAMAGE[kind]
    damage(folder / "store.zarr" / "sobol")
    with pytest.raises(StoreError) as error:
        open_store(folder).read_result("sobol")
    line = str(error.value)
    assert words in line
    assert line.startswith(f"{folder / 'store.zarr' / 'sobol'}: damaged (")
    assert line.endswith("; remove the .json of its task and run the study again, which makes it anew")
    assert "\n" not in line
    with Store.writing(folder, "study") as store:
        store.write_result("sobol", DATASET)
    xr.testing.assert_identical(open_store(folder).read_result("sobol"), DATASET)


def array(group: Path, name: str, size: list[int], chunk: list[int], dtype: str, content: bytes, files: int) -> None:
    """Add an array to a group whose chunks all are this content, compressed."""
    edit(group, lambda one: one["attributes"][ARRAYS].append(name))
    codecs = ["bytes" if dtype != "string" else "vlen-utf8", "zstd"]
    metadata = {
        "zarr_format": 3, "node_type": "array", "shape": size, "data_type": dtype, "attributes": {},
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": chunk}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": "" if dtype == "string" else 0, "dimension_names": [f"{name}_{i}" for i in range(len(size))],
        "codecs": [{"name": codecs[0]}, {"name": "zstd", "configuration": {"level": 3, "checksum": False}}],
    }  # fmt: skip
    for number in range(files):
        path = group / name / "c" / "/".join([str(number), *"0" * (len(size) - 1)])
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(Zstd(3).encode(content))
    (group / name / "zarr.json").write_text(json.dumps(metadata))


@pytest.mark.parametrize("name", ["scale_factor", "add_offset", "missing_value", "_Unsigned", "_FillValue"])
def test_numbers_are_not_turned_into_larger_ones(folder, name):
    """xarray would make float64 of bytes, eight times their size, and copies of it."""
    group = folder / "store.zarr" / "sobol"
    array(group, "small", [16], [16], "int8", bytes(16), 1)
    assert open_store(folder).read_result("sobol")["small"].dtype == np.int8
    edit(group / "small", lambda one: one["attributes"].update({name: 1}))
    with pytest.raises(StoreError, match=f"small has the attribute {name}"):
        open_store(folder).read_result("sobol")


@pytest.mark.parametrize("unit", ["days since 2000-01-01", "seconds"])
def test_no_unit_makes_dates_of_numbers(folder, unit):
    group = folder / "store.zarr" / "sobol"
    array(group, "small", [16], [16], "int8", bytes(16), 1)
    edit(group / "small", lambda one: one["attributes"].update(units=unit, dtype="timedelta64[ns]"))
    assert open_store(folder).read_result("sobol")["small"].dtype == np.int8


def test_an_array_beside_the_groups_of_a_store_is_refused(folder):
    """xarray would load it at once, although nothing has looked at it."""
    open_store(folder).check()
    edit(folder / "store.zarr", lambda one: one["attributes"].update({ARRAYS: []}))
    array(folder / "store.zarr", "x", [16], [16], "int8", bytes(16), 1)
    with pytest.raises(StoreError, match=r"holds the array 'x' beside its groups"):
        open_store(folder).check()


def test_a_chunk_is_no_larger_than_its_array(folder):
    """Ten would be decompressed at once, whatever the array shows of them."""
    array(folder / "store.zarr" / "sobol", "wide", [10, 1], [1, 2**26], "int8", bytes(2**26), 10)
    with pytest.raises(StoreError, match=r"the shape of wide is \(10, 1\), its chunks are \(1, 67108864\)"):
        open_store(folder).read_result("sobol")


def test_chunks_that_reach_beyond_the_end_are_counted_whole(folder, monkeypatch):
    monkeypatch.setattr("sinew.runner.store.results.MAX_BYTES", 3000)
    group = folder / "store.zarr" / "sobol"
    array(group, "few", [1001], [1000], "int8", bytes(1000), 2)
    assert open_store(folder).read_result("sobol")["few"].size == 1001
    array(group, "more", [601], [600], "int8", bytes(600), 2)
    with pytest.raises(StoreError, match="its arrays take more than 3,000 bytes"):
        open_store(folder).read_result("sobol")


def test_texts_of_all_arrays_are_counted_as_they_are_in_memory(folder, monkeypatch):
    """A single rare letter makes each of its text take four bytes."""
    text = ("a" * 1000 + "\N{GRINNING FACE}").encode()
    content = struct.pack("<II", 1, len(text)) + text
    monkeypatch.setattr("sinew.runner.store.results.MAX_BYTES", 9000)
    for number in range(2):
        array(folder / "store.zarr" / "sobol", f"t{number}", [1], [1], "string", content, 1)
    assert open_store(folder).read_result("sobol")["t1"].size == 1
    array(folder / "store.zarr" / "sobol", "t2", [1], [1], "string", content, 1)
    with pytest.raises(StoreError, match="its arrays take more than 9,000 bytes"):
        open_store(folder).read_result("sobol")


def test_texts_of_many_chunks_are_counted_until_they_are_too_many(folder, monkeypatch):
    text = "a" * 1000
    content = struct.pack("<II", 1, len(text)) + text.encode()
    monkeypatch.setattr("sinew.runner.store.results.MAX_BYTES", 9000)
    array(folder / "store.zarr" / "sobol", "words", [3], [1], "string", content, 3)
    with pytest.raises(StoreError, match="its arrays take more than 9,000 bytes"):
        open_store(folder).read_result("sobol")
