"""A table whose arrays are missing or laid out wrongly is refused in one line; a repair makes its rows pending."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.store.segment import Segment
from sinew.runner.store.store import Store, open_store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some

ROWS = 40


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with a table of 40 rows in chunks of 16."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
        with Store.writing(folder, "study") as store:
            fill(store.table(table_spec()), some(ROWS))
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it: a test may damage what it likes."""
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)
    return Path(shutil.copytree(whole, tmp_path, dirs_exist_ok=True))


def table_folder(folder: Path) -> Path:
    (found,) = (folder / "store.zarr" / "evaluations").glob("specimen-*")
    return found


def edit(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def grid(*chunks: Any) -> dict[str, Any]:
    return {"name": "regular", "configuration": {"chunk_shape": list(chunks)}}


def read_all(folder: Path) -> None:
    for table in open_store(folder).tables():
        for name in ("parameters", *table.fields, "attempts", "wall_seconds", "worker", "message"):
            table.read(name, np.arange(len(table)))
        for name in ("parameter", "protocol", "time"):
            table.coordinate(name)


def repaired_and_run_again(folder: Path) -> tuple[int, int]:
    """Rows that the repair made pending, and rows that the next run computed; afterwards all is as it was."""
    notes = folder / "notes"
    with Store.writing(folder, "study") as store:
        lost = store.repair()
        table = store.table(table_spec())
        rows = fill(table, some(ROWS), Quick(notes))
        expected = Quick()(some(ROWS)).values["force"]
        assert np.array_equal(table.read("force", rows), expected)
        assert store.repair().rows == 0
    read_all(folder)
    return lost.rows, len(notes.read_text().splitlines()) if notes.exists() else 0


BROKEN = {
    "text shape": {"shape": ["many"]},
    "text as shape": {"shape": "forty"},
    "two dimensions": {"shape": [ROWS, 3], "chunk_grid": grid(16, 3), "dimension_names": ["row", "parameter"]},
    "no dimension": {"shape": [], "chunk_grid": grid(), "dimension_names": []},
    "zero chunk": {"chunk_grid": grid(0)},
    "another chunk": {"chunk_grid": grid(3)},
    "huge shape": {"shape": [10**13]},
    "negative shape": {"shape": [-3]},
    "other numbers": {"data_type": "complex128"},
    "no codecs": {"codecs": []},
    "unknown codec": {"codecs": [{"name": "none of these"}]},
}


@pytest.mark.parametrize("array", ["status", "attempts", "worker"])
@pytest.mark.parametrize("how", BROKEN)
def test_a_column_laid_out_wrongly_is_named_and_created_again(folder, how, array):
    edit(table_folder(folder) / array / "zarr.json", **BROKEN[how])
    with pytest.raises(StoreError, match=rf"{array}: damaged \(.*`sinew repair {folder}`"):
        read_all(folder)
    assert repaired_and_run_again(folder) == (0, 0), "its chunks were whole"


@pytest.mark.parametrize("array", ["force", "objective", "parameters"])
@pytest.mark.parametrize("how", BROKEN)
def test_numbers_laid_out_wrongly_are_named_and_computed_again(folder, how, array):
    edit(table_folder(folder) / array / "zarr.json", **BROKEN[how])
    with pytest.raises(StoreError, match=rf"{array}: damaged \(.*`sinew repair {folder}`"):
        read_all(folder)
    assert repaired_and_run_again(folder)[1] == ROWS


@pytest.mark.parametrize(
    ("array", "again"),
    [("force", ROWS), ("parameters", ROWS), ("status", ROWS), ("protocol", ROWS), ("worker", 0), ("wall_seconds", 0)],
)
def test_a_missing_array_is_named_and_created_again(folder, array, again):
    shutil.rmtree(table_folder(folder) / array)
    if array != "protocol":  # which is looked for where it is read
        with pytest.raises(StoreError, match=rf"{array}: damaged \(the array is missing\); `sinew repair {folder}`"):
            read_all(folder)
    assert repaired_and_run_again(folder)[1] == again


@pytest.mark.parametrize(("array", "rows"), [("status", ROWS), ("worker", 0), ("message", 0), ("attempts", 0)])
def test_a_repair_tells_of_a_column_that_it_created_again(folder, array, rows):
    """It must not say that all is well."""
    place = table_folder(folder) / array
    shutil.rmtree(place)
    with Store.writing(folder, "study") as store:
        done = store.repair()
        assert done.rows == rows
        assert done.removed == (f"{place}: damaged (the array is missing); it is created again",)
        assert store.repair().removed == ()


@pytest.mark.parametrize("content", ["", "[]", "{", '{"zarr_format": 3, "node_type": "array"}', "null"])
def test_a_table_whose_own_metadata_are_damaged_is_computed_again(folder, content):
    (table_folder(folder) / "zarr.json").write_text(content)
    with pytest.raises(StoreError, match="damaged"):
        read_all(folder)
    with Store.writing(folder, "study") as store:
        (line,) = store.repair().removed
    assert "cannot be mended, all of its rows are computed again" in line
    assert repaired_and_run_again(folder)[1] == ROWS


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        *(("chunk_rows", value) for value in ("many", None, 0, [], [3], 10**12)),
        *(("fields", value) for value in ("many", None, 0, [3], 10**12)),  # a table without fields is one
    ],
)
def test_attributes_of_a_table_are_checked(folder, attribute, value):
    path = table_folder(folder) / "zarr.json"
    content = json.loads(path.read_text())
    content["attributes"][attribute] = value
    path.write_text(json.dumps(content))
    with pytest.raises(StoreError, match=f"damaged .*{attribute}"):
        read_all(folder)
    assert repaired_and_run_again(folder)[1] == ROWS


