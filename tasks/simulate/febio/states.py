"""The file from which an interrupted run goes on: the solver's own state, and what it had logged by then.

A solver believes whatever is in such a file, and a result folder may come from anybody. So each is signed with the
user's secret (:mod:`sinew.runner.secret`), and what is not signed with it is refused. The file holds the solver's dump,
a header, the length of the header, and the signature of all of that and of the file's name.
"""

import errno
import hashlib
import hmac
import json
import os
import struct
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import BinaryIO

from sinew.runner.files import NotReadable, new_file, open_regular

SIGNATURE, LENGTH = 32, struct.Struct("<Q")
PIECE = 2**20


@dataclass(frozen=True)
class State:
    """Where a run was: the content of its ``logs``, ``seconds`` of the solver so far, and those of a ``step``.

    ``ended``: it had come to its end. ``again``: it has started over, because it could not go on before.
    """

    logs: Mapping[str, bytes]
    seconds: float
    step: float = 0.0
    ended: bool = False
    again: bool = False


def write_state(path: Path, secret: bytes, state: State, dump: Path | None, max_bytes: int) -> None:
    """Write a state with the solver's ``dump`` of at most ``max_bytes``, if there is one; whole or not at all.

    Raises ``OSError``, and ``NotReadable`` where the dump is no file.
    """
    logs = {name: content.decode("latin-1") for name, content in state.logs.items()}
    header = json.dumps(asdict(replace(state, logs={})) | {"logs": logs}).encode()
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    signed = _signing(path, secret)
    try:
        with new_file(temporary, 0o600) as file:
            if dump is not None:
                with open(open_regular(dump, os.O_RDONLY | os.O_NOFOLLOW), "rb") as opened:
                    _copied(opened, file, signed, max_bytes)
            for part in (header, LENGTH.pack(len(header))):
                signed.update(part)
                file.write(part)
            file.write(signed.digest())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_state(path: Path, secret: bytes, dump: Path, max_bytes: int) -> State | None:
    """A state whose dump is written to the new file ``dump``, unless there was none; None where there is no file.

    It is copied before its signature is compared, so that nobody can exchange it meanwhile, and nothing of it is read
    before. Raises ``OSError`` for a disk that is full, and for a state that this user has not signed.
    """
    try:
        descriptor = open_regular(path, os.O_RDONLY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return None
    except NotReadable as kind:
        raise PermissionError(errno.EPERM, f"is {kind}, no state of a run; remove it", str(path)) from None
    with open(descriptor, "rb") as file, new_file(dump, 0o600) as copied:
        size = os.fstat(descriptor).st_size - SIGNATURE
        signed = _signing(path, secret)
        if not LENGTH.size <= size <= max_bytes:
            raise _foreign(path)
        _copied(file, copied, signed, size)
        if not hmac.compare_digest(signed.digest(), file.read()):
            raise _foreign(path)
    with open(dump, "r+b") as copied:
        copied.seek(size - LENGTH.size)
        (length,) = LENGTH.unpack(copied.read())
        copied.seek(size - LENGTH.size - length)
        known = json.loads(copied.read(length))
        copied.truncate(size - LENGTH.size - length)
    if not dump.stat().st_size:
        dump.unlink()
    logs = {name: text.encode("latin-1") for name, text in known.pop("logs").items()}
    return State(logs, **known)


def _foreign(path: Path) -> PermissionError:
    words = "was not signed by you, or with another home; remove it, and use one home on all nodes"
    return PermissionError(errno.EPERM, words, str(path))


def _copied(source: BinaryIO, target: BinaryIO, signed: "hashlib.blake2b", size: int) -> None:
    """Copy up to ``size`` bytes, and sign them; no more are there. Raises ``OSError``."""
    while size and (piece := source.read(min(PIECE, size))):
        signed.update(piece)
        target.write(piece)
        size -= len(piece)


def _signing(path: Path, secret: bytes) -> "hashlib.blake2b":
    """A signature begins with the name: the state of one run is none of another."""
    return hashlib.blake2b(path.name.encode() + b"\0", key=secret, digest_size=SIGNATURE)
