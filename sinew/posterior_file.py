"""A look at a NetCDF 4 file of draws, which is HDF5, before a library opens it: all of it must be plain and small.

A byte that is wrong may keep HDF5 busy for ever, so the look has a process of its own, with limits.
"""

import json
import math
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from sinew.runner.limits import limit
from sinew.tasks.infer.library import arviz

MAX_DRAWS = 10**6  # numbers of one variable, and of one of its chunks
WIDEST = 8  # bytes of such a number
MAX_BYTES = 2**28  # of all variables together
MOST_OBJECTS = 1000  # variables and groups
MOST_ATTRIBUTES, MAX_ATTRIBUTE_BYTES = 100, 2**15  # of each
MOST_TEXTS, MAX_TEXT_BYTES = 10_000, 2**20  # of a variable of texts
KINDS = "biufSO"  # of numbers and texts; others are made of parts, each of which may be a text
DEFLATE, SHUFFLE, FLETCHER = 1, 2, 3  # HDF5's numbers of its filters
CHECKSUM_BYTES = 4
MOST_AXES = 8  # of a variable, each of which is a list of references
MEMORY_BYTES = 2**31  # of the process


def main() -> None:
    """Look at the file of the first argument, and read it as the library does; writes what is wrong as JSON.

    The second says how many bytes it may have, the third how many seconds of a processor all of this may take.
    """
    limit(MEMORY_BYTES, int(sys.argv[3]))
    path = Path(sys.argv[1])
    sys.stdout.write(json.dumps(fault(path, int(sys.argv[2])) or _unreadable(path)))


def _unreadable(path: Path) -> str | None:
    """Why ArviZ cannot read the whole file, or None. Names of groups become attributes of what it returns."""
    try:
        found = arviz().from_netcdf(str(path), engine="h5netcdf")
        for group in found.groups():
            found[group].load()
        for name, values in found["posterior"].data_vars.items() if "posterior" in found.groups() else ():
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                return f"has draws of {name} that are no finite numbers"
    except Exception as error:  # noqa: BLE001 - what libraries raise for damaged files is no closed list
        return f"damaged ({error})"
    return None


def fault(path: Path, max_bytes: int) -> str | None:
    """Why a file must not be opened: its numbers are in other files, or it holds more than is written; or None."""
    import h5py  # type: ignore[import-untyped]

    if (size := path.stat().st_size) > max_bytes:
        return f"has {size:,} bytes"
    try:
        with h5py.File(path, "r") as file:
            datasets: dict[int, Any] = {}
            found = _of_attributes("it", file) or _of_group(file, datasets)
            # whatever a file keeps, with an attribute scale_factor it is read as float64
            total = sum(one.size * WIDEST for one in datasets.values() if one is not None)
            return found or (f"holds {total:,} bytes of numbers" if total > MAX_BYTES else None)
    except (OSError, RuntimeError, ValueError, KeyError, RecursionError, zlib.error) as error:
        return f"damaged ({error})"


def _of_group(group: Any, seen: dict[int, Any]) -> str | None:
    """What is wrong below a group; ``seen`` holds all datasets so far, and None for groups, by their place."""
    import h5py

    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            return f"{name} is a link"
        one = group[name]
        place = h5py.h5o.get_info(one.id).addr
        if place in seen:
            return f"{name} is there twice"
        if len(seen) == MOST_OBJECTS:
            return f"{name} is one of more than {MOST_OBJECTS} objects"
        is_group = isinstance(one, h5py.Group)
        seen[place] = None if is_group else one
        if found := _of_attributes(name, one) or (_of_group(one, seen) if is_group else _of_dataset(name, one)):
            return found
    return None


def _of_dataset(name: str, one: Any) -> str | None:
    import h5py

    if not isinstance(one, h5py.Dataset) or one.external or one.is_virtual:
        return f"{name} has its numbers elsewhere"
    if one.size is None or one.size > MAX_DRAWS:
        return f"{name} has {one.size} numbers"
    if one.dtype.kind not in KINDS:
        return f"{name} has parts that are no numbers"
    if one.dtype.itemsize > WIDEST:
        return f"{name} has numbers of {one.dtype.itemsize} bytes"
    if one.chunks is not None and (size := math.prod(one.chunks)) > MAX_DRAWS:
        return f"{name} has chunks of {size:,} numbers"
    if found := _of_chunks(name, one):
        return found
    if one.dtype.kind == "O" and (one.size > MOST_TEXTS or one.ndim > 1 or _length(one) > MAX_TEXT_BYTES):
        return f"{name} has texts of more than {MAX_TEXT_BYTES:,} bytes"
    return None


def _of_chunks(name: str, one: Any) -> str | None:
    """What is wrong with chunks as they are stored: HDF5 inflates them to whatever they hold."""
    filters = one.id.get_create_plist()
    kinds = [filters.get_filter(i)[0] for i in range(filters.get_nfilters())]
    if kinds.count(DEFLATE) > 1 or set(kinds) - {DEFLATE, SHUFFLE, FLETCHER}:
        return f"{name} is compressed in an unusual way"
    if DEFLATE not in kinds:
        return None
    most = math.prod(one.chunks) * one.dtype.itemsize + CHECKSUM_BYTES
    for i in range(one.id.get_num_chunks()):
        chunk = one.id.get_chunk_info(i)
        if chunk.size > 2 * most + 2**10:
            return f"{name} has a chunk of {chunk.size:,} bytes"
        if not chunk.filter_mask >> kinds.index(DEFLATE) & 1:  # else it is stored as it is
            _, raw = one.id.read_direct_chunk(chunk.chunk_offset)
            if len(zlib.decompressobj().decompress(raw, most + 1)) > most:
                return f"{name} has a chunk that holds more than it should"
    return None


def _of_attributes(name: str, one: Any) -> str | None:
    import h5py

    if not hasattr(one, "attrs"):
        return None
    if len(one.attrs) > MOST_ATTRIBUTES:
        return f"{name} has {len(one.attrs):,} attributes"
    for each in one.attrs:
        found = one.attrs.get_id(each)
        if not _is_plain(found.dtype):
            return f"{name} has an attribute with parts that are no numbers"
        size, references = found.get_storage_size(), found.dtype.kind == "O"  # that of references
        most = 1 if h5py.check_string_dtype(found.dtype) else MOST_AXES  # all may be the same long one
        if references and math.prod(found.shape) > most:
            return f"{name} has an attribute of {math.prod(found.shape):,} texts or lists"
        if references:
            size = max(size, _length(np.atleast_1d(one.attrs[each])))
        if size > MAX_ATTRIBUTE_BYTES:
            return f"{name} has an attribute of {size:,} bytes"
    return None


def _is_plain(dtype: Any) -> bool:
    """Whether a type is one of numbers, texts or references, or made of numbers and references alone."""
    import h5py

    if dtype.kind != "V":
        return dtype.kind in KINDS
    parts = [dtype.fields[name][0] for name in dtype.names] if dtype.names else [None]
    return all(part is not None and (part.kind in "biuf" or h5py.check_ref_dtype(part)) for part in parts)


def _length(texts: Any) -> int:
    """The letters of some texts, or the items of lists; each may be the same long one. Counted as far as is allowed."""
    total = 0
    for number in range(len(texts)):
        total += len(text) if hasattr(text := texts[number], "__len__") else 8
        if total > MAX_TEXT_BYTES:
            break
    return total
