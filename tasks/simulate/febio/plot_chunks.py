"""The chunks of FEBio's plot file: a tag, a size and a content, all little-endian, nested in each other.

The file is untrusted. Every size is compared with the bytes that are there, and what a compressed part may become is
limited before it is decompressed. Any damage raises :class:`Failed` with ``bad_output``.
"""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from sinew.runner.errors import shown
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.row_by_row import Failed

MAGIC = b"BEF\0"
ROOT, HEADER, DICTIONARY, MESH, STATE = 0x01000000, 0x01010000, 0x01020000, 0x01040000, 0x02000000
MAX_NAME = 512
MAX_TAGS = 64  # different chunks in a chunk; the format has at most nine
PIECE = 2**16  # bytes that are decompressed together
_HEAD = struct.Struct("<II")


def damaged(what: str) -> Failed:
    """The error for a plot file that is not what the solver writes."""
    return Failed("bad_output", f"plot file: {what}")


def chunks(content: memoryview, what: str) -> Iterator[tuple[int, memoryview]]:
    """Tags and contents of the chunks that fill ``content``, which is ``what`` in a message."""
    at = 0
    while at < len(content):
        if len(content) - at < _HEAD.size:
            raise damaged(f"{what} ends in the middle of a chunk")
        tag, size = _HEAD.unpack_from(content, at)
        at += _HEAD.size
        if size > len(content) - at:
            raise damaged(f"a chunk in {what} claims {size:,} of {len(content) - at:,} bytes")
        yield tag, content[at : at + size]
        at += size


def one_of_each(content: memoryview, what: str, *, again: int = 0) -> dict[int, memoryview]:
    """The chunks in ``content`` by tag, at most ``MAX_TAGS``. Each is there once, or ``again`` times more."""
    found: dict[int, memoryview] = {}
    for tag, inside in chunks(content, what):
        if tag in found:
            again -= 1
            if again < 0:
                raise damaged(f"{what} has the chunk {tag:#010x} too often")
        if len(found) == MAX_TAGS and tag not in found:
            raise damaged(f"{what} has more than {MAX_TAGS} parts")
        found[tag] = inside
    return found


def integer(found: dict[int, memoryview], tag: int, what: str, default: int | None = None) -> int:
    """The whole number in the chunk ``tag``; ``default`` where there is none."""
    if tag not in found:
        if default is not None:
            return default
        raise damaged(f"{what} is missing")
    if len(found[tag]) != 4:
        raise damaged(f"{what} has {len(found[tag])} bytes, not 4")
    return int.from_bytes(found[tag], "little")


def name_in(content: memoryview, what: str, *, counted: bool) -> str:
    """A name: ``counted`` ones begin with their length, others end with a zero byte."""
    raw = bytes(content[: MAX_NAME + 4])
    if counted:
        if len(content) < 4 or int.from_bytes(raw[:4], "little") != len(content) - 4:
            raise damaged(f"{what} has another length than it claims")
        raw = raw[4:]
    raw = raw.split(b"\0", 1)[0]
    if len(raw) > MAX_NAME:
        raise damaged(f"{what} has more than {MAX_NAME} bytes")
    text = raw.decode("utf-8", "replace")
    if not text.isprintable():
        raise damaged(f"{what} is {shown(text)}")
    return text


def records(content: memoryview, tag: int, width: int, what: str) -> Array:
    """Equal chunks ``tag`` of ``width`` whole numbers each, as ``[n, width]`` int32."""
    size = _HEAD.size + 4 * width
    if len(content) % size:
        raise damaged(f"{what} is no list of {width} numbers each")
    table = np.frombuffer(content, "<i4").reshape(-1, width + 2)
    if not ((table[:, 0] == tag) & (table[:, 1] == 4 * width)).all():
        raise damaged(f"{what} holds other chunks")
    return table[:, 2:]


def states(content: memoryview, max_bytes: int) -> Iterator[memoryview]:
    """The states after the mesh, decompressed where they are compressed, to ``max_bytes`` together at most."""
    at, left = 0, max_bytes
    while at < len(content):
        if content[at : at + 4] == STATE.to_bytes(4, "little"):
            tag, size = _HEAD.unpack(content[at : at + 8]) if len(content) - at >= 8 else (0, 0)
            state, at = content[at : at + 8 + size], at + 8 + size
        else:
            state, at = _decompressed(content, at, left)
        left -= len(state)
        if left < 0:
            raise damaged(f"its states have more than {max_bytes:,} bytes")
        ((tag, inside),) = _only(state)
        if tag != STATE:
            raise damaged(f"a chunk {tag:#010x} where a state is expected (a mesh that changes cannot be read)")
        yield inside


def _only(state: memoryview) -> list[tuple[int, memoryview]]:
    found = list(chunks(state, "a state"))
    if len(found) != 1:
        raise damaged("a compressed part holds something else than one state")
    return found


def _decompressed(content: memoryview, at: int, most: int) -> tuple[memoryview, int]:
    """The compressed part that begins at ``at``, and where the next one begins."""
    stream = zlib.decompressobj()
    found = bytearray()
    try:
        while not stream.eof:
            if at == len(content):
                raise damaged("it ends in the middle of a compressed state")
            piece = content[at : at + PIECE]
            at += len(piece)
            found += stream.decompress(piece, most + 1 - len(found))
            if len(found) > most or stream.unconsumed_tail:
                raise damaged(f"its states have more than {most:,} bytes")
    except zlib.error:
        raise damaged("neither a state nor compressed data where a state is expected") from None
    return memoryview(found).toreadonly(), at - len(stream.unused_data)
