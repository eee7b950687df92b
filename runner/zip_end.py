"""The end of a zip, which tells how long its list of members is: asked before anything believes it.

Source: APPNOTE.TXT of PKWARE, sections 4.3.14 to 4.3.16. Zips that sinew writes have no comment, so the records stand
at the very end.
"""

import os
import struct
from typing import BinaryIO

_END = struct.Struct("<4s4H2LH")  # of the central directory
_LOCATOR = struct.Struct("<4sLQL")  # of the record below,
_END_64 = struct.Struct("<4sQ2H2L4Q")  # where numbers are too large for the first one


def directory_of(file: BinaryIO) -> tuple[int, int]:
    """How many members a zip lists, and the bytes of that list. Raises ``ValueError`` for what is none."""
    length = file.seek(0, os.SEEK_END)
    file.seek(max(0, length - _END.size - _LOCATOR.size - _END_64.size))
    tail = file.read(_END.size + _LOCATOR.size + _END_64.size)
    if len(tail) < _END.size:
        raise ValueError("it is no zip")
    signature, *_, count, size, _, comment = _END.unpack(tail[-_END.size :])
    if signature != b"PK\5\6" or comment:
        raise ValueError("it does not end as a zip")
    before = tail[: -_END.size]
    if before[-_LOCATOR.size :][:4] != b"PK\6\7":
        return count, size
    if len(before) < _LOCATOR.size + _END_64.size:
        raise ValueError("it does not end as a zip")
    _, _, at, _ = _LOCATOR.unpack(before[-_LOCATOR.size :])
    signature, *_, count, size, _ = _END_64.unpack(before[: -_LOCATOR.size])
    if signature != b"PK\6\6" or at != length - len(tail):
        raise ValueError("it does not end as a zip")
    return count, size
