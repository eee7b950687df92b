"""Keeping the runs of rows while they are evaluated, and finding those that were kept before."""

import logging
from collections.abc import Callable, Iterator
from pathlib import Path

from sinew.runner.errors import StoreError
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.kept import Entry, Run, entry_of, key_of, write_runs
from sinew.tasks.simulate.febio.kept_files import Place, contents, count_variables, files, read_run

log = logging.getLogger("sinew")

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
        """The runs with this key, from sound files. There are several if a later one was asked for more."""
        for place in self.places.get(key, ()):
            try:
                yield read_run(place)
            except StoreError as error:
                self._note(place.path, error)

    def best(self, key: str) -> Run | None:
        """The run with this key of which most was asked; None where no file has one that is sound."""
        counted = []
        for place in self.places.get(key, ()):
            try:
                counted.append((count_variables(place), place))
            except StoreError as error:
                self._note(place.path, error)
        for _, place in sorted(counted, key=lambda one: -one[0]):  # one after the other: each may be large
            try:
                return read_run(place)
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
        run: Run | None = None
        for run in self.index.runs(key_of(self.of, self.names, values)):
            if enough(run):
                return run
            del run  # before the next is read: each may be large
        return None

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