def test_a_status_that_there_is_not_is_damage(folder):
    status = zarr.open_array(table_folder(folder) / "status", mode="r+")
    status[3] = 55
    with pytest.raises(StoreError, match=r"status: damaged \(a status is 55\)"):
        read_all(folder)
    assert repaired_and_run_again(folder) == (1, 1)


@pytest.mark.parametrize(
    "error", [MemoryError(), RuntimeError("can't start new thread"), OSError(24, "Too many files")]
)
def test_no_chunk_is_deleted_because_memory_or_threads_are_short(folder, monkeypatch, error):
    before = {path: path.read_bytes() for path in (folder / "store.zarr").rglob("*") if path.is_file()}

    def short(*_args: Any, **_kwargs: Any) -> Any:
        raise error

    with Store.writing(folder, "study") as store:
        for place in ("zarr.Array.__getitem__", "zarr.Group.get", "zarr.Group.__getitem__"):
            with monkeypatch.context() as patch:
                patch.setattr(place, short)
                with pytest.raises(StoreError, match=r"cannot be (checked|read) now|Too many files"):
                    store.repair()
    assert {path: path.read_bytes() for path in (folder / "store.zarr").rglob("*") if path.is_file()} == before


def test_a_damaged_segment_is_removed_by_a_repair(folder):
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        rows = table.plan(some(ROWS + 2))[-2:]
        table.journal.mkdir(parents=True, exist_ok=True)
        outcome = Quick()(some(ROWS + 2)[-2:])
        path = table.journal / "rows-000000040-00002.safetensors"
        ones = np.ones(2)
        Segment(rows, outcome.status, ones.astype(np.int16), ones, outcome.values, (), "w").write(path)
        assert store.repair().removed == ()
        content = path.read_bytes()
        path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
        (line,) = store.repair().removed
        assert line.startswith(f"{path}: not a whole segment (a wrong checksum of ")
        assert not path.exists()
        assert fill(table, some(ROWS + 2))[-2:].tolist() == [40, 41]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda table: shutil.rmtree(table / "protocol"), "protocol: the array is missing"),
        (lambda table: shutil.rmtree(table / "protocol" / "c"), "protocol: its chunk is missing"),
        (lambda table: shutil.rmtree(table / "time" / "c"), "time: its chunk is missing"),
        (lambda table: edit(table / "force" / "zarr.json", **BROKEN["huge shape"]), "force: "),
        (lambda table: edit(table / "force" / "zarr.json", **BROKEN["unknown codec"]), "force: "),
        (lambda table: shutil.rmtree(table / "parameters"), "parameters: the array is missing"),
        (lambda table: (table / "zarr.json").write_text("{"), "zarr.json: "),
    ],
)
def test_a_repair_says_why_a_table_is_given_up_and_removes_its_segments_alone(folder, spoil, words):
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        ours, another = table.journal / "rows-1", table.journal.with_name("another") / "rows-1"
        for path in (ours, another):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("")
    spoil(table_folder(folder))
    with Store.writing(folder, "study") as store:
        repaired = store.repair()
    (line,) = repaired.removed
    assert line.startswith(f"{table_folder(folder)}: {words}")
    assert line.endswith("; it cannot be mended, all of its rows are computed again")
    assert "None" not in line
    assert (ours.exists(), another.exists()) == (False, True)


