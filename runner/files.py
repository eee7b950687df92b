"""Files that others may have written: only regular ones are read, and never further than a limit.

A named pipe or a device in the place of a file would be waited for or read without end, and a link may lead anywhere.
In folders that all users share, such as ``/tmp``, others may have made what this program is about to make.
"""

import errno
import grp
import json
import os
import pwd
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from sinew.runner.errors import BadInput

PIECE = 2**20  # bytes that are read at once of a file that does not say its size
MAX_CONTAINERS = 2**20  # lists and objects of a JSON text: an empty one of two bytes takes a hundred in memory
MAX_VALUES = 2**20
DEEPEST = 32  # levels of folders: Python calls itself once for each, and gives up at a thousand
OWN_DEPTH = 8  # levels: a result folder has fewer, so that what is on this one may be removed

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFLNK: "a link",
}


class NotReadable(Exception):
    """What is there is no regular file, or too large; the words say what it is."""


class TooLarge(NotReadable):
    """A file of more bytes than the limit."""

    def __init__(self, size: int, max_bytes: int) -> None:
        super().__init__(f"a file of {size:,} bytes, more than {max_bytes:,}")
        self.size = size


def what_is(mode: int) -> str:
    """The kind of file that a mode of ``os.stat`` says, for a message."""
    return _KINDS.get(stat.S_IFMT(mode), "no regular file")


def read_regular(path: Path, max_bytes: int, *, last: int | None = None, follow: bool = False) -> bytes:
    """The content of a regular file of at most ``max_bytes``, or only its ``last`` bytes.

    Links are refused unless ``follow``. Raises ``FileNotFoundError``, :class:`NotReadable` for anything else that is no
    such file, and ``OSError``.
    """
    descriptor = open_regular(path, os.O_RDONLY | (0 if follow else os.O_NOFOLLOW))
    status = os.fstat(descriptor)
    with open(descriptor, "rb") as file:
        if last is not None:
            file.seek(max(0, status.st_size - last))
            return file.read(last)
        if status.st_size > max_bytes:
            raise TooLarge(status.st_size, max_bytes)
        pieces, left, size = [], max_bytes + 1, status.st_size + 1  # as many bytes as are asked for take memory
        while left and (piece := file.read(min(size, left))) != b"":
            if piece is None:  # such as /proc/kmsg
                raise NotReadable("a file that has nothing to read now")
            pieces.append(piece)
            left, size = left - len(piece), PIECE
    if not left:  # it grew, or its size is not known before it is read, as in /proc
        raise NotReadable(f"a file of more than {max_bytes:,} bytes")
    return b"".join(pieces)


def open_regular(path: Path, flags: int) -> int:
    """The descriptor of a regular file, whose opening waits for nobody. Raises as :func:`read_regular` does."""
    try:
        descriptor = os.open(path, flags | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
    except OSError as error:
        if isinstance(error, FileNotFoundError):
            raise
        kind = _kind(path)
        if kind is None:
            raise
        raise NotReadable(kind) from None
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        raise NotReadable(what_is(mode))
    return descriptor


def parse_json(content: bytes) -> Any:
    """What a JSON text in UTF-8 holds. Raises ``ValueError``, also for one that would fill the memory, and
    ``RecursionError``.
    """
    if containers(content) > MAX_CONTAINERS or content.count(b",") > MAX_VALUES:
        raise ValueError("holds more than a million lists or values")
    return json.loads(content.decode("utf-8"))


def containers(content: bytes) -> int:
    """How many lists and objects a JSON text holds at most."""
    return content.count(b"[") + content.count(b"{")


def new_file(path: Path, mode: int = 0o666) -> BinaryIO:
    """A new file to write; what an interrupted run left there is removed, and a link is replaced, not followed."""
    path.unlink(missing_ok=True)
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return open(os.open(path, flags, mode), "wb")


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all. Raises ``OSError``, which names this file, not a temporary one."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with new_file(temporary) as file:
            file.write(content)
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):  # the folder may not let it
            temporary.unlink(missing_ok=True)


def append_file(path: Path) -> BinaryIO:
    """A regular file to append to, made where there is none. Raises ``OSError``, also for a link or a pipe."""
    try:
        return open(open_regular(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW), "ab")
    except NotReadable as kind:
        raise OSError(errno.EINVAL, f"is {kind}; remove it, it must be a file", str(path)) from None


def own_folder(folder: Path) -> Path:
    """The folder, made where there is none, into which nobody but this user can write.

    Raises ``OSError``, also when it is a link, belongs to somebody else or lets others write.
    """
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700)
    status = os.lstat(folder)
    others = stat.S_IWGRP | stat.S_IWOTH
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & others:
        raise PermissionError(errno.EACCES, "is no folder that only you can write to", str(folder))
    return folder


