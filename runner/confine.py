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
WHOLE = 6  # the version of Landlock from which on it keeps signals inside
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full")

#: The name of each processor for filters.
_PROCESSORS = {"x86_64": 0xC000_003E, "aarch64": 0xC000_00B7}
#: Refused system calls by processor, in the order of these two. Those without a number there do not exist.
_REFUSED = (
    *((41, 198), (53, 199)),  # socket, socketpair
    *((101, 117), (310, 270), (311, 271), (438, 438), (440, 440), (448, 448)),  # other processes: ptrace, their memory
    *((141, 140), (251, 30), (256, 238), (279, 239), (298, 241), (321, 280), (323, 282), (425, 425)),  # priority, pages
    *((90, None), (91, 52), (92, None), (93, 55), (94, None), (260, 54), (268, 53), (452, 452)),  # chmod, chown
    *((188, 5), (189, 6), (190, 7), (197, 14), (198, 15), (199, 16), (463, 463), (466, 466), (469, 469)),  # attributes
    *((132, None), (235, None), (261, None), (280, 88)),  # times of files
    *((29, 194), (30, 196), (31, 195), (64, 190), (65, 193), (66, 191), (220, 192)),  # shared memory, semaphores
    *((68, 186), (69, 189), (70, 188), (71, 187), (240, 180), (241, 181)),  # queues of messages
    *((248, 217), (249, 218), (250, 219)),  # keys
)  # fmt: skip
#: Calls for this very process only: limits, and on which processors and how it runs.
_OWN = ((302, 261), (142, 118), (144, 119), (203, 122), (314, 274))
_IOCTL, _COMMANDS = (16, 29), (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451)  # what terminals and pipes are asked
_SECOND_TABLE = 0x4000_0000  # x86-64 has all calls once more, with this bit
_LOAD, _EQUAL, _AT_LEAST, _RETURN = 0x20, 0x15, 0x35, 0x06
_NUMBER, _PROCESSOR, _FIRST, _SECOND = 0, 4, 16, 24  # where a filter finds the call and its arguments
_ALLOW, _REFUSE = 0x7FFF_0000, 0x0005_0000 | errno.EPERM


def means() -> tuple[str, ...]:
    """What this system confines programs by, such as ``("Landlock 7", "seccomp")``; empty for none.

    Before its version 6, Landlock lets a program signal others; before 3, empty files anywhere.
    """
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


def is_whole() -> bool:
    """Whether a confined program can neither write elsewhere nor reach other programs on this system."""
    return _landlock() >= WHOLE and _filter() is not None


def is_confined(pid: int) -> bool:
    """Whether a process was confined here, or started by one that was."""
    try:
        return "NoNewPrivs:\t1" in Path(f"/proc/{pid}/status").read_text("utf-8", errors="replace")
    except OSError:  # it has ended
        return False


@cache
def _landlock() -> int:
    """The version of Landlock; 0 for none."""
    if not sys.platform.startswith("linux"):
        return 0
    return max(0, int(_libc().syscall(_CREATE, None, ctypes.c_size_t(0), _VERSION)))


@cache
def _filter() -> bytes | None:
    """The steps of the filter, or None on a system or a processor that it is not for."""
    if not sys.platform.startswith("linux") or platform.machine() not in _PROCESSORS or not _takes_filters():
        return None
    which = list(_PROCESSORS).index(platform.machine())
    steps: list[tuple[int, int, str, str]] = [  # what it does, with which number, and where it goes if so and if not
        (_LOAD, _PROCESSOR, "", ""),  # that the call is for: 64-bit programs can make calls of 32 bits
        (_EQUAL, _PROCESSORS[platform.machine()], "", "refuse"),
        (_LOAD, _NUMBER, "", ""),
    ]
    steps += [(_AT_LEAST, _SECOND_TABLE, "refuse", "")] if platform.machine() == "x86_64" else []
    steps += [(_EQUAL, number, "refuse", "") for call in _REFUSED if (number := call[which]) is not None]
    steps += [(_EQUAL, call[which], "own", "") for call in _OWN]
    steps += [(_EQUAL, _IOCTL[which], "command", "allow")]
    places = {"own": len(steps)}
    steps += [(_LOAD, _FIRST, "", ""), (_EQUAL, 0, "allow", "refuse")]
    places["command"] = len(steps)
    steps += [(_LOAD, _SECOND, "", ""), *((_EQUAL, command, "allow", "") for command in _COMMANDS)]
    places |= {"refuse": len(steps), "allow": len(steps) + 1}
    steps += [(_RETURN, _REFUSE, "", ""), (_RETURN, _ALLOW, "", "")]
    jumps = [tuple(places[to] - at - 1 if to else 0 for to in step[2:]) for at, step in enumerate(steps)]
    return b"".join(struct.pack("=HBBI", step[0], *jump, step[1]) for step, jump in zip(steps, jumps, strict=True))


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
