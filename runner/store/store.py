"""The evaluation store: one Zarr v3 hierarchy per result folder, resumable after any interruption.

Guarantees:

- An evaluation is identified by its content: the table's ``identity`` (everything that the outcome depends on besides
  the parameters) and the bytes of its parameters. Planning a known row again returns the existing row.
- Workers never write into the Zarr arrays. Each finished batch becomes one *segment* file in ``journal/``, which is
  renamed into place and therefore complete or absent. Only the process that holds the store's lock folds segments
  into chunks.
- A row counts once its ``status`` is written, and the chunk of ``status`` is written last. Zarr replaces chunk files
  atomically, so killing any process at any moment loses at most the evaluations that were running.
- A loss of power loses no row that :meth:`sinew.runner.store.table.Table.sync` has seen, or that is in a chunk. Of
  later rows it may lose any, and leaves no store that is damaged.
- Every chunk carries a checksum: damage is reported with the name of the file and never returned as numbers.
- Rows keep the order in which they were first planned, so equal studies give equal bytes.

| module | content |
|---|---|
| ``store`` | the hierarchy of a result folder: :class:`Store`, :func:`open_store` |
| ``table`` | :class:`sinew.runner.store.table.Table`: planning, committing and reading rows |
| ``schema`` | what a table holds, and the statuses of rows |
| ``arrays`` | how a new table is laid out in Zarr |
| ``segment`` | the outcomes of one batch in the journal |
| ``planned`` | the journal of rows that are planned but not in the arrays yet |
| ``rows`` | hashes of parameters, and the index of known rows |
| ``durable`` | what survives a loss of power |
| ``layout`` | whether the arrays of a table are what ``arrays`` creates |
| ``results`` | the arrays of a task's result |
| ``chunks`` | what the file of a chunk claims to hold |
| ``damage`` | errors that name the file |
| ``repair`` | what is removed, so that its rows are computed again |
| ``lock`` | one writer at a time |
"""

import json
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr
import zarr

from sinew.runner.errors import StoreError, shown
from sinew.runner.files import strange_entry
from sinew.runner.store import results
from sinew.runner.store.arrays import create_table
from sinew.runner.store.damage import result_errors, store_errors
from sinew.runner.store.durable import DurableStore, sync_folder, sync_names
from sinew.runner.store.layout import KEY_DIGITS, Damaged, check_arrays, check_group, table_group, table_key
from sinew.runner.store.lock import lock
from sinew.runner.store.repair import Repaired, remove_damaged_segments, repair_tables
from sinew.runner.store.schema import TableSpec
from sinew.runner.store.table import Table

FORMAT = 1

log = logging.getLogger("sinew")


class Store:
    """The store of a result folder. One process at a time may write; any number may read.

    Open it with :func:`open_store` (to read) or :meth:`Store.writing` (to write; takes the lock).
    """

    def __init__(self, folder: Path, root: zarr.Group, *, writable: bool) -> None:
        self.folder = folder
        self.root = root
        self.writable = writable
        self.removed: tuple[str, ...] = ()  # a line for each damaged segment that opening it removed

    @property
    def path(self) -> Path:
        """The Zarr hierarchy."""
        return self.folder / "store.zarr"

    @staticmethod
    @contextmanager
    def writing(folder: Path, study: str) -> Iterator["Store"]:
        """Create or continue the store of ``study`` in ``folder`` and hold its lock.

        Raises ``StoreError`` when another process holds the lock, or when the store has another study or format.
        """
        with store_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            refuse_strange_entries(folder)
            (folder / "journal").mkdir(exist_ok=True)
        with lock(folder):
            yield _create_or_continue(folder, study)

    @property
    def study(self) -> str:
        return str(self.root.attrs["study"])

    def table(self, spec: TableSpec) -> Table:
        """The table of ``spec``, created if it does not exist."""
        with store_errors(self.path):
            for group in self._groups():
                if table_key(group) == spec.key:  # the content decides, not the name at its creation
                    return self._of(spec, self._open(group))
            if not self.writable:
                raise StoreError(f"{self.path}: holds no evaluations of {spec.title}")
            name = f"evaluations/{_slug(spec.title)}-{spec.key[:KEY_DIGITS]}"
            create_table(self.root, name, spec)
            return self._open(self.root[name])  # type: ignore[arg-type]

    def _of(self, spec: TableSpec, table: Table) -> Table:
        """The table, if it is what its key says. Raises :class:`Damaged`."""
        if table.identity != json.loads(json.dumps(spec.identity)):
            raise Damaged(f"{table.name} is of something else than its key says")
        return table

    def tables(self) -> list[Table]:
        """All tables, sorted by name."""
        with store_errors(self.path):
            return [self._open(group) for group in self._groups()]

    def _open(self, group: zarr.Group) -> Table:
        return Table(self.folder, group, writable=self.writable)

    def _groups(self) -> list[zarr.Group]:
        """The groups of complete tables; one without the mark ``complete`` was cut short while it was created."""
        folder = self.path / "evaluations"
        # Zarr's own listing warns about files that another process is writing
        children = sorted(folder.iterdir()) if folder.is_dir() else []
        groups = [table_group(self.root, child.name) for child in children if (child / "zarr.json").is_file()]
        return [group for group in groups if group.attrs.get("complete")]

    def repair(self) -> Repaired:
        """Remove damaged chunks and make their rows pending.

        Rows with damaged parameters are lost: planning their parameters again creates new rows. Raises ``StoreError``
        when something cannot be read for another reason than damage; then it is not removed.
        """
        with store_errors(self.path):
            found = repair_tables(self.path, self.root, self.folder / "journal")
        return replace(found, removed=(*self.removed, *found.removed))

    def check(self) -> None:
        """Raises ``StoreError`` for any array that must not be read, by whatever reads Zarr."""
        folder = self.path / "evaluations"
        with store_errors(self.path):
            check_group(self.root)
            if array := next(self.root.array_keys(), None):
                raise Damaged(f"it holds the array {array[:40]!r} beside its groups")
        for group in self._groups_in_store():
            place = self.path / group.path
            if place.parent == folder:
                with store_errors(place):
                    check_arrays(group, place)
            else:
                with result_errors(place):
                    results.check(self.path, group, group.path)

    def _groups_in_store(self) -> Iterator[zarr.Group]:
        """All groups below the root."""
        waiting = [self.root]
        while waiting:
            group = waiting.pop()
            place = self.path / group.path
            with store_errors(place):
                names = sorted(child.name for child in place.iterdir() if child.is_dir())
                found = [one for name in names if isinstance(one := group.get(name), zarr.Group)]
            yield from found
            waiting += found

    def write_result(self, name: str, dataset: xr.Dataset) -> None:
        """Write a task's arrays as the group ``name`` beside the evaluations."""
        with store_errors(self.path):
            results.write(self.path, name, dataset)

    def read_result(self, name: str, **expected: Sequence[str]) -> xr.Dataset:
        """A task's arrays. Raises ``StoreError`` when there are none, or not what was written.

        ``expected``: values of coordinates, where whoever reads goes by their order.
        """
        if not (self.path / name).is_dir():
            raise StoreError(f"{self.path}: holds no result '{name}'")
        with result_errors(self.path / name):
            group = self.root.get(name)
            if not isinstance(group, zarr.Group):
                raise Damaged("its zarr.json is not that of a group")
            found = results.read(self.path, group, name)
            for coordinate, values in expected.items():
                if coordinate not in found.coords or found[coordinate].to_numpy().tolist() != list(values):
                    raise Damaged(f"its coordinate {coordinate} is not that of the result")
            return found


