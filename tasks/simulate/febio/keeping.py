"""Keeping the runs of rows while they are evaluated, and finding those that were kept before."""

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from sinew.runner.errors import StoreError
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.kept import Entry, Run, entry_of, key_of, write_runs
from sinew.tasks.simulate.febio.kept_files import Place, contents, count_variables, files, read_run

log = logging.getLogger("sinew")

T = TypeVar("T")

WRITTEN_BYTES = 2**27  # of runs that are written together


class Index:
    """Where runs are kept in a folder. Files that are already known are not opened again.

    ``damaged``: of each file that cannot be read, a line that names it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.places: dict[str, list[Place]] = {}
        self.damaged: dict[Path, str] = {}
        self._known: set[str] = set()

    def look(self) -> None:
        """Take notice of new files; those that are damaged count as absent, and the log names them."""
        for path in files(self.folder):
            if path.name not in self._known:
                self._known.add(path.name)
                try:
                    for entry, place in contents(path):
                        self.places.setdefault(entry.key, []).append(place)
                except StoreError as error:
                    self._note(path, error)

    def runs(self, key: str) -> Iterator[Run]:
        """The runs with this key, from sound files, one after the other: each may be large.

        There are several if a later one was asked for more; that of which most was asked comes first.
        """
        places = self.places.get(key, [])
        if len(places) > 1:
            counted = [(self._read(count_variables, place), place) for place in places]
            sound = [(count, place) for count, place in counted if count is not None]
            places = [place for _, place in sorted(sound, key=lambda one: -one[0])]
        for place in places:
            run = self._read(read_run, place)
            if run is not None:
                yield run
            del run

    def _read(self, read: Callable[[Place], T], place: Place) -> T | None:
        """What is at a place; None, and a note of its file, where that is damaged."""
        try:
            return read(place)
        except StoreError as error:
            self._note(place.path, error)
            return None

    def _note(self, path: Path, error: StoreError) -> None:
        self.damaged[path] = str(error)
        log.warning("fields", extra={"error": str(error)})


_indexes: dict[Path, Index] = {}


class Keeper:
    """Keeps the runs of some rows along a protocol, in files of ``folder``. ``close`` writes the last of them."""

    def __init__(self, folder: Path, of: str, protocol: str, names: tuple[str, ...]) -> None:
        self.folder, self.of, self.protocol, self.names = folder, of, protocol, names
        self.index = _indexes.setdefault(folder, Index(folder))
        self.index.look()
        self._waiting: list[tuple[Entry, Run]] = []
        self._bytes = 0

    def find(self, values: Array, enough: Callable[[Run], bool]) -> Run | None:
        """The run with parameter ``values`` ``[d]``, if one is kept that is ``enough``."""
        return next(filter(enough, self.index.runs(key_of(self.of, self.names, values))), None)

    def add(self, values: Array, run: Run) -> None:
        """Keep a run. Raises ``OSError``."""
        self._waiting.append((entry_of(self.of, self.protocol, self.names, values), run))
        self._bytes += sum(variable.values.nbytes for variable in run.plot.variables.values())
        if self._bytes > WRITTEN_BYTES:
            self.close()

    def close(self) -> None:
        """Write what is not written yet. Raises ``OSError``."""
        waiting, self._waiting, self._bytes = self._waiting, [], 0
        if waiting:
            write_runs(self.folder, waiting)
