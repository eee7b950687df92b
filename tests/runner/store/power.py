"""A disk that loses its power: what is on it when some of what was written had not been synchronised.

The calls that bring contents and names to the disk, or change names, are watched in this process. What a file holds is
safe once it is synchronised, a name in a folder once the folder is. Of everything else, any part may be on the disk:
names as they were or as they are, contents whole, cut, empty, or zeros.
"""

import os
import random
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

Entry = int | str  # the number of a file, or a folder
FOLDER = "folder"


class Disk:
    """A folder on a disk without a battery. ``at_risk`` is called before and after each call that matters."""

    def __init__(self, root: Path, at_risk: Callable[["Disk"], None]) -> None:
        self.root, self.at_risk = root, at_risk
        self.safe: dict[int, bytes] = {}  # contents
        self.names: dict[Path, dict[str, Entry]] = {root: {}}
        self.held: list[int] = []  # files whose name is gone: their numbers are not given to others
        self.failing = False
        self.lock = threading.RLock()

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Watch this process's calls."""
        before = {name: getattr(os, name) for name in ("fsync", "replace", "unlink", "mkdir", "rmdir")}
        for name, call in before.items():
            setattr(os, name, self._watching(name, call))
        try:
            yield
        finally:
            for name, call in before.items():
                setattr(os, name, call)
            for descriptor in self.held:
                os.close(descriptor)

    def _watching(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def watching(*args: Any, **options: Any) -> Any:
            with self.lock:
                if self.failing:
                    return call(*args, **options)
                self.at_risk(self)
                self._hold(args[-1] if name in ("replace", "unlink") else None)
                result = call(*args, **options)
                if name == "fsync":
                    self._synced(args[0])
                self.at_risk(self)
                return result

        return watching

    def _hold(self, path: Any) -> None:
        """Keep the file that a call takes a name from."""
        if isinstance(path, str | os.PathLike) and os.path.isfile(path):
            self.held.append(os.open(path, os.O_RDONLY))

    def _synced(self, descriptor: int) -> None:
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        if path.is_dir():
            self.names[path] = _listing(path)
        else:
            self.safe[os.fstat(descriptor).st_ino] = path.read_bytes()

    def lose_power(self, target: Path, dice: random.Random) -> None:
        """Write into ``target`` what may be on the disk now."""
        self.failing = True
        contents = dict(self.safe)
        for descriptor in self.held:
            with open(f"/proc/self/fd/{descriptor}", "rb") as file:
                contents[os.fstat(descriptor).st_ino] = self._content(os.fstat(descriptor).st_ino, file.read(), dice)
        self._rebuild(self.root, target, contents, dice)
        self.failing = False

    def _rebuild(self, folder: Path, target: Path, contents: dict[int, bytes], dice: random.Random) -> None:
        target.mkdir()
        now = _listing(folder) if folder.is_dir() else {}
        then = self.names.get(folder, {})
        for name in sorted({*now, *then}):
            entry = dice.choice([now.get(name), then.get(name)])
            if entry == FOLDER:
                self._rebuild(folder / name, target / name, contents, dice)
            elif isinstance(entry, int):
                if entry == now.get(name):
                    content = self._content(entry, (folder / name).read_bytes(), dice)
                else:
                    content = contents.get(entry, b"")
                (target / name).write_bytes(content)

    def _content(self, number: int, now: bytes, dice: random.Random) -> bytes:
        """What a file may hold that holds ``now``."""
        safe = self.safe.get(number, b"")
        if safe == now:
            return now
        return dice.choice([safe, now, now[: len(now) // 2], bytes(len(now)), b""])


def _listing(folder: Path) -> dict[str, Entry]:
    with os.scandir(folder) as entries:
        return {each.name: FOLDER if each.is_dir() else each.inode() for each in entries}