SOLVERS_OWN = ("attempts",)  # folders of a result folder in which solvers may leave anything


def refuse_strange_entries(folder: Path) -> None:
    """Refuse a result folder with links, pipes or devices: a link leads out of it, the others are read without end.

    Raises ``StoreError``.
    """
    with store_errors(folder):
        found = strange_entry(folder, SOLVERS_OWN)
    if found is not None:
        raise StoreError(f"{found[0]}: is {found[1]}; a result folder holds files and folders only, remove it")


def open_store(folder: Path) -> Store:
    """Open a result folder's store for reading, also while another process writes. Raises ``StoreError``."""
    path = folder / "store.zarr"
    if not path.is_dir():
        raise StoreError(f"{folder}: holds no store.zarr; name a result folder, as given to --out")
    refuse_strange_entries(folder)
    with store_errors(path):
        return Store(folder, _open_root(path, "r"), writable=False)


def _create_or_continue(folder: Path, study: str) -> Store:
    path = folder / "store.zarr"
    with store_errors(path):
        if not path.exists() or not any(path.iterdir()):
            root = zarr.open_group(DurableStore(path), mode="w", attributes={"sinew_format": FORMAT, "study": study})
            sync_names(root)
            for place in (folder, folder.parent):
                sync_folder(place)
            return Store(folder, root, writable=True)
        store = Store(folder, _open_root(path, "r+"), writable=True)
        for partial in (*path.rglob("*.partial"), *(folder / "journal").glob("*/.rows-*")):  # interrupted writes
            if partial.is_dir() and not partial.is_symlink():
                raise StoreError(f"{partial}: is a folder, in the place of a file; remove it")
            partial.unlink(missing_ok=True)
        store.removed = tuple(remove_damaged_segments(folder / "journal"))  # written when the power failed
        for line in store.removed:
            log.warning("segment", extra={"error": line})
    if store.study != study:
        raise StoreError(
            f"{path}: belongs to the study '{store.study}', not to '{study}'; give another --out or rename the study"
        )
    return store


def _open_root(path: Path, mode: Any) -> zarr.Group:
    try:
        files = DurableStore(path, read_only=mode == "r")
        # metadata of arrays beside those of the root may name codecs that unpickle
        root = zarr.open_group(files, mode=mode, zarr_format=3, use_consolidated=False)
    except FileNotFoundError:
        raise StoreError(f"{path}: not a store of sinew (its zarr.json is missing); give another --out") from None
    if "sinew_format" not in root.attrs or "study" not in root.attrs:
        raise StoreError(f"{path}: a Zarr hierarchy, but not a store of sinew; give another --out")
    if root.attrs["sinew_format"] != FORMAT:
        raise StoreError(f"{path}: format {shown(root.attrs['sinew_format'])}, but this sinew reads {FORMAT}")
    return root


def _slug(title: str) -> str:
    return "".join(c if c.isalnum() and c.isascii() else "-" for c in title.lower())[:60].strip("-") or "table"