def refuse_open_way(folder: Path) -> None:
    """Raise ``OSError`` if any user can rename what is in this folder, or in one that leads to it.

    Its owner can, and anybody else where all may write and the sticky bit is not set. Only in a folder where all may
    write can a folder on the way belong to just anybody.
    """
    named, real = folder.absolute(), folder.resolve(strict=True)
    for each in dict.fromkeys((named, *named.parents, real, *real.parents)):
        status, above = os.lstat(each), each.parent.stat().st_mode
        open_to_all = (
            not stat.S_ISLNK(status.st_mode) and status.st_mode & (stat.S_IWOTH | stat.S_ISVTX) == stat.S_IWOTH
        )
        if open_to_all:
            raise PermissionError(
                errno.EACCES, "all users may rename what is yours in it; use another folder", str(each)
            )
        if above & stat.S_IWOTH and status.st_uid not in (0, os.geteuid()):
            raise PermissionError(
                errno.EACCES, "belongs to another user, where all may write; use another folder", str(each)
            )


def refuse_replaceable(file: Path) -> None:
    """Raise ``OSError`` if somebody else than this user and the administrator can replace a file or change it.

    Whoever owns it or a folder on the way can, and whoever may write there, unless only owners may rename (the sticky
    bit). A group of this user alone is no one else.
    """
    named, real = file.absolute(), file.resolve(strict=True)
    for each in dict.fromkeys((named, *named.parents, real, *real.parents)):
        status = os.lstat(each)
        if status.st_uid not in (0, os.geteuid()):
            raise PermissionError(errno.EACCES, "belongs to another user", str(each))
        shared = status.st_mode & stat.S_IWOTH or (status.st_mode & stat.S_IWGRP and not _is_private(status.st_gid))
        if shared and not stat.S_ISLNK(status.st_mode) and not status.st_mode & stat.S_ISVTX:
            raise PermissionError(errno.EACCES, "is open to others, who may write there", str(each))


def _is_private(group: int) -> bool:
    """Whether a group is the one that a system makes for each user: that of this user, with nobody else in it."""
    try:
        known, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group == user.pw_gid and known.gr_name == user.pw_name and set(known.gr_mem) <= {user.pw_name}


def temporary_folder() -> Path:
    """The user's own folder for temporary files, which outlives the program. Raises ``OSError``."""
    return own_folder(Path(tempfile.gettempdir()) / f"sinew-{os.geteuid()}")


def in_megabytes(size: int) -> str:
    """A number of bytes for a message: ``0.29 MB``, ``3,100 MB``."""
    megabytes = size / 2**20
    return f"{megabytes:,.0f} MB" if megabytes >= 10 else f"{megabytes:.2g} MB"


def read_input(path: Path, max_bytes: int, expected: str) -> bytes:
    """The content of a file that a user names, links followed. Raises :class:`sinew.runner.errors.BadInput`."""
    try:
        return read_regular(path, max_bytes, follow=True)
    except TooLarge as large:
        raise BadInput(path, in_megabytes(large.size), expected) from None
    except NotReadable as problem:
        raise BadInput(path, str(problem), expected) from None
    except (OSError, ValueError) as error:  # the latter: a path that no system takes
        words = error.strerror if isinstance(error, OSError) else str(error)
        raise BadInput(path, (words or "cannot be read").lower(), expected) from None


def strange_entry(folder: Path, closed: Collection[str] = ()) -> tuple[Path, str] | None:
    """The first thing below a folder that is neither a file nor a folder, and what it is. Links are not followed.

    A chain of folders more than ``DEEPEST`` levels deep counts as well: the folder that is named is on level
    ``OWN_DEPTH``. What is inside of the folders ``closed``, names directly below ``folder``, does not matter.
    Raises ``OSError`` when a folder cannot be read; what vanishes meanwhile is passed over.
    """
    folders = [str(folder)]
    while folders:
        try:
            with os.scandir(folders.pop()) as entries:
                for entry in sorted(entries, key=lambda each: each.name):
                    if entry.is_dir(follow_symlinks=False):
                        inside = Path(entry.path).relative_to(folder)
                        if len(inside.parts) > DEEPEST:
                            words = f"a chain of nested folders, more than {DEEPEST} deep"
                            return folder / Path(*inside.parts[:OWN_DEPTH]), words
                        if inside.as_posix() not in closed:
                            folders.append(entry.path)
                    elif not entry.is_file(follow_symlinks=False):
                        return Path(entry.path), what_is(entry.stat(follow_symlinks=False).st_mode)
        except FileNotFoundError:
            continue
    return None


def remove_folder(folder: Path) -> None:
    """Remove a folder and all below it, however deep and whatever its modes; what cannot be removed stays.

    Python's own way calls itself once for each level, and a solver may leave thousands of them.
    """
    with suppress(RecursionError):
        shutil.rmtree(folder, ignore_errors=True)
    if os.path.lexists(folder) and not folder.is_symlink():
        place = str(folder.absolute())
        remove = ["rm", "-rf", "--", place]
        folders_only = ["-type", "d", "-exec", "chmod", "u+rwx", "{}", "+"]  # a file may have another name elsewhere
        for command in (remove, ["find", place, *folders_only], remove):
            if os.path.lexists(folder):
                with suppress(OSError):
                    subprocess.run(command, stderr=subprocess.DEVNULL, check=False)


def _kind(path: Path) -> str | None:
    """What a path leads to without following it, if that is no regular file."""
    try:
        mode = os.lstat(path).st_mode
    except OSError:
        return None
    return None if stat.S_ISREG(mode) else what_is(mode)