def test_tables_behind_one_without_metadata_are_repaired(folder):
    (folder / "store.zarr" / "evaluations" / "a-foreign-folder").mkdir()
    status = zarr.open_array(table_folder(folder) / "status", mode="r+")
    status[3] = 55
    with Store.writing(folder, "study") as store:
        assert store.repair().rows == 1


@pytest.mark.parametrize("array", ["force", "parameters", "attempts", "worker"])
def test_an_array_that_says_to_be_shorter_is_as_long_as_the_status_again(folder, array):
    path = table_folder(folder) / array / "zarr.json"
    shape = json.loads(path.read_text())["shape"]
    edit(path, shape=[16, *shape[1:]])
    assert repaired_and_run_again(folder) == (0, 0), "its chunks were whole"
    assert json.loads(path.read_text())["shape"] == shape


def test_rows_lost_in_two_arrays_are_pending_once(folder):
    status = zarr.open_array(table_folder(folder) / "status", mode="r+")
    force = zarr.open_array(table_folder(folder) / "force", mode="r+")
    status[3], status[20] = 55, 55
    force[3:6] = np.nan
    assert repaired_and_run_again(folder) == (4, 4)


# ---- names in the attributes of a table are those of its own arrays, and lead nowhere else

LEADING_AWAY = ("../elsewhere", "/elsewhere", "..", ".", "", "a\0b", "x" * 300, 7)


def change_attributes(folder: Path, **changes: Any) -> None:
    path = table_folder(folder) / "zarr.json"
    content = json.loads(path.read_text())
    content["attributes"] |= changes
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("key", ["../attempts/", "/tmp/x", "../../victim", "ab" * 15, "AB" * 16, 7, None])
def test_a_key_that_is_no_hash_leads_to_no_folder(folder, key):
    change_attributes(folder, key=key)
    with pytest.raises(StoreError, match=r"damaged .*key is"):
        read_all(folder)
    assert repaired_and_run_again(folder)[1] == ROWS


def test_a_coordinate_along_no_axis_of_a_field_is_missed(folder):
    shutil.rmtree(table_folder(folder) / "parameter_unit")
    with Store.writing(folder, "study") as store:
        (said,) = store.repair().removed
    assert "parameter_unit" in said and "it cannot be mended" in said


@pytest.mark.parametrize("name", LEADING_AWAY)
@pytest.mark.parametrize("attribute", ["fields", "coordinates", "dimension"])
def test_a_repair_deletes_nothing_elsewhere(folder, name, attribute, tmp_path_factory):
    """A field whose name is a path had its chunks removed there."""
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    (elsewhere / "c").mkdir()
    (elsewhere / "c" / "0").write_text("a thesis")
    name = name.replace("/elsewhere", str(elsewhere)) if isinstance(name, str) else name
    place = table_folder(folder)
    if attribute == "dimension":
        path = place / "force" / "zarr.json"
        edit(path, dimension_names=["row", name])
    elif attribute == "fields":
        change_attributes(folder, fields=["force", name])
    else:
        change_attributes(folder, coordinates=f"parameter_unit {name}")
    if isinstance(name, str) and name.startswith("/"):  # an array of this very name, as the store would look for it
        shutil.copytree(place / "force", Path(f"{place}{name}"))
    with Store.writing(folder, "study") as store:
        store.repair()
    assert (elsewhere / "c" / "0").read_text() == "a thesis"
    assert repaired_and_run_again(folder)[1] in (0, ROWS)


