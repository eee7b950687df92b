"""What somebody else wrote into a result folder does no harm in a notebook."""

import json
import re
import shutil
import sqlite3
import struct
import zlib
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numcodecs import Zstd

import sinew
from sinew import interop
from sinew.interop import MAX_FILE_BYTES
from sinew.posterior_file import fault
from sinew.runner.errors import BadInput, StoreError
from sinew.runner.store.store import open_store
from tests.tasks.calibrations import calibration_of, fit_of
from tests.test_results import copied_run, edit, folder, no_figures_left_open

__all__ = ["copied_run", "folder", "no_figures_left_open"]


def test_a_database_with_a_program_is_refused(copied_run):
    with closing(sqlite3.connect(copied_run / "infer" / "distal.db")) as database:
        database.execute("ALTER TABLE version RENAME TO version_of")
        endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS version_num FROM n"
        database.execute(f"CREATE VIEW version AS {endless}")
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: holds a view; expected what `sinew infer` writes"):
        sinew.results(copied_run).abc_history("distal")
    (copied_run / "infer" / "distal.db").write_bytes(b"no database at all")
    with pytest.raises(BadInput, match=r"distal\.db: damaged"):
        sinew.results(copied_run).abc_history("distal")


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE parameters ADD COLUMN more text GENERATED ALWAYS AS (printf('%.*c', 9, 'x')) VIRTUAL",
        "CREATE VIRTUAL TABLE more USING fts5(x)",
    ],
)
def test_a_database_whose_tables_compute_is_refused(copied_run, monkeypatch, change):
    assert sinew.results(copied_run).abc_history("distal").max_t >= 0
    with closing(sqlite3.connect(copied_run / "infer" / "distal.db")) as database:
        database.execute(change)
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: holds a table that computes its content"):
        sinew.results(copied_run).abc_history("distal")
    monkeypatch.setattr("sinew.interop.MAX_FILE_BYTES", 1000)
    with pytest.raises(BadInput, match=r"distal\.db: has [0-9,]+ bytes"):
        sinew.results(copied_run).abc_history("distal")


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("DROP TABLE particles", "has no particles.id"),
        ("ALTER TABLE samples RENAME COLUMN distance TO d", "has no samples.distance"),
        ("DELETE FROM abc_smc", "holds nothing in abc_smc"),
        ("DELETE FROM populations", "holds nothing in populations"),
        ("UPDATE parameters SET value = 'x'", "holds text in parameters.value"),
        ("UPDATE parameters SET value = NULL WHERE id = 20", "holds no finite number in parameters.value"),
        ("UPDATE particles SET w = -9e999", "holds no finite number in particles.w"),
        ("UPDATE populations SET t = 0.5", "holds real in populations.t"),
        ("UPDATE summary_statistics SET value = 'x'", "holds text in summary_statistics.value"),
        ("UPDATE abc_smc SET start_time = 'yesterday'", "holds text in abc_smc.start_time"),
        ("UPDATE abc_smc SET start_time = '2020-19-39 00:00:00.000000'", r"damaged \(month must be in 1..12\)"),
        ("UPDATE version SET version_num = '99'", r"damaged \(Database has version 99"),
        ("UPDATE abc_smc SET json_parameters = CAST(x'ff00fe' AS TEXT)", r"damaged \(.*Could not decode to UTF-8"),
        (
            "UPDATE abc_smc SET json_parameters = printf('%.*c', 70000, 'x')",
            "holds a text of 70000 bytes in abc_smc.js",
        ),
        ("UPDATE populations SET t = 900000000000 WHERE t > 0", r"damaged \(generations are missing\)"),
        ("INSERT INTO version VALUES ('1')", "holds 2 rows in version"),
        ("INSERT INTO abc_smc (id) VALUES (77)", "holds 2 rows in abc_smc"),
        (
            "INSERT INTO populations (id, abc_smc_id, t) WITH RECURSIVE n(i) AS (SELECT 1000 UNION ALL SELECT i + 1 "
            "FROM n WHERE i < 12000) SELECT i, 1, i FROM n",
            r"holds 11,\d+ rows in populations",
        ),
    ],
)
def test_a_database_with_other_tables_than_pyabc_makes_is_refused(copied_run, change, problem):
    with closing(sqlite3.connect(copied_run / "infer" / "distal.db")) as database:
        database.execute(change)
        database.commit()
    with pytest.raises(BadInput, match=rf"distal\.db: {problem}"):
        sinew.results(copied_run).abc_history("distal")


