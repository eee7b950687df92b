"""The arrays of a task's result in the store, beside the evaluations: written with a list of them, checked when read.

A folder that somebody else made may hold arrays that fill the memory. One that lost files must not be shown as if
nothing were missing: Zarr passes over an array without ``zarr.json`` and reads a missing chunk as an empty one.
"""

import math
from pathlib import Path
from typing import Any

import xarray as xr
import zarr

from sinew.runner.store.chunks import chunk_files, codec_names, files_fault, text_fault, too_large, zstd_size
from sinew.runner.store.durable import DurableStore
from sinew.runner.store.layout import Damaged, check_group

ARRAYS = "arrays"  # attribute of a group: the names of its arrays; stores of version 0.1 do not have it
MAX_BYTES = 2**28  # of all arrays of a group, and of their chunks as Zarr decompresses them
MAX_MISSING = 1024  # chunks of an array without a list: those of version 0.1 were not written where all is empty
MAX_ITEMS = 2**20  # of an array of texts
LETTER_BYTES = 4  # that a letter may take in memory, where it is one byte in UTF-8
NUMBERS, TEXTS = ("bytes", "zstd"), ("vlen-utf8", "zstd")
#: Attributes by which xarray makes float64 of whatever numbers are in the store; none is written here.
SCALED = ("scale_factor", "add_offset", "missing_value", "_Unsigned")
#: How arrays are opened: no unit, such as that of an output, makes dates of numbers.
PLAIN: Any = {"consolidated": False, "decode_times": False, "decode_timedelta": False}


def write(path: Path, name: str, dataset: xr.Dataset) -> None:
    """Write a dataset as the group ``name`` of the store in ``path``."""
    texts = {
        str(variable): dataset[variable].astype(object)  # Zarr v3 has no fixed-width text
        for variable in dataset.variables
        if dataset[variable].dtype.kind == "U"
    }
    dataset = dataset.assign({n: v for n, v in texts.items() if n in dataset.data_vars})
    dataset = dataset.assign_coords({n: v for n, v in texts.items() if n in dataset.coords})
    dataset = dataset.assign_attrs({ARRAYS: sorted(map(str, dataset.variables))})
    target = DurableStore(path)
    dataset.to_zarr(target, group=name, mode="w", zarr_format=3, consolidated=False, write_empty_chunks=True)
    target.sync_folders()


def read(path: Path, group: zarr.Group, name: str) -> xr.Dataset:
    """The dataset in ``group``, which is ``name`` of the store in ``path``. Raises :class:`Damaged`, and as Zarr."""
    check(path, group, name)
    dataset = xr.open_zarr(path, group=name, zarr_format=3, chunks=None, **PLAIN).load()
    dataset.attrs.pop(ARRAYS, None)
    return dataset


def check(path: Path, group: zarr.Group, name: str) -> None:
    """Raises :class:`Damaged` for a ``group`` with an array that :func:`write` does not make, and as Zarr."""
    folder = path / name
    check_group(group)
    listed = group.attrs.get(ARRAYS)
    if listed is not None and not (isinstance(listed, list) and all(isinstance(one, str) for one in listed)):
        raise Damaged(f"its list of arrays is {str(listed)[:40]}")
    there = {each.name for each in folder.iterdir() if each.is_dir()}
    total = 0
    for one in sorted(there | set(listed or ())):
        if not (folder / one / "zarr.json").is_file():
            raise Damaged(f"the array {one} is missing")
        array = group.get(one)
        if isinstance(array, zarr.Group):
            continue
        if not isinstance(array, zarr.Array):
            raise Damaged(f"the zarr.json of {one} is not that of an array")
        total += _checked(array, folder / one, whole=listed is not None)
        if total > MAX_BYTES:
            raise Damaged(f"its arrays take more than {MAX_BYTES:,} bytes")


def scaled_by(array: zarr.Array[Any]) -> str | None:
    """The attribute by which xarray would make more of an array than is there, if it has one."""
    names = SCALED if array.dtype.kind == "f" else (*SCALED, "_FillValue")
    return next((name for name in names if name in array.attrs), None)


def _checked(array: zarr.Array[Any], folder: Path, *, whole: bool) -> int:
    """The bytes that an array takes in memory. Raises :class:`Damaged` for one that :func:`write` does not make."""
    text = array.dtype.kind in "OT"
    if fault := files_fault(array):
        raise Damaged(f"{folder.name}: {fault}")
    if scaled := scaled_by(array):
        raise Damaged(f"{folder.name} has the attribute {scaled}")
    codecs = codec_names(array)
    if codecs != (TEXTS if text else NUMBERS):
        raise Damaged(f"the codecs of {folder.name} are {', '.join(codecs)}")
    if 0 in array.chunks or (text and max(map(math.prod, (array.shape, array.chunks))) > MAX_ITEMS):
        raise Damaged(f"the shape of {folder.name} is {array.shape}, its chunks are {array.chunks}")
    size, chunk = (array.dtype.itemsize * math.prod(shape) for shape in (array.shape, array.chunks))
    if max(size, chunk) > MAX_BYTES or too_large(array):
        raise Damaged(f"the shape of {folder.name} is {array.shape}, its chunks are {array.chunks}")
    files = chunk_files(folder / "c")
    chunks = math.prod(-(-n // part) for n, part in zip(array.shape, array.chunks, strict=True))
    if whole and len(files) != chunks:
        raise Damaged(f"a chunk of {folder.name} is missing")
    if chunks > max(len(files), MAX_MISSING):
        raise Damaged(f"{folder.name} claims {chunks:,} chunks")
    taken = max(size, chunks * chunk)  # chunks at the end of an axis are as large as all others
    for file in files:
        content = file.read_bytes() if file.stat().st_size <= MAX_BYTES else b""
        if text and (fault := text_fault(content, math.prod(array.chunks))):
            raise Damaged(fault.replace("a chunk", f"a chunk of {folder.name}"))
        claimed = zstd_size(content)
        if not text and claimed != chunk:
            raise Damaged(f"a chunk of {folder.name} claims to hold too much, or is cut short")
        taken += LETTER_BYTES * (claimed or 0) if text else 0
        if taken > MAX_BYTES:
            break
    return taken