@pytest.mark.parametrize("name", ["a-..", "a-", "table", "a-0123456789"])
def test_a_table_that_is_given_up_takes_only_its_own_segments_along(folder, name):
    (folder / "results.json").write_text("kept")
    kept = folder / "journal" / "0123456789ab"
    kept.mkdir(parents=True)
    (kept / "note").write_text("kept")
    place = table_folder(folder).with_name(name)
    place.mkdir()
    attributes = {"complete": True, "key": "k", "title": "t", "chunk_rows": 16, "fields": ["x"]}
    (place / "zarr.json").write_text(json.dumps({"zarr_format": 3, "node_type": "group", "attributes": attributes}))
    with Store.writing(folder, "study") as store:
        (line,) = store.repair().removed
    assert "cannot be mended" in line
    assert (folder / "results.json").exists()
    assert (kept / "note").exists()


def test_a_file_for_the_folder_of_chunks_and_a_folder_for_a_segment_are_removed(folder):
    for array in ("status", "force"):
        place = table_folder(folder) / array / "c"
        shutil.rmtree(place)
        place.write_text("no chunk")
    segment = folder / "journal" / table_folder(folder).name.rpartition("-")[2] / "rows-000000000-00003.safetensors"
    (segment / "inner").mkdir(parents=True)
    with pytest.raises(StoreError, match="damaged"):
        read_all(folder)
    assert repaired_and_run_again(folder)[1] == ROWS
    assert not segment.exists()


def test_a_field_is_there_once(folder):
    change_attributes(folder, fields=["force"] * 300_000)
    with pytest.raises(StoreError, match=r"damaged \(fields are"):
        read_all(folder)
    assert repaired_and_run_again(folder)[1] == ROWS


def test_rows_whose_parameters_are_missing_are_computed_again(folder):
    (table_folder(folder) / "parameters" / "c" / "1" / "0").unlink()
    with pytest.raises(StoreError, match=rf"parameters are missing for rows with an outcome; `sinew repair {folder}`"):
        read_all(folder)
    with Store.writing(folder, "study") as store:
        assert store.repair().rows == 16
    with Store.writing(folder, "study") as store:
        rows = fill(store.table(table_spec()), some(ROWS))
        assert rows[16:32].tolist() == list(range(ROWS, ROWS + 16))
    read_all(folder)


def test_outcomes_of_rows_whose_parameters_are_missing_are_removed_from_the_journal(folder):
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        rows, ones = np.arange(16, 18), np.ones(2)
        table.journal.mkdir(parents=True, exist_ok=True)
        path = table.journal / "rows-000000016-00002.safetensors"
        values = Quick()(some(ROWS)[16:18]).values
        Segment(rows, np.zeros(2, np.int8), ones.astype(np.int16), ones, values, (), "w").write(path)
        (table_folder(folder) / "parameters" / "c" / "1" / "0").unlink()
        store.repair()
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        assert table.segments() == []
        fill(table, some(ROWS))
    read_all(folder)


def test_a_segment_that_was_removed_before_the_repair_is_told_as_well(folder):
    journal = folder / "journal" / table_spec().key[:12]
    journal.mkdir(parents=True, exist_ok=True)
    (journal / "rows-000000000-00002.safetensors").write_bytes(b"cut short")
    (journal / ".rows-000000000-00002.safetensors.123").write_bytes(b"of a process that was killed")
    with Store.writing(folder, "study") as store:
        (line,) = store.repair().removed
    assert line.startswith(f"{journal / 'rows-000000000-00002.safetensors'}: not a whole segment")
    assert list(journal.iterdir()) == []
