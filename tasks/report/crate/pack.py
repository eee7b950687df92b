"""Files written as one zip or as a folder: the same files give the same bytes."""

import hashlib
import os
import shutil
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sinew.runner.errors import BadInput, shown
from sinew.runner.files import NotReadable, read_regular

LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the first time that a zip can hold
MODE = 0o100644
MAX_BYTES = 2**28  # of one file, which is held in memory while it is packed


@dataclass(frozen=True)
class Item:
    """A file of a crate: its ``name`` there, its bytes or the regular file that holds them, and what it is."""

    name: str
    source: bytes | Path
    words: str

    def content(self) -> bytes:
        """Its bytes. Raises :class:`BadInput` for what is no regular file, or too large."""
        if isinstance(self.source, bytes):
            return self.source
        try:
            return read_regular(self.source, MAX_BYTES)
        except NotReadable as problem:
            raise BadInput(self.source, str(problem), "a regular file of at most 256 MB") from None


@dataclass(frozen=True)
class Packed:
    """What was written of a file."""

    item: Item
    bytes: int
    sha256: str


Put = Callable[[Item], Packed]


def refuse_taken(out: Path) -> None:
    """Refuse a place where something is, or whose folder is missing. Raises :class:`BadInput`."""
    if os.path.lexists(out):
        raise BadInput(f"--out {out}", "is there already", "a name that is free")
    if not out.absolute().parent.is_dir():
        raise BadInput(f"--out {out}", "its folder is not there", "a name in a folder that exists")


@contextmanager
def packing(out: Path) -> Iterator[Put]:
    """Write a new zip (``out`` ends in .zip) or a new folder, whole or not at all. Raises :class:`BadInput`."""
    refuse_taken(out)
    temporary = out.with_name(f".{out.name}.{os.getpid()}")
    try:
        if out.suffix.lower() == ".zip":
            with zipfile.ZipFile(temporary, "x", zipfile.ZIP_DEFLATED) as archive:
                yield lambda item: _packed(item, lambda name, content: _into_zip(archive, name, content))
        else:
            temporary.mkdir()
            yield lambda item: _packed(item, lambda name, content: _into_folder(temporary, name, content))
        temporary.rename(out)
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        else:
            temporary.unlink(missing_ok=True)


def packed(items: Iterable[Item], put: Put) -> list[Packed]:
    """Pack files in the order of their names. Raises :class:`BadInput` for two of one name."""
    found: list[Packed] = []
    for item in sorted(items, key=lambda one: one.name):
        if found and found[-1].item.name == item.name:
            raise BadInput("the crate", f"two files are called {shown(item.name)}", "other names")
        found.append(put(item))
    return found


def _packed(item: Item, write: Callable[[str, bytes], None]) -> Packed:
    content = item.content()
    write(item.name, content)
    return Packed(item, len(content), hashlib.sha256(content).hexdigest())


def _into_zip(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name, LONG_AGO)
    info.compress_type, info.external_attr, info.create_system = zipfile.ZIP_DEFLATED, MODE << 16, 3
    archive.writestr(info, content)


def _into_folder(folder: Path, name: str, content: bytes) -> None:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
