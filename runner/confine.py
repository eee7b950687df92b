"""Programs that can write in their own folder only, and cannot reach other programs (Linux).

A solver is a large program that nobody has proved safe, and its input may come from somebody else. Landlock, a part of
Linux since 5.13, keeps what it writes inside a folder. A filter of system calls refuses what Landlock does not know:
connections, changes of permissions, other processes' memory. Both need no rights, hold for a thread and all that it
starts, and cannot be taken back. A system without them confines nothing: :func:`means` says which of them it has.

The numbers are those of ``linux/landlock.h``, ``linux/seccomp.h``, ``linux/filter.h`` and the tables of system calls.
"""

import ctypes
import errno
import os
import platform
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import IO

_CREATE, _ADD, _RESTRICT = 444, 445, 446  # system calls of Landlock, the same for all processors
_VERSION, _BENEATH = 1, 1
_NO_NEW_PRIVILEGES, _SET_FILTER, _BY_FILTER = 38, 22, 2  # of prctl
_WRITE, _REMOVE_AND_MAKE = 1 << 1, 0b1_1111_1111 << 4  # rights of files; from "remove a folder" to "make a link"
_SINCE = {2: 1 << 13, 3: 1 << 14, 5: 1 << 15}  # by version: move between folders, truncate, commands to devices
_TCP, _SCOPES = 0b11, 0b11  # bind and connect; abstract sockets and signals
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full")

#: By processor: its name for filters, and the refused calls: of sockets, other processes, permissions and attributes.
_REFUSED = {
    "x86_64": (
        0xC000_003E,
        (41, 101, 310, 311, 425, 438, 90, 91, 92, 93, 94, 260, 268, 452, 188, 189, 190, 197, 198, 199),
    ),
    "aarch64": (0xC000_00B7, (198, 117, 270, 271, 425, 438, 52, 53, 54, 55, 452, 5, 6, 7, 14, 15, 16)),
}
_SECOND_TABLE = 0x4000_0000  # x86-64 has all calls once more, with this bit
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_ALLOW, _REFUSE = 0x7FFF_0000, 0x0005_0000 | errno.EPERM


def means() -> tuple[str, ...]:
    """What this system confines programs by, such as ``("Landlock 7", "seccomp")``; empty for none."""
    version = _landlock()
    return (*((f"Landlock {version}",) if version else ()), *(("seccomp",) if _filter() is not None else ()))


def start(
    command: Sequence[str], folder: Path, output: IO[bytes], environment: Mapping[str, str], *, confined: bool
) -> subprocess.Popen[bytes]:
    """Start a program in ``folder``, in a session of its own, with nothing to read.

    Where it is ``confined``, it and all that it starts can write in ``folder`` only, as far as this system can do that.
    Raises ``OSError`` for a program that cannot be started.
    """

    def begin() -> subprocess.Popen[bytes]:
        if confined:
            confine((folder,))
        return subprocess.Popen(
            list(command),
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            start_new_session=True,
        )

    if not confined:
        return begin()
    with ThreadPoolExecutor(1, "sinew-confined") as thread:  # one that ends: what it lost does not come back
        started = thread.submit(begin)
        try:
            return started.result()
        except KeyboardInterrupt:  # of the main thread, which waits
            started.result().kill()
            raise


def confine(folders: Sequence[Path]) -> None:
    """Let this thread, and all that it starts from now on, write in ``folders`` only. Raises ``OSError``."""
    version, refused = _landlock(), _filter()
    if not version and refused is None:
        return
    _call(_libc().prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    if version:
        _keep_inside(folders, version)
    if refused is not None:
        program = ctypes.create_string_buffer(refused)
        _call(
            _libc().prctl(_SET_FILTER, _BY_FILTER, ctypes.byref(_Filter(len(refused) // 8, ctypes.addressof(program))))
        )


class _Filter(ctypes.Structure):
    """``struct sock_fprog``."""

    _fields_ = (("length", ctypes.c_ushort), ("steps", ctypes.c_void_p))


def _keep_inside(folders: Sequence[Path], version: int) -> None:
    rights = _WRITE | _REMOVE_AND_MAKE | sum(right for since, right in _SINCE.items() if since <= version)
    asked = struct.pack("=QQQ", rights, _TCP, _SCOPES)[: 24 if version >= 6 else 16 if version >= 4 else 8]
    rules = _call(_libc().syscall(_CREATE, asked, ctypes.c_size_t(len(asked)), 0))
    try:
        for folder in folders:
            _allow(rules, folder, rights)
        for device in _DEVICES:
            if os.path.exists(device):
                _allow(rules, Path(device), rights & (_WRITE | _SINCE[3] | _SINCE[5]))
        _call(_libc().syscall(_RESTRICT, rules, 0))
    finally:
        os.close(rules)


def _allow(rules: int, path: Path, rights: int) -> None:
    place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        _call(_libc().syscall(_ADD, rules, _BENEATH, struct.pack("=Qi", rights, place), 0))
    finally:
        os.close(place)


@cache
def _landlock() -> int:
    """The version of Landlock; 0 for none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(0, int(_libc().syscall(_CREATE, None, ctypes.c_size_t(0), _VERSION)))


@cache
def _filter() -> bytes | None:
    """The steps of the filter, or None on a system or a processor that it is not for."""
    if not sys.platform.startswith("linux") or platform.machine() not in _REFUSED or not _takes_filters():
        return None
    name, refused = _REFUSED[platform.machine()]
    another = [(_AT_LEAST, len(refused) + 1, 0, _SECOND_TABLE)] if platform.machine() == "x86_64" else []
    steps = [
        (_LOAD, 0, 0, 4),  # the processor that the call is for: 64-bit programs can make calls of 32 bits
        (_EQUAL, 0, len(another) + len(refused) + 2, name),
        (_LOAD, 0, 0, 0),  # the number of the call
        *another,
        *((_EQUAL, len(refused) - place, 0, number) for place, number in enumerate(refused)),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _REFUSE),
    ]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)


def _takes_filters() -> bool:
    """Whether the kernel knows filters: it answers EFAULT to one that is nowhere."""
    return _libc().prctl(_SET_FILTER, _BY_FILTER, None) == -1 and ctypes.get_errno() == errno.EFAULT


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(result: int) -> int:
    if result < 0:
        raise OSError(ctypes.get_errno(), f"cannot confine a program ({os.strerror(ctypes.get_errno())})")
    return result