def test_samples_that_the_store_does_not_hold_are_not_drawn(copied_run):
    path = copied_run / "sobol.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"base_samples": 2**26}))
    with pytest.raises(BadInput, match="67,108,864 base samples of"):
        sinew.results(copied_run).salib_samples("distal/1")


def test_chunks_are_checked_before_they_become_a_table(copied_run):
    (table, *_) = open_store(copied_run).tables()
    chunk = copied_run / "store.zarr" / "evaluations" / table.name / "parameter" / "c" / "0"
    chunk.write_bytes(bytes(Zstd().encode(struct.pack("<I", 500_000_000))))
    with pytest.raises(StoreError, match="a chunk does not hold"):
        sinew.results(copied_run).samples(table.name)


def test_words_from_a_result_do_not_steer_the_terminal(tmp_path):
    evil = "\x1b]0;title\x07"
    calibration_of({evil: fit_of({evil: 1.0}, site=evil, method=evil)}).write(tmp_path)
    one = sinew.results(tmp_path)
    assert "\\x1b]0;title" in repr(one.calibrate)
    assert not {"\x1b", "\x07"} & set(repr(one) + repr(one.calibrate))


def test_samples_of_other_parameters_are_not_drawn(copied_run):
    """A gigabyte of them would be, before they are looked for."""
    result = sinew.results(copied_run).sobol.result
    with pytest.raises(ValueError, match=r"names: .*E_f, of which one comes twice"):
        replace(result, names=["E_f"] * len(result.names))
    other = replace(result, names=[*result.names[:-1], "x"])
    with pytest.raises(BadInput, match=r"names: .*x"):
        interop.salib_samples(other, copied_run, "distal/1")


def without(name):
    def change(group):
        shutil.rmtree(group / name)
        edit(group / "zarr.json", lambda one: one["attributes"]["arrays"].remove(name))

    return change


def of_other_dimensions(name):
    def change(group):
        edit(group / name / "zarr.json", lambda one: one.update(dimension_names=list("abc")[: len(one["shape"])]))

    return change


@pytest.mark.parametrize(
    "change",
    [without("weight"), without("parameters"), of_other_dimensions("weight"), of_other_dimensions("parameters")],
)
def test_particles_that_contradict_each_other_are_one_line_in_a_notebook(copied_run, change):
    change(copied_run / "store.zarr" / "infer" / "distal")
    with pytest.raises(BadInput, match=r"infer\.json: contradicts itself, or the store"):
        sinew.results(copied_run).particles("distal")


def change_posterior(folder: Path, change: Callable[[h5py.File], object]) -> None:
    with h5py.File(folder / "infer" / "distal.nc", "r+") as file:
        change(file)


def external(file: h5py.File) -> None:
    shape = file["posterior/E_f"].shape
    del file["posterior/E_f"]
    secret = Path(file.filename).with_name("secret")
    secret.write_bytes(bytes(8 * int(np.prod(shape))))
    file["posterior"].create_dataset("E_f", shape, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])


def compressed(file: h5py.File, chunk: bytes) -> None:
    made = file.create_dataset("more", (1000,), "i8", chunks=(1000,), compression="gzip")
    made.id.write_direct_chunk((0,), chunk)


def lists(count: int) -> np.ndarray:
    found = np.empty(count, object)
    found[:] = [np.zeros(1 + i, "i4") for i in range(count)]
    return found


