"""Whether the arrays of a table are what :mod:`sinew.runner.store.arrays` creates: a store may come from anywhere.

What a damaged ``zarr.json`` says would otherwise be believed: rows that fill the memory, chunks of another size.
"""

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from sinew.runner.store.chunks import chunk_fault, chunk_files, codecs_fault
from sinew.runner.store.schema import MAX_CHUNK_ROWS, PENDING, STATUSES, Array

MAX_ROWS = 2**24
MAX_CHUNK_BYTES = 2**28  # a chunk has 16 rows at least, so this is a curve of two million points
MAX_COORDINATE = 2**22
MAX_IDENTITY = 2**22  # characters: of a site of some ten thousand curves
KEY_DIGITS = 12  # of a key: the name of its folder in the journal, and the end of its table's name
_KEY = re.compile(r"[0-9a-f]{32}")
#: The types of the columns; fields and parameters are float64.
KINDS = {"status": "int8", "attempts": "int16", "wall_seconds": "float64", "worker": "text", "message": "text"}


class Damaged(ValueError):
    """An array is missing, or not what was created; the words say in what."""


def table_group(root: zarr.Group, name: str) -> zarr.Group:
    """The group of a table. Raises :class:`Damaged`, and whatever Zarr raises."""
    group = root.get(f"evaluations/{name}")
    if not isinstance(group, zarr.Group):
        raise Damaged(f"the zarr.json of {name} is not that of a table")
    check_group(group)
    return group


def check_group(group: zarr.Group) -> None:
    """Raises :class:`Damaged` for a group that describes its arrays itself: Zarr would believe it, and not them."""
    if group.metadata.consolidated_metadata is not None:
        raise Damaged("it holds metadata of its arrays")


def table_key(group: zarr.Group) -> str:
    """The key of a table, which also names a folder of the journal. Raises :class:`Damaged`."""
    key = group.attrs.get("key")
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise Damaged(f"key is {str(key)[:40]!r}")
    return key


def journal_of(name: str) -> str | None:
    """The folder in the journal of the table ``name``, None where the name is none that is written here."""
    key = name.rpartition("-")[2]
    return key if re.fullmatch(rf"[0-9a-f]{{{KEY_DIGITS}}}", key) else None


def is_plain(name: object) -> bool:
    """Whether a name is that of an array beside others: one that leads elsewhere would be followed."""
    return isinstance(name, str) and 0 < len(name) <= 255 and name not in (".", "..") and not set(name) & set("/\\\0")


def has(group: zarr.Group, name: str) -> bool:
    """Whether a group has an array or group of this name."""
    return is_plain(name) and name in group


def chunk_rows_of(group: zarr.Group) -> int:
    """The rows of a chunk that a table's attributes say. Raises :class:`Damaged`."""
    rows = group.attrs.get("chunk_rows")
    if not isinstance(rows, int) or isinstance(rows, bool) or not 0 < rows <= MAX_CHUNK_ROWS:
        raise Damaged(f"chunk_rows is {rows!r}")
    return rows


def identity_of(group: zarr.Group) -> dict[str, Any]:
    """What the outcomes of a table depend on, by its attributes. Raises ``ValueError``."""
    text = str(group.attrs["identity"])
    if len(text) > MAX_IDENTITY:
        raise Damaged(f"its identity has {len(text):,} characters")
    return dict(json.loads(text))


def fields_of(group: zarr.Group) -> tuple[str, ...]:
    """The names of a table's fields. Raises :class:`Damaged`."""
    fields = group.attrs.get("fields")
    if not isinstance(fields, list) or not all(map(is_plain, fields)) or len(set(fields)) < len(fields):
        raise Damaged(f"fields are {str(fields)[:40]}")
    return tuple(fields)


