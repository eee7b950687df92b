"""Damaged and missing chunks are named, and repaired."""

from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import StoreError, WalltimeReached
from sinew.runner.store.damage import store_errors
from sinew.runner.store.schema import CHUNK_ROWS
from sinew.runner.store.store import Store
from sinew.runner.store.table import Table
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some


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
        lost = store.repair().rows
        assert lost == 100
        table = store.table(table_spec())
        notes = tmp_path / "notes"
        rows = fill(table, parameters, Quick(notes))
        assert len(notes.read_text().splitlines()) == 100
        assert np.array_equal(table.read("force", rows), whole)


def test_a_missing_chunk_file_is_named_and_repaired(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, some(CHUNK_ROWS + 100))
        next((store.path / table.group.path / "objective" / "c").rglob("1*/0")).unlink()
        with pytest.raises(StoreError, match="objective: 100 rows with an outcome have no numbers; `sinew repair"):
            table.read("objective", rows)
        assert store.repair().rows == 100
        table = store.table(table_spec())
        rows = fill(table, some(CHUNK_ROWS + 100))
        assert np.isfinite(table.read("objective", rows)).all()


@pytest.fixture
def chunks_of_16(monkeypatch):
    monkeypatch.setattr("sinew.runner.store.schema.CHUNK_ROWS", 16)


def cut(store: Store, table: Table, array: str, chunk: int) -> None:
    """Cut the file of a chunk, or of the first of its parts, short."""
    place = store.path / table.group.path / array / "c" / str(chunk)
    file = place if place.is_file() else next(each for each in place.rglob("*") if each.is_file())
    file.write_bytes(file.read_bytes()[:-3])


@pytest.mark.usefixtures("chunks_of_16")
@pytest.mark.parametrize("damaged", [["force"], ["status"], ["status", "force"], ["objective", "force", "worker"]])
def test_only_rows_with_an_outcome_are_counted_as_lost(tmp_path, damaged):
    """The second of three chunks is damaged, in which the last four rows are pending still."""
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(28))
        table.plan(some(40))
        for array in damaged:
            cut(store, table, array, 1)
        nobody_knows = "status" in damaged
        assert store.repair().rows == (16 if nobody_knows else 12)
        (again,) = store.tables()
        assert np.flatnonzero(again.status == 0).tolist() == list(range(16))
        assert np.isfinite(again.read("objective", np.arange(16))).all()
        assert store.repair().rows == 0


@pytest.mark.usefixtures("chunks_of_16")
def test_rows_of_two_damaged_chunks_are_lost_together(tmp_path):
    with Store.writing(tmp_path, "study") as store:
        table = store.table(table_spec())
        fill(table, some(40))
        cut(store, table, "force", 0)
        (store.path / table.group.path / "objective" / "c" / "0" / "0").unlink()
        cut(store, table, "objective", 2)
        assert store.repair().rows == 16 + 8
        assert np.flatnonzero(store.tables()[0].status == 0).tolist() == list(range(16, 32))


@pytest.mark.parametrize("kind", [ValueError, RuntimeError])
def test_damage_is_one_line_with_the_command_that_mends_it(tmp_path, kind):
    where = tmp_path / "out" / "store.zarr" / "evaluations" / "force"
    with pytest.raises(StoreError) as error, store_errors(where):
        raise kind("checksum\nand more")
    assert str(error.value) == (
        f"{where}: damaged (checksum); `sinew repair {tmp_path / 'out'}` makes its rows pending, all others stay"
    )
    with pytest.raises(StoreError, match=rf"\(x{{120}}\); `sinew repair {tmp_path}` makes"), store_errors(tmp_path):
        raise kind("x" * 500)


def test_errors_of_the_system_and_of_the_store_say_what_they_say(tmp_path):
    with pytest.raises(StoreError) as error, store_errors(tmp_path):
        raise PermissionError(13, "Permission denied")
    assert str(error.value) == f"{tmp_path}: Permission denied"
    with pytest.raises(StoreError, match=r"^as it is$"), store_errors(tmp_path):
        raise StoreError("as it is")


def test_an_error_without_words_is_called_by_its_kind(tmp_path):
    with pytest.raises(StoreError, match=r"damaged \(RuntimeError\); `sinew repair"), store_errors(tmp_path):
        raise RuntimeError


def test_the_alarm_of_a_deadline_is_no_damage(tmp_path):
    """It may come while Zarr reads or writes, and the job is to be continued, not its store repaired."""
    with pytest.raises(WalltimeReached), store_errors(tmp_path / "store.zarr" / "force"):
        try:
            raise WalltimeReached("the walltime is near")
        except Exception as error:
            pytest.fail(f"taken for a failure of its own: {error!r}")


@pytest.mark.parametrize(
    ("named", "told"),
    [("/o/figures/a", "/o/figures/a"), ("/elsewhere", "/o"), ("/other", "/o"), (b"/o/a", "/o"), (None, "/o")],
)
def test_an_error_names_what_it_is_of_inside_of_the_folder(named, told):
    with pytest.raises(StoreError, match=rf"^{told}: Permission denied$"), store_errors(Path("/o")):
        raise PermissionError(13, "Permission denied", named)
