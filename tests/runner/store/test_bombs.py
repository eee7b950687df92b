"""A chunk that claims to hold more than it may is not decompressed."""

import resource
import struct
from pathlib import Path

import numpy as np
import pytest
from google_crc32c import value as checksum
from numcodecs import Blosc, Zstd

from sinew.runner.errors import StoreError
from sinew.runner.store.chunks import chunk_fault
from sinew.runner.store.store import Store, open_store
from tests.runner.evaluations import Quick, table_spec
from tests.runner.stores import fill, some


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with Store.writing(tmp_path, "study") as store:
        fill(store.table(table_spec()), some(20))
    return tmp_path


def blosc_bomb() -> bytes:
    packed = Blosc("lz4", 1, 0).encode(np.zeros(2**29, dtype="u1"))
    return packed + struct.pack("<I", checksum(packed))


def zstd_bomb() -> bytes:
    return bytes(Zstd().encode(np.zeros(2**29, dtype="u1")))


def bomb_of_texts() -> bytes:
    """Four bytes that promise two billion texts."""
    return bytes(Zstd().encode(struct.pack("<I", 2**31 - 1)))


BOMBS = [
    ("force", blosc_bomb),
    ("status", blosc_bomb),
    ("parameters", blosc_bomb),
    *((array, bomb) for array in ("worker", "protocol") for bomb in (zstd_bomb, bomb_of_texts)),
]


@pytest.mark.parametrize(("array", "bomb"), BOMBS)
def test_a_bomb_is_refused_and_removed(folder, array, bomb):
    (place,) = (folder / "store.zarr" / "evaluations").glob("specimen-*/" + array)
    chunk = next(path for path in (place / "c").rglob("*") if path.is_file())
    chunk.write_bytes(bomb())
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (in_use + 2**28, hard))
    try:
        with pytest.raises(StoreError, match=rf"{array}: damaged \(a chunk .*`sinew repair {folder}`"):
            for table in open_store(folder).tables():
                table.coordinate("protocol")
                table.read(array, np.arange(20))
        with Store.writing(folder, "study") as store:
            store.repair()
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    with Store.writing(folder, "study") as store:
        table = store.table(table_spec())
        rows = fill(table, some(20))
        assert np.array_equal(table.read("force", rows), Quick()(some(20)).values["force"])


def test_every_cut_of_names_is_seen(folder):
    (file,) = (folder / "store.zarr" / "evaluations").glob("specimen-*/worker/c/0")
    with Store.writing(folder, "study") as store:
        array = store.tables()[0].group["worker"]
    content = file.read_bytes()
    assert chunk_fault(file, array) == ""
    for size in range(len(content)):
        file.write_bytes(content[:size])
        assert chunk_fault(file, array) == "a chunk claims to hold too much, or is cut short", size
    file.write_bytes(2 * content)
    assert chunk_fault(file, array)
    file.unlink()
    assert chunk_fault(file, array) == ""
