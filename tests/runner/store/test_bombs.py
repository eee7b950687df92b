"""A chunk that claims to hold more than it may is not decompressed."""

import os
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


def lying(nbytes: int, own: int, content: bytes = b"") -> bytes:
    """A chunk that is stored as it is, of a header that says what it holds and how long it is."""
    packed = struct.pack("<BBBBIII", 2, 1, 2, 8, nbytes, nbytes, own) + content
    return packed + struct.pack("<I", checksum(packed))


def test_a_chunk_that_says_it_is_longer_is_not_read_beyond_its_end(folder):
    """Blosc would give the memory of the process that lies behind it."""
    (file,) = (folder / "store.zarr" / "evaluations").glob("specimen-*/wall_seconds/c/0")
    array = open_store(folder).tables()[0].group["wall_seconds"]
    holds = 8 * array.chunks[0]
    file.write_bytes(lying(holds, holds + 16))
    with pytest.raises(StoreError, match=f"a chunk claims {holds + 20:,} bytes and has 20"):
        open_store(folder).tables()[0].read("wall_seconds", np.arange(20))
    for header, words in ((lying(holds, 8 * holds), "not one of"), (b"\2\1", "cut short")):
        file.write_bytes(header)
        assert words in chunk_fault(file, array)
    file.write_bytes(lying(holds, holds + 16, bytes(holds)))
    assert chunk_fault(file, array) == ""
    assert not open_store(folder).tables()[0].read("wall_seconds", np.arange(20)).any()


@pytest.mark.parametrize("file", ["zarr.json", "{table}/zarr.json", "{table}/status/zarr.json", "{table}/status/c/0"])
def test_a_file_larger_than_any_that_is_written_is_not_read(folder, file):
    """Sparse files take no room on the disk, and as much memory as they claim."""
    (table,) = (folder / "store.zarr" / "evaluations").glob("specimen-*")
    path = folder / "store.zarr" / file.format(table=table.relative_to(folder / "store.zarr"))
    os.truncate(path, 2**31)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    in_use = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (in_use + 2**28, hard))
    try:
        with pytest.raises(StoreError, match=r"damaged \(.*2,147,483,648"):
            list(open_store(folder).tables()[0].status)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


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
