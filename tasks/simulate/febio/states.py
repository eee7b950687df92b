"""The file from which an interrupted run goes on: the solver's own state, and what it had logged by then.

A solver believes whatever is in such a file, and a result folder may come from anybody. So each is signed with the
user's secret (:mod:`sinew.runner.secret`), and what is not signed with it is as good as none.
"""

import hashlib
import hmac
import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from sinew.runner.files import NotReadable, new_file, open_regular

SIGNATURE, LENGTH = 32, struct.Struct("<Q")
MAX_HEADER = 2**30  # bytes: what was logged
PIECE = 2**22


@dataclass(frozen=True)
class State:
    """Where a run was: ``seconds`` of the solver so far, the content of its ``logs``, and whether it had ``ended``."""

    seconds: float
    logs: Mapping[str, bytes]
    ended: bool


def write_state(path: Path, secret: bytes, state: State, dump: Path | None) -> None:
    """Write a state with the solver's ``dump``, whole or not at all; of a run that has ended there is none.

    Raises ``OSError``.
    """
    logs = {name: content.decode("latin-1") for name, content in state.logs.items()}
    header = json.dumps({"seconds": state.seconds, "logs": logs, "ended": state.ended}).encode()
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    signed = _signing(path, secret)
    try:
        with new_file(temporary, 0o600) as file:
            file.write(bytes(SIGNATURE))
            for part in (LENGTH.pack(len(header)), header):
                signed.update(part)
                file.write(part)
            if dump is not None:
                with open(dump, "rb") as opened:
                    while piece := opened.read(PIECE):
                        signed.update(piece)
                        file.write(piece)
            file.seek(0)
            file.write(signed.digest())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_state(path: Path, secret: bytes, dump: Path, max_bytes: int) -> State | None:
    """A state of this user, of at most ``max_bytes``, whose dump is written to the new file ``dump``; None for none.

    What is read is copied before its signature is compared, so that nobody can exchange it meanwhile. Raises
    ``OSError`` for a disk that is full.
    """
    try:
        descriptor = open_regular(path, os.O_RDONLY | os.O_NOFOLLOW)
    except (OSError, NotReadable):
        return None
    with open(descriptor, "rb") as file:
        if os.fstat(descriptor).st_size > max_bytes:
            return None
        found = _signed(file, _signing(path, secret), dump)
    if found is None or found.ended:
        dump.unlink(missing_ok=True)
    return found


def _signing(path: Path, secret: bytes) -> "hashlib.blake2b":
    """A signature begins with the name: the state of one run is none of another."""
    return hashlib.blake2b(path.name.encode(), key=secret, digest_size=SIGNATURE)


def _signed(file: BinaryIO, signed: "hashlib.blake2b", dump: Path) -> State | None:
    signature, length = file.read(SIGNATURE), file.read(LENGTH.size)
    if len(length) < LENGTH.size or (size := LENGTH.unpack(length)[0]) > MAX_HEADER:
        return None
    header = file.read(size)
    signed.update(length + header)
    with new_file(dump, 0o600) as copied:
        while piece := file.read(PIECE):
            signed.update(piece)
            copied.write(piece)
    if not hmac.compare_digest(signed.digest(), signature):
        return None
    known = json.loads(header)
    return State(
        known["seconds"], {name: text.encode("latin-1") for name, text in known["logs"].items()}, known["ended"]
    )
