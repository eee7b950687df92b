"""What survives a loss of power: which files are on the disk, and in which order they get there.

A file may lose its content unless it is synchronised, and its name unless its folder is. Here, the content of a file is
on the disk before the file gets its name. Names are brought there in groups, where an order matters.
"""

import asyncio
import errno
import os
import uuid
from pathlib import Path
from typing import Any

import zarr
from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore

from sinew.runner.files import new_file

MAX_METADATA_BYTES = 2**24  # of a zarr.json
MAX_CHUNK_FILE_BYTES = 2**28 + 2**10  # of the largest chunk that is read, where nothing of it could be compressed
CANNOT = (errno.EINVAL, errno.EACCES, errno.EBADF, errno.ENOTSUP)  # folders on some network file systems


class DurableStore(LocalStore):
    """Zarr's files on a disk. ``sync_folders`` brings the names of all files written so far there.

    A file is read whole, so one that is larger than any that is written here is refused (``ValueError``).
    """

    def __init__(self, root: Path | str, *, read_only: bool = False) -> None:
        super().__init__(root, read_only=read_only)
        self.folders: set[Path] = set()

    async def get(
        self, key: str, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        _check_size(self.root / key)
        return await super().get(key, prototype, byte_range)

    def get_sync(
        self, key: str, *, prototype: BufferPrototype | None = None, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        _check_size(self.root / key)
        return super().get_sync(key, prototype=prototype, byte_range=byte_range)

    async def _set(self, key: str, value: Buffer, exclusive: bool = False) -> None:
        if not self._is_open:
            await self._open()
        self._check_writable()
        path = self.root / key
        if exclusive and path.exists():
            return
        await asyncio.to_thread(self._write, path, value.as_buffer_like())

    def _write(self, path: Path, content: Any) -> None:
        for parent in (path.parent, *path.parent.parents):
            if parent.is_dir():
                break
            self.folders.add(parent.parent)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, path.with_suffix(f".{uuid.uuid4().hex}.partial"), content)
        self.folders.add(path.parent)

    def sync_folders(self) -> None:
        """Bring the names of what was written so far to the disk."""
        folders, self.folders = self.folders, set()
        for folder in sorted(folders):
            sync_folder(folder)


def _check_size(path: Path) -> None:
    try:
        size = path.stat().st_size
    except (FileNotFoundError, NotADirectoryError):
        return
    if size > (MAX_METADATA_BYTES if path.name == "zarr.json" else MAX_CHUNK_FILE_BYTES):
        raise ValueError(f"{path.name} has {size:,} bytes")


def sync_names(group: zarr.Group) -> None:
    """Bring the names of all files of a hierarchy that were written so far to the disk."""
    if isinstance(group.store, DurableStore):
        group.store.sync_folders()


def write_whole(path: Path, temporary: Path, content: bytes) -> None:
    """Write a file, whole or not at all, also when the power fails; its name is there once its folder is synced."""
    try:
        with new_file(temporary) as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def sync_file(path: Path) -> None:
    """Bring the content of a file to the disk, whoever wrote it; nothing if it is gone."""
    _sync(path, os.O_NOFOLLOW)


def sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk; nothing if it is gone, or its file system cannot."""
    _sync(path, os.O_DIRECTORY, CANNOT)


def _sync(path: Path, flags: int, tolerated: tuple[int, ...] = ()) -> None:
    """``tolerated``: error numbers of fsync that do not count."""
    try:
        descriptor = os.open(path, os.O_RDONLY | flags)
    except FileNotFoundError:
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in tolerated:
            raise
    finally:
        os.close(descriptor)