def row_array(group: zarr.Group, name: str) -> zarr.Array[Any]:
    """An array with a row for each row of the table. Raises :class:`Damaged`, and whatever Zarr raises."""
    array = _array(group, name)
    chunk_rows = chunk_rows_of(group)
    ndim = 2 if name == "parameters" else 1 if name in KINDS else array.ndim
    dims = array.metadata.dimension_names or ()  # type: ignore[union-attr]
    if array.ndim != ndim or not array.ndim or len(dims) != array.ndim or dims[0] != "row":
        raise Damaged(f"its dimensions are {dims}, its shape is {array.shape}")
    if not all(map(is_plain, dims)):
        raise Damaged(f"its dimensions are {str(dims)[:40]}")
    for dim, size in zip(dims[1:], array.shape[1:], strict=True):
        if isinstance(along := group.get(str(dim)), zarr.Array) and along.shape != (size,):
            raise Damaged(f"its shape is {array.shape}, but {dim} has {along.shape}")
    if _kind(array) != KINDS.get(name, "float64"):
        raise Damaged(f"it holds {array.dtype}")
    if array.chunks != (chunk_rows, *array.shape[1:]) or 0 in array.chunks:
        raise Damaged(f"its chunks are {array.chunks} of a shape {array.shape}")
    if array.dtype.itemsize * math.prod(array.chunks) > MAX_CHUNK_BYTES:
        raise Damaged(f"a chunk of it has a shape of {array.chunks}")
    if array.shape[0] > MAX_ROWS:
        raise Damaged(f"it has {array.shape[0]:,} rows")
    return array


def check_chunks(array: zarr.Array[Any], folder: Path) -> None:
    """Raises :class:`Damaged` for a chunk of the array in ``folder`` that must not be decompressed."""
    for file in chunk_files(folder / "c"):
        if fault := chunk_fault(file, array):
            raise Damaged(fault)


def coordinate(group: zarr.Group, name: str, folder: Path) -> Array:
    """The values of a coordinate in ``folder``. Raises :class:`Damaged`, and whatever Zarr raises."""
    array = _array(group, name)
    if array.ndim != 1 or not 0 < array.shape[0] <= MAX_COORDINATE or array.chunks != array.shape:
        raise Damaged(f"its shape is {array.shape}, its chunks are {array.chunks}")
    if _kind(array) not in ("float64", "text"):
        raise Damaged(f"it holds {array.dtype}")
    check_chunks(array, folder)
    if not chunk_files(folder / "c"):  # Zarr would read NaN or empty names
        raise Damaged("its chunk is missing")
    return np.asarray(array[:])


def check_arrays(group: zarr.Group, folder: Path) -> None:
    """Raises :class:`Damaged` for any array of a table that must not be read, and whatever Zarr raises."""
    for name in group.array_keys():
        array = _array(group, name)
        if (array.metadata.dimension_names or ("",))[0] == "row":  # type: ignore[union-attr]
            check_chunks(row_array(group, name), folder / name)
        else:
            coordinate(group, name, folder / name)


def status_array(group: zarr.Group, folder: Path) -> zarr.Array[Any]:
    """The array of statuses, whose length is the number of rows. Raises :class:`Damaged`, and whatever Zarr raises.

    Each row has parameters, so there are no more rows than chunks of parameters in ``folder``; some may be lost.
    """
    array = row_array(group, "status")
    if array.shape[0] > 2 * chunk_rows_of(group) * (_chunks(folder / "parameters") + 8):
        raise Damaged(f"it has {array.shape[0]:,} rows, but parameters are there for fewer")
    return array


def statuses(group: zarr.Group, folder: Path) -> Array:
    """The status of each row ``[n]``. Raises :class:`Damaged`, and whatever Zarr raises."""
    array = status_array(group, folder)
    check_chunks(array, folder / "status")
    status = np.asarray(array[:])
    if (wrong := unknown_status(status)).any():
        raise Damaged(f"a status is {status[wrong][0]}")
    return status


def unknown_status(values: Array) -> Array:
    """Which of ``values`` are no status."""
    return np.asarray((values < PENDING) | (values >= len(STATUSES)))


def _array(group: zarr.Group, name: str) -> zarr.Array[Any]:
    array = group.get(name) if is_plain(name) else None
    if not isinstance(array, zarr.Array):  # some faults in its zarr.json make Zarr say that there is none
        raise Damaged("the array is missing")
    if fault := codecs_fault(array):
        raise Damaged(fault)
    return array


def _kind(array: zarr.Array[Any]) -> str:
    return "text" if array.dtype.kind in "OT" else array.dtype.name


def _chunks(folder: Path) -> int:
    try:
        return sum(1 for _ in (folder / "c").iterdir())
    except FileNotFoundError:
        return 0
