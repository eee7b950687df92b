"""What the file of a chunk claims to hold, read from its header before it is decompressed.

A few damaged or hostile bytes may claim gigabytes, which a decompressor would ask of the memory first.
"""

import math
import os
import struct
from pathlib import Path
from typing import Any

import zarr

MAX_TEXT_BYTES = 2**25  # of a chunk of names or messages
NUMBERS, TEXTS = ("bytes", "blosc", "crc32c"), ("vlen-utf8", "zstd")
BLOSC_HEADER = struct.Struct("<4xI4xI")  # the bytes that it holds, and those of itself
BLOSC_MOST, CHECKSUM = 16, 4  # bytes that Blosc may add to what cannot be compressed; of the CRC32C behind it
_COUNT, _ZSTD = struct.Struct("<I"), b"\x28\xb5\x2f\xfd"


def codecs_fault(array: zarr.Array[Any]) -> str:
    """What is wrong with the codecs of an array, or nothing: only those that are written here are read."""
    allowed = TEXTS if array.dtype.kind in "OT" else NUMBERS
    names = codec_names(array)
    return files_fault(array) or ("" if names == allowed else f"its codecs are {', '.join(names)}")


def codec_names(array: zarr.Array[Any]) -> tuple[str, ...]:
    """The names of an array's codecs, in their order."""
    return tuple(str(codec.to_dict()["name"]) for codec in array.metadata.codecs)  # type: ignore[union-attr]


def files_fault(array: zarr.Array[Any]) -> str:
    """What is wrong with the names of an array's chunks, or nothing: others than ``c/0/1`` would be read unchecked."""
    named = array.metadata.to_dict().get("chunk_key_encoding")
    return "" if named == {"name": "default", "configuration": {"separator": "/"}} else f"its chunks are named {named}"


def too_large(array: zarr.Array[Any]) -> bool:
    """Whether a chunk is larger than the array: it would take memory for what nobody sees."""
    return any(part > max(length, 1) for length, part in zip(array.shape, array.chunks, strict=True))


def chunk_fault(file: Path, array: zarr.Array[Any]) -> str:
    """Why the file of a chunk must not be decompressed, or nothing. Raises ``OSError``."""
    try:
        return _fault(file, array)
    except FileNotFoundError:  # removed meanwhile: Zarr reads an empty chunk
        return ""


def _fault(file: Path, array: zarr.Array[Any]) -> str:
    if array.dtype.kind not in "OT":
        with file.open("rb") as opened:
            header, size = opened.read(BLOSC_HEADER.size), os.fstat(opened.fileno()).st_size
        return blosc_fault(header, size, array.dtype.itemsize * math.prod(array.chunks))
    if file.stat().st_size > MAX_TEXT_BYTES:
        return f"a chunk has more than {MAX_TEXT_BYTES:,} bytes"
    return text_fault(file.read_bytes(), math.prod(array.chunks))


def blosc_fault(header: bytes, size: int, expected: int) -> str:
    """Why a chunk of numbers must not be decompressed, or nothing, by the ``header`` of its file of ``size`` bytes.

    Blosc is not told where its input ends: it believes the header, and reads the memory behind a file that is shorter.
    """
    if len(header) < BLOSC_HEADER.size:
        return "a chunk is cut short"
    holds, own = BLOSC_HEADER.unpack(header)
    if holds != expected or own > expected + BLOSC_MOST:
        return f"a chunk is not one of {expected:,} bytes"
    return "" if own + CHECKSUM == size else f"a chunk claims {own + CHECKSUM:,} bytes and has {size:,}"


def text_fault(content: bytes, count: int) -> str:
    """Why a chunk of ``count`` texts must not be decoded, or nothing.

    It begins with the number of its texts, for which memory is taken before the first of them is read.
    """
    claimed = zstd_size(content)
    if claimed is None or claimed > MAX_TEXT_BYTES:
        return "a chunk claims to hold too much, or is cut short"
    import pyarrow  # type: ignore[import-untyped]  # slow to import

    try:
        with pyarrow.CompressedInputStream(pyarrow.BufferReader(content), "zstd") as texts:
            begin = texts.read(_COUNT.size)
    except OSError as error:
        return str(error)
    if len(begin) < _COUNT.size or _COUNT.unpack(begin)[0] != count:
        return f"a chunk does not hold {count:,} texts"
    return ""


def chunk_files(folder: Path) -> list[Path]:
    """The files of all chunks of the array in ``folder``, or of a part of it."""
    there = [folder] if folder.is_file() else folder.rglob("*")
    return [path for path in there if path.suffix != ".partial" and path.is_file()]  # Zarr renames what it has written


def zstd_size(content: bytes) -> int | None:
    """The size of what a single Zstandard frame holds (RFC 8878, section 3.1), None for anything else."""
    if len(content) < 6 or content[:4] != _ZSTD:
        return None
    described = content[4]
    single, checked = described >> 5 & 1, described >> 2 & 1
    at = 5 + (1 - single) + (0, 1, 2, 4)[described & 3]
    length = (single, 2, 4, 8)[described >> 6]
    if not length or len(content) < at + length:
        return None
    size = int.from_bytes(content[at : at + length], "little") + (256 if length == 2 else 0)
    at += length
    last = False
    while not last:  # blocks, each of which says its length
        header = int.from_bytes(content[at : at + 3], "little")
        if at + 3 > len(content):
            return None
        last, kind = bool(header & 1), header >> 1 & 3
        at += 3 + (1 if kind == 1 else header >> 3)
    return size if at + 4 * checked == len(content) else None