POSTERIORS = {
    "external": (external, "E_f has its numbers elsewhere"),
    "link": (lambda file: file["posterior"].__setitem__("more", h5py.ExternalLink("x.nc", "/")), "more is a link"),
    "soft": (lambda file: file["posterior"].__setitem__("more", h5py.SoftLink("/posterior")), "more is a link"),
    "huge": (
        lambda file: file.create_dataset("more", (2**40,), "f8", chunks=(1024,)),
        "more has 1099511627776 numbers",
    ),
    "wide": (
        lambda file: file.create_dataset("more", (1000,), "S2000000", chunks=(1,)),
        "more has numbers of 2000000 bytes",
    ),
    "chunks": (
        lambda file: file.create_dataset("more", (10,), "f8", maxshape=(None,), chunks=(2**21,), compression="gzip"),
        "more has chunks of 2,097,152 numbers",
    ),
    "long attribute": (
        lambda file: file["posterior/E_f"].attrs.__setitem__("more", np.zeros(8100, "f8")),
        "E_f has an attribute of 64,800 bytes",
    ),
    "long text": (
        lambda file: file["posterior/E_f"].attrs.__setitem__("more", "x" * 60_000),
        "E_f has an attribute of 60,000 bytes",
    ),
    "texts as an attribute": (
        lambda file: file["posterior/E_f"].attrs.create("more", ["x" * 100] * 2, dtype=h5py.string_dtype()),
        "E_f has an attribute of 2 texts or lists",
    ),
    "lists as an attribute": (
        lambda file: file["posterior/E_f"].attrs.create("more", lists(9), dtype=h5py.vlen_dtype("i4")),
        "E_f has an attribute of 9 texts or lists",
    ),
    "bomb": (
        lambda file: compressed(file, zlib.compress(bytes(10**6))),
        "more has a chunk that holds more than it should",
    ),
    "no chunk": (
        lambda file: compressed(file, b"not compressed"),
        r"damaged \(.*\)",
    ),
    "another filter": (
        lambda file: file.create_dataset("more", (1000,), "i8", chunks=(1000,), compression="lzf"),
        "more is compressed in an unusual way",
    ),
    "parts of an attribute": (
        lambda file: file["posterior/E_f"].attrs.create(
            "more", np.array([("x",)], [("a", h5py.string_dtype())]), dtype=[("a", h5py.string_dtype())]
        ),
        "E_f has an attribute with parts that are no numbers",
    ),
    "parts": (
        lambda file: file.create_dataset("more", (4,), [("a", h5py.string_dtype())]),
        "more has parts that are no numbers",
    ),
    "texts": (
        lambda file: file.create_dataset("more", data=["x" * 70_000] * 20, dtype=h5py.string_dtype()),
        "more has texts of more than 1,048,576 bytes",
    ),
    "many attributes": (
        lambda file: [file["posterior/E_f"].attrs.__setitem__(f"a{i}", i) for i in range(200)] and None,
        "E_f has [0-9]+ attributes",
    ),
    "twice": (lambda file: file["posterior"].__setitem__("more", file["posterior/E_f"]), "more is there twice"),
    "many": (
        lambda file: [file.create_group(f"more{i}") for i in range(1000)] and None,
        "more[0-9]* is one of more than 1000 objects",
    ),
}


@pytest.mark.parametrize("kind", POSTERIORS)
def test_a_posterior_whose_numbers_are_elsewhere_is_refused(copied_run, kind):
    path = copied_run / "infer" / "distal.nc"
    assert fault(path, MAX_FILE_BYTES) is None
    change, words = POSTERIORS[kind]
    change_posterior(copied_run, change)
    assert re.fullmatch(words, str(fault(path, MAX_FILE_BYTES)))


def test_a_posterior_is_looked_at_before_it_is_opened(copied_run):
    assert "posterior" in sinew.results(copied_run).arviz("distal").groups()
    change_posterior(copied_run, external)
    with pytest.raises(
        BadInput, match=r"distal\.nc: E_f has its numbers elsewhere; expected what `sinew infer` writes"
    ):
        sinew.results(copied_run).arviz("distal")


def test_a_posterior_that_keeps_hdf5_busy_for_ever_is_refused(copied_run, monkeypatch):
    monkeypatch.setattr("sinew.interop.POSTERIOR_S", 5)
    path = copied_run / "infer" / "distal.nc"
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 16  # the first object of a heap: its number, in 8 bytes, its length, and its content
    for _ in range(4):
        at += 16 + -(-int.from_bytes(content[at + 8 : at + 16], "little") // 8) * 8
    content[at : at + 2] = bytes(2)  # the number of free space
    path.write_bytes(content)
    with pytest.raises(BadInput, match=r"distal\.nc: takes too long, or too much memory, to look at"):
        sinew.results(copied_run).arviz("distal")


@pytest.mark.parametrize(
    ("name", "attributes", "problem"),
    [
        ("more/numbers", {"scale_factor": 2.5}, r"holds [0-9,]+ bytes of numbers"),
        ("numbers", {"scale_factor": 2.5}, r"holds [0-9,]+ bytes of numbers"),
        ("day", {"units": "days since never"}, r"damaged \(.*days since never"),
        ("__class__/day", {}, r"damaged \(__class__ must be"),
    ],
)
def test_a_posterior_with_more_beside_its_draws_is_refused(copied_run, name, attributes, problem):
    def add(file):
        for number in range(40 if "numbers" in name else 1):  # a byte of each number is kept, and none was written
            one = file.create_dataset(f"{name}{number}", (10**6,), "i1", chunks=(10**6,), compression="gzip")
            one.attrs.update(attributes)

    change_posterior(copied_run, add)
    with pytest.raises(BadInput, match=rf"distal\.nc: {problem}"):
        sinew.results(copied_run).arviz("distal")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_draws_that_are_no_numbers_are_not_averaged(copied_run, value):
    change_posterior(copied_run, lambda file: file["posterior/E_f"].__setitem__((0, 3), value))
    with pytest.raises(BadInput, match=r"distal\.nc: has draws of E_f that are no finite numbers"):
        sinew.results(copied_run).arviz("distal")


def test_a_posterior_that_only_the_library_cannot_read_is_refused(copied_run):
    def without_dimensions(file):
        del file["posterior/draw"]

    change_posterior(copied_run, without_dimensions)
    with pytest.raises(BadInput, match=r"distal\.nc: damaged \(.*\); expected what `sinew infer` writes"):
        sinew.results(copied_run).arviz("distal")


def test_the_store_is_checked_before_it_opens_in_xarray(copied_run):
    """Zarr's codecs believe what a chunk says of itself."""
    (table, *_) = open_store(copied_run).tables()
    chunk = copied_run / "store.zarr" / "evaluations" / table.name / "wall_seconds" / "c" / "0"
    header = bytearray(chunk.read_bytes()[:16])
    chunk.write_bytes(header + chunk.read_bytes()[-4:])
    with pytest.raises(StoreError, match=r"a chunk claims [0-9,]+ bytes and has 20"):
        sinew.results(copied_run).xarray()
    names = [path.name for path in (copied_run / "store.zarr" / "sobol").iterdir() if path.is_dir()]
    (copied_run / "store.zarr" / "sobol" / names[0] / "zarr.json").unlink()
    chunk.unlink()
    with pytest.raises(StoreError, match="sobol: damaged"):
        sinew.results(copied_run).xarray()


def test_a_path_that_pyabc_would_cut_is_refused(copied_run, tmp_path):
    """What stands before the question mark would be opened, and written to."""
    shutil.copytree(copied_run, tmp_path / "a?b")
    with pytest.raises(BadInput, match=r"distal\.db: has a '\?' in its path"):
        sinew.results(tmp_path / "a?b").abc_history("distal")


@pytest.mark.parametrize("ending", ["-journal", "-wal", "-shm"])
def test_a_database_with_a_journal_is_refused(copied_run, ending):
    """SQLite deletes files that a journal names."""
    (copied_run / "infer" / f"distal.db{ending}").write_bytes(b"")
    with pytest.raises(BadInput, match=rf"distal\.db{ending}: is there"):
        sinew.results(copied_run).abc_history("distal")


def test_a_database_that_takes_too_long_to_check_is_refused(copied_run, monkeypatch):
    """One page that is named many times is a table without end."""
    monkeypatch.setattr("sinew.interop.STEP", 10)
    monkeypatch.setattr("sinew.interop.MAX_STEPS", 1)
    with pytest.raises(BadInput, match=r"distal\.db: damaged \(interrupted\)"):
        sinew.results(copied_run).abc_history("distal")
    monkeypatch.undo()
    path = copied_run / "infer" / "distal.db"
    content = path.read_bytes()
    with closing(sqlite3.connect(path)) as database:
        (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'parameters'").fetchone()
        (size,) = database.execute("PRAGMA page_size").fetchone()
    twice = bytearray(size)
    twice[0], twice[3:5], twice[5:7], twice[8:12] = 5, b"\0\1", (size - 6).to_bytes(2, "big"), root.to_bytes(4, "big")
    twice[12:14], twice[size - 6 :] = (size - 6).to_bytes(2, "big"), root.to_bytes(4, "big") + b"\x81\0"
    path.write_bytes(content[: (root - 1) * size] + twice + content[root * size :])
    with pytest.raises(BadInput, match=r"distal\.db: damaged"):
        sinew.results(copied_run).abc_history("distal")


def test_a_database_whose_schema_fills_the_memory_is_refused(copied_run):
    path = copied_run / "infer" / "distal.db"
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA writable_schema=ON")
        rows = ((f"t{i:x}", f"t{i:x}", f"CREATE TABLE t{i:x}(a)") for i in range(40_000))
        database.executemany("INSERT INTO sqlite_master VALUES('table', ?, ?, 2, ?)", rows)
        database.commit()
    with pytest.raises(BadInput, match=r"distal\.db: (holds [0-9,]+ tables|takes too long|damaged)"):
        sinew.results(copied_run).abc_history("distal")
