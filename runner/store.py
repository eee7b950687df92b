"""The evaluation store: one Zarr v3 hierarchy per result folder, resumable after any interruption.

Guarantees:

- An evaluation is identified by its content: the table's ``identity`` (everything the outcome depends on besides the
  parameters) and the bytes of its parameters. Planning a known row again finds the row that is there.
- Workers never write into the Zarr arrays. Each finished batch becomes one *segment* file in ``journal/``, complete or
  absent because it is renamed into place. The one process that holds the store's lock folds segments into chunks.
- A row counts when its ``status`` is there, and the chunk of ``status`` is written last. Zarr replaces chunk files
  atomically, so killing any process at any moment loses at most evaluations that were still running.
- Every chunk carries a checksum: damage is reported with the file's name, never returned as numbers.
- Rows keep the order in which they were first planned, so equal studies give equal bytes.
"""

import errno
import fcntl
import hashlib
import json
import math
import os
import socket
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import safetensors.numpy
import xarray as xr
import zarr
from safetensors import SafetensorError, safe_open
from zarr.codecs import BloscCodec, Crc32cCodec

from runner.errors import StoreError, of_the_system

FORMAT = 1
CHUNK_ROWS = 2048
CHUNK_BYTES = 2**25
STATUSES = (
    "ok",
    "diverged",
    "negative_jacobian",
    "timeout",
    "crashed",
    "bad_output",
    "out_of_memory",
    "bad_input",
)
PENDING = -1
Array = np.ndarray[Any, np.dtype[Any]]


@dataclass(frozen=True)
class Field:
    """One number or one curve per evaluation: ``dims`` name the axes behind ``row``."""

    name: str
    dims: tuple[str, ...]
    unit: str
    description: str


@dataclass(frozen=True)
class Coordinate:
    """Values along a dimension, numbers with a unit or names."""

    name: str
    dim: str
    values: Array
    unit: str = ""


@dataclass(frozen=True)
class TableSpec:
    """What a table holds. ``identity`` is everything but the parameters that an outcome depends on."""

    title: str
    identity: Mapping[str, Any]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    fields: tuple[Field, ...]
    coordinates: tuple[Coordinate, ...]

    @property
    def chunk_rows(self) -> int:
        """Rows in a chunk: fewer when a field is wide, so that a chunk of it stays below 32 MB."""
        lengths = {coordinate.dim: coordinate.values.size for coordinate in self.coordinates}
        widest = max(math.prod(lengths[dim] for dim in field.dims) for field in self.fields)
        return max(16, min(CHUNK_ROWS, 2 ** int(math.log2(max(16, CHUNK_BYTES // (8 * widest))))))

    @property
    def key(self) -> str:
        """32 hexadecimal digits that name this content."""
        text = json.dumps(self.identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


@dataclass(frozen=True)
class Segment:
    """The outcome of a batch, as a worker hands it over: ``values[field]`` is ``[row, *dims]`` float64."""

    rows: Array
    status: Array
    attempts: Array
    wall_seconds: Array
    values: Mapping[str, Array]
    messages: tuple[str, ...]
    worker: str

    def write(self, path: Path) -> None:
        """Write completely or not at all. Raises ``OSError`` (for example a full disk)."""
        arrays = {f"value:{name}": np.ascontiguousarray(array) for name, array in self.values.items()}
        arrays |= {"rows": self.rows, "status": self.status, "attempts": self.attempts, "wall": self.wall_seconds}
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            try:
                safetensors.numpy.save_file(
                    arrays, temporary, {"messages": json.dumps(self.messages), "worker": self.worker}
                )
            except SafetensorError as error:  # it hides the system's error number in its text
                raise OSError(errno.ENOSPC if "os error 28" in str(error) else errno.EIO, str(error)) from error
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)

    @staticmethod
    def read(path: Path, *, whole: bool = False) -> "Segment":
        """Read a segment, its values when they are asked for unless it is ``whole``. Raises ``StoreError``."""
        with _segment_errors(path), safe_open(path, framework="numpy") as file:
            metadata = file.metadata()
            names = [name.removeprefix("value:") for name in file.keys() if name.startswith("value:")]  # noqa: SIM118
            values: Mapping[str, Array] = _Stored(path, tuple(names))
            if whole:
                values = {name: file.get_tensor(f"value:{name}") for name in names}
            return Segment(
                file.get_tensor("rows"),
                file.get_tensor("status"),
                file.get_tensor("attempts"),
                file.get_tensor("wall"),
                values,
                tuple(json.loads(metadata["messages"])),
                metadata["worker"],
            )


@dataclass(frozen=True)
class _Stored(Mapping[str, Array]):
    """The values of a segment, field by field, so that a chunk is never in memory as a whole."""

    path: Path
    names: tuple[str, ...]

    def __getitem__(self, name: str) -> Array:
        if name not in self.names:
            raise KeyError(name)
        with _segment_errors(self.path), safe_open(self.path, framework="numpy") as file:
            return file.get_tensor(f"value:{name}")

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


@contextmanager
def _segment_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{path}: not a whole segment ({error}); delete it, its rows are computed again") from None


class Store:
    """A result folder's store. One process at a time may write; any number may read.

    Open it by :func:`open_store` (read) or :meth:`Store.writing` (write, takes the lock).
    """

    def __init__(self, folder: Path, root: zarr.Group, *, writable: bool) -> None:
        self.folder = folder
        self.root = root
        self.writable = writable

    @property
    def path(self) -> Path:
        """The Zarr hierarchy itself."""
        return self.folder / "store.zarr"

    @staticmethod
    @contextmanager
    def writing(folder: Path, study: str) -> Iterator["Store"]:
        """Create or continue the store of ``study`` in ``folder`` and hold its lock.

        Raises ``StoreError`` when another process holds it, or when the store belongs to another study or format.
        """
        with _errors_named(folder):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "journal").mkdir(exist_ok=True)
        with _lock(folder):
            yield _create_or_continue(folder, study)

    @property
    def study(self) -> str:
        return str(self.root.attrs["study"])

    def table(self, spec: TableSpec) -> "Table":
        """The table of ``spec``, created when it is not there yet."""
        with _errors_named(self.path):
            for group in self._table_groups():
                if group.attrs["key"] == spec.key:  # content decides, whatever it was called when it was created
                    return Table(self, group)
            if not self.writable:
                raise StoreError(f"{self.path}: holds no evaluations of {spec.title}")
            name = f"evaluations/{_slug(spec.title)}-{spec.key[:12]}"
            _create_table(self.root, name, spec)
            return Table(self, self.root[name])  # type: ignore[arg-type]

    def _table_groups(self) -> list[zarr.Group]:
        """Whole tables; one without its ``complete`` mark was being created when its process died."""
        folder = self.path / "evaluations"
        # not as Zarr lists them, which warns of what another process is about to write
        names = sorted(child.name for child in folder.iterdir() if child.is_dir()) if folder.is_dir() else []
        children = [self.root.get(f"evaluations/{name}") for name in names]
        return [child for child in children if isinstance(child, zarr.Group) and child.attrs.get("complete")]

    def tables(self) -> list["Table"]:
        """All tables, in order of their names."""
        with _errors_named(self.path):
            return [Table(self, group) for group in self._table_groups()]

    def repair(self) -> int:
        """Remove damaged chunks and make their rows pending, all others stay; returns how many rows.

        Rows whose parameters are damaged are gone: whoever asks for their content gets new rows.
        """
        with _errors_named(self.path):
            return sum(_repair_table(self.path, group) for group in self._table_groups())

    def write_result(self, name: str, dataset: xr.Dataset) -> None:
        """Put a task's arrays beside the evaluations, as the group ``name``."""
        texts = {
            str(variable): dataset[variable].astype(object)  # fixed-width text has no place in the Zarr v3 format
            for variable in dataset.variables
            if dataset[variable].dtype.kind == "U"
        }
        dataset = dataset.assign({n: v for n, v in texts.items() if n in dataset.data_vars})
        dataset = dataset.assign_coords({n: v for n, v in texts.items() if n in dataset.coords})
        with _errors_named(self.path):
            dataset.to_zarr(self.path, group=name, mode="w", zarr_format=3, consolidated=False)

    def read_result(self, name: str) -> xr.Dataset:
        """A task's arrays. Raises ``StoreError`` when there are none."""
        if name not in self.root:
            raise StoreError(f"{self.path}: holds no result '{name}'")
        with _errors_named(self.path):
            return xr.open_zarr(self.path, group=name, consolidated=False, zarr_format=3).load()


def _create_or_continue(folder: Path, study: str) -> Store:
    path = folder / "store.zarr"
    with _errors_named(path):
        if not path.exists() or not any(path.iterdir()):
            root = zarr.open_group(path, mode="w", attributes={"sinew_format": FORMAT, "study": study})
            return Store(folder, root, writable=True)
        store = Store(folder, _open_root(path, "r+"), writable=True)
        for partial in path.rglob("*.partial"):  # writes that were cut short
            partial.unlink(missing_ok=True)
    if store.study != study:
        raise StoreError(
            f"{path}: belongs to the study '{store.study}', not to '{study}'; give another --out or rename the study"
        )
    return store


def open_store(folder: Path) -> Store:
    """Open a result folder's store for reading; works while another process writes."""
    path = folder / "store.zarr"
    if not path.is_dir():
        raise StoreError(f"{folder}: holds no store.zarr; name a result folder, as given to --out")
    with _errors_named(path):
        return Store(folder, _open_root(path, "r"), writable=False)


def is_whole(path: Path) -> bool:
    """Whether a segment file is there and complete."""
    try:
        with safe_open(path, framework="numpy"):
            return True
    except (SafetensorError, OSError):
        return False


class Table:
    """The evaluations of one identity: rows of parameters, their outcomes, and what became of each.

    Rows are numbered from 0 in the order in which they were first planned.
    """

    def __init__(self, store: Store, group: zarr.Group) -> None:
        self.store = store
        self.group = group
        self.title = str(group.attrs["title"])
        self.key = str(group.attrs["key"])
        self.chunk_rows = int(group.attrs["chunk_rows"])  # type: ignore[arg-type]
        self.journal = store.folder / "journal" / self.key[:12]
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._fields: tuple[str, ...] = tuple(group.attrs["fields"])  # type: ignore[arg-type]
        with _errors_named(self._path("status")):
            self.status: Array = self._array("status")[:]  # type: ignore[assignment]
        self._hashes, self._order = self._index()
        self._unsettled: list[Array] = []  # parameters of the last rows, which the arrays do not hold yet
        if store.writable and self._planned.is_file():
            self._take_up(self._planned.read_bytes())
            self.settle()

    def __len__(self) -> int:
        return int(self.status.size)

    @property
    def name(self) -> str:
        return self.group.path.rsplit("/", 1)[-1]

    @property
    def fields(self) -> tuple[str, ...]:
        """What is stored of every outcome."""
        return self._fields

    def nothing(self, field: str) -> Array:
        """What a failed row has for a field: NaN, in its shape."""
        return np.full(self._array(field).shape[1:], np.nan)

    # ---- planning

    def plan(self, parameters: Array, *, settle: bool = True) -> Array:
        """Row numbers ``[n]`` of ``parameters`` ``[n, d]``; rows that are not known yet are appended.

        Equal parameter sets share a row. Those who plan a few rows often do not ``settle`` them each time: they are
        noted in the journal, which is fast, and enter the arrays when rows are next folded in. Raises ``ValueError``
        for numbers that are not finite.
        """
        if not all(np.isfinite(parameters[block]).all() for block in _slices(len(parameters), self.chunk_rows)):
            raise ValueError("parameters must be finite numbers")
        hashes = self._hashes_of(parameters)
        rows = self._find(parameters, hashes)
        new = np.flatnonzero(rows < 0)
        if new.size:
            unique, first, inverse = np.unique(hashes[new], return_index=True, return_inverse=True)
            rank = np.empty(first.size, dtype=np.int64)  # unique sorts by hash; rows keep the order of asking
            rank[np.argsort(first)] = np.arange(first.size)
            rows[new] = len(self) + rank[inverse]
            self._append(parameters, new[np.sort(first)], unique, len(self) + rank, settle=settle)
        return rows

    @property
    def settled(self) -> int:
        """How many rows the arrays hold."""
        return len(self) - sum(map(len, self._unsettled))

    def settle(self) -> None:
        """Enter planned rows into the arrays."""
        if self._unsettled:
            parameters = np.concatenate(self._unsettled)
            self._extend(self.settled, parameters, np.arange(len(parameters)))
            self._unsettled = []
        self._planned.unlink(missing_ok=True)

    @property
    def _planned(self) -> Path:
        return self.journal / "planned"

    def _note_planned(self, parameters: Array) -> None:
        """Note the last rows in the journal: number, parameters, and a checksum of both."""
        with _errors_named(self._planned):
            self.journal.mkdir(parents=True, exist_ok=True)
            with self._planned.open("ab") as file:
                for row, values in enumerate(parameters, len(self) - len(parameters)):
                    record = np.int64(row).tobytes() + np.ascontiguousarray(values, dtype=np.float64).tobytes()
                    file.write(record + hashlib.blake2b(record, digest_size=8).digest())

    def _take_up(self, noted: bytes) -> None:
        """Plan what the journal notes beyond the arrays; a record that was cut short ends it."""
        width = int(self._array("parameters").shape[1])
        size = 8 * (width + 2)
        for start in range(0, len(noted) - size + 1, size):
            record, check = noted[start : start + size - 8], noted[start + size - 8 : start + size]
            row = int(np.frombuffer(record[:8], dtype=np.int64)[0])
            if hashlib.blake2b(record, digest_size=8).digest() != check or row > len(self):
                return
            values = np.frombuffer(record[8:], dtype=np.float64)[np.newaxis]
            if row == len(self):
                only = np.zeros(1, dtype=np.int64)
                self._append(values, only, self._hashes_of(values), only + row, settle=False, note=False)

    def find(self, parameters: Array) -> Array:
        """Row numbers ``[n]`` of known parameter sets ``[n, d]``, -1 for the others."""
        return self._find(parameters, self._hashes_of(parameters))

    def _hashes_of(self, parameters: Array) -> Array:
        """A hash for each row, a chunk at a time so that memory stays flat."""
        hashes = np.empty(len(parameters), dtype=np.uint64)
        for block in _slices(len(parameters), self.chunk_rows):
            hashes[block] = _hash_rows(parameters[block])
        return hashes

    def _find(self, parameters: Array, hashes: Array) -> Array:
        rows = np.full(len(parameters), -1, dtype=np.int64)
        if self._hashes.size == 0:
            return rows
        place = np.minimum(np.searchsorted(self._hashes, hashes), self._hashes.size - 1)
        known = np.flatnonzero(self._hashes[place] == hashes)
        rows[known] = self._order[place[known]]
        for block in _blocks(rows[known], self.chunk_rows):
            if not np.array_equal(self.parameters(rows[known[block]]), parameters[known[block]]):
                raise StoreError(f"{self._path('parameters')}: two parameter sets share one hash; please report this")
        return rows

    def pending(self, rows: Array) -> Array:
        """Those of ``rows`` without an outcome, sorted, each once."""
        rows = np.unique(rows)
        return rows[self.status[rows] == PENDING]

    def reopen(self, rows: Array) -> None:
        """Make failed rows pending again, so that they are evaluated anew."""
        self.settle()
        status = self._array("status")
        for start in range(0, len(self), self.chunk_rows):
            chosen = rows[(rows >= start) & (rows < start + self.chunk_rows)]
            chosen = chosen[self.status[chosen] > 0]
            if chosen.size:
                self.status[chosen] = PENDING
                with _errors_named(self._path("status")):
                    status[start : start + self.chunk_rows] = self.status[start : start + self.chunk_rows]

    # ---- committing

    def segments(self) -> list[Path]:
        """Segments that are not folded in yet."""
        return sorted(self.journal.glob("rows-*.safetensors")) if self.journal.is_dir() else []

    def finished(self) -> int:
        """How many rows have a committed outcome."""
        return int((self.status != PENDING).sum())

    def waiting(self) -> int:
        """How many rows are finished but not folded in yet."""
        return sum(int(path.stem.rpartition("-")[2]) for path in self.segments())

    def fold(self, paths: Iterable[Path] | Mapping[Path, Segment]) -> None:
        """Commit segments: write the chunks that they touch, ``status`` last, then delete them.

        Those who have read them give them along with their paths.
        """
        self.settle()
        known = paths if isinstance(paths, Mapping) else {}
        segments = [(path, known.get(path) or Segment.read(path)) for path in paths]
        touched = sorted(
            {int(chunk) for _, segment in segments for chunk in np.unique(segment.rows // self.chunk_rows)}
        )
        for chunk in touched:
            self._write_chunk(chunk, [segment for _, segment in segments])
        for path, _ in segments:
            path.unlink(missing_ok=True)

    def _write_chunk(self, chunk: int, segments: list[Segment]) -> None:
        start = chunk * self.chunk_rows
        stop = min(start + self.chunk_rows, len(self))
        status = self.status[start:stop].copy()
        parts = []
        for segment in segments:
            inside = np.flatnonzero((segment.rows >= start) & (segment.rows < stop))
            inside = inside[status[segment.rows[inside] - start] == PENDING]  # a committed row stays as it is
            if inside.size:
                parts.append((segment, inside, segment.rows[inside] - start))
                status[parts[-1][2]] = segment.status[inside]
        if not parts:
            return
        had_some = bool((self.status[start:stop] != PENDING).any())
        names = [*self._fields, "attempts", "wall_seconds", "worker"]
        if had_some or any(segment.messages for segment, _, _ in parts):
            names.append("message")
        for name in names:
            with _errors_named(self._path(name)):
                array = self._array(name)
                if had_some:
                    block = np.asarray(array[start:stop])
                else:
                    block = np.full((stop - start, *array.shape[1:]), array.fill_value, dtype=array.dtype)
                for segment, inside, rows in parts:
                    together = rows[-1] - rows[0] == rows.size - 1
                    block[slice(rows[0], rows[-1] + 1) if together else rows] = _column(segment, name, inside)
                array[start:stop] = block
        with _errors_named(self._path("status")):
            self._array("status")[start:stop] = status
        self.status[start:stop] = status

    # ---- reading

    def parameters(self, rows: Array) -> Array:
        """Parameters ``[n, d]`` of ``rows``."""
        late = rows >= self.settled
        if not late.any():
            return self.read("parameters", rows)
        found = np.empty((rows.size, int(self._array("parameters").shape[1])))
        self._unsettled = [np.concatenate(self._unsettled)]  # asked for by the row, noted by the batch
        found[late] = self._unsettled[0][rows[late] - self.settled]
        found[~late] = self.read("parameters", rows[~late])
        return found

    def read(self, name: str, rows: Array, columns: slice = slice(None)) -> Array:
        """A field at ``rows`` ``[n, ...]``; ``columns`` limits its first own axis. NaN where a row has no outcome."""
        if rows.size and int(rows.max()) >= self.settled:
            self.settle()
        array = self._array(name)
        width = array.shape[1:]
        if len(width):
            width = (len(range(*columns.indices(width[0]))), *width[1:])
        out = np.empty((rows.size, *width), dtype=array.dtype)
        order = np.argsort(rows, kind="stable")
        for block in _blocks(rows[order], self.chunk_rows):
            chosen = order[block]
            start = int(rows[chosen[0]]) // self.chunk_rows * self.chunk_rows
            with _errors_named(self._path(name)):
                chunk = np.asarray(array[start : start + self.chunk_rows])
                if len(width):
                    chunk = chunk[:, columns]
            out[chosen] = chunk[rows[chosen] - start]
        if name in self._fields:
            out[self.status[rows] == PENDING] = np.nan  # what a row that was opened again had before
            gone = np.isnan(out.reshape(rows.size, -1)).any(axis=1) & (self.status[rows] == 0)
            if gone.any():  # Zarr takes a file that is not there for empty
                raise StoreError(
                    f"{self._path(name)}: {gone.sum()} rows with an outcome have no numbers; "
                    f"`sinew repair {self.store.folder}` makes them pending"
                )
        return out

    def dataset(self) -> xr.Dataset:
        """The table as a lazily loaded :class:`xarray.Dataset` with named dimensions and units."""
        with _errors_named(self._path("")):
            return xr.open_zarr(self.store.path, group=self.group.path, consolidated=False, zarr_format=3)

    # ---- inside

    def _array(self, name: str) -> zarr.Array[Any]:
        if name not in self._arrays:  # opening one reads its metadata from the disk
            self._arrays[name] = self.group[name]  # type: ignore[assignment]
        return self._arrays[name]

    def _path(self, name: str) -> Path:
        return self.store.path / self.group.path / name

    def _index(self) -> tuple[Array, Array]:
        """Sorted hashes of the planned rows, and the row of each."""
        planned = self._array("parameters")
        hashes = np.zeros(len(self), dtype=np.uint64)
        missing = np.zeros(len(self), dtype=bool)
        for rows in _slices(len(self), self.chunk_rows):
            with _errors_named(self._path("parameters")):
                block = np.asarray(planned[rows])
            hashes[rows] = _hash_rows(block)
            missing[rows] = np.isnan(block[:, 0])
        if (self.status[missing] != PENDING).any():
            raise StoreError(
                f"{self._path('parameters')}: parameters are missing for rows with an outcome; "
                f"`sinew repair {self.store.folder}` makes those rows pending"
            )
        if missing.any():  # at the end: a plan that was interrupted; elsewhere: rows lost to damage
            whole = len(self) - int(np.argmin(missing[::-1])) if not missing.all() else 0
            self.status, hashes, missing = self.status[:whole], hashes[:whole], missing[:whole]
        rows_kept = np.flatnonzero(~missing)
        order = np.argsort(hashes[rows_kept], kind="stable")
        return hashes[rows_kept][order], rows_kept[order]

    def _append(
        self, parameters: Array, chosen: Array, hashes: Array, rows: Array, *, settle: bool, note: bool = True
    ) -> None:
        """Plan the ``chosen`` of ``parameters`` as new rows; ``hashes`` and ``rows`` extend the index."""
        if settle:
            self.settle()
            self._extend(len(self), parameters, chosen)
        self.status = np.concatenate([self.status, np.full(chosen.size, PENDING, dtype=np.int8)])
        if not settle:
            self._unsettled.append(parameters[chosen] + 0.0)
            if note:
                self._note_planned(self._unsettled[-1])
        order = np.argsort(hashes, kind="stable")
        place = np.searchsorted(self._hashes, hashes[order])
        self._hashes = np.insert(self._hashes, place, hashes[order])
        self._order = np.insert(self._order, place, rows[order])

    def _extend(self, first: int, parameters: Array, chosen: Array) -> None:
        """Lengthen the arrays, which hold ``first`` rows, by the ``chosen`` of ``parameters``."""
        count = first + chosen.size
        with _errors_named(self._path("parameters")):
            for name in (*self._fields, "attempts", "wall_seconds", "worker", "message", "parameters"):
                array = self._array(name)
                array.resize((count, *array.shape[1:]))
            planned = self._array("parameters")
            start = first
            while start < count:  # chunk by chunk, each written once
                stop = min((start // self.chunk_rows + 1) * self.chunk_rows, count)
                planned[start:stop] = parameters[chosen[start - first : stop - first]] + 0.0
                start = stop
            self._array("status").resize((count,))  # last: a row exists once it has a status


def _create_table(root: zarr.Group, name: str, spec: TableSpec) -> None:
    lengths = {coordinate.dim: coordinate.values.size for coordinate in spec.coordinates}
    lengths["parameter"] = len(spec.parameters)
    group = root.create_group(name, overwrite=True)

    def create(
        array: str, dtype: Any, fill: Any, dims: tuple[str, ...], shape: tuple[int, ...], attributes: dict[str, Any]
    ) -> None:
        # the fastest compression there is: it is for the empty rest of chunks, as the last digits of forces are noise
        codecs = (
            {}
            if dtype is str
            else {"compressors": [BloscCodec(cname="lz4", clevel=1, shuffle="noshuffle"), Crc32cCodec()]}
        )
        group.create_array(
            array,
            shape=shape,
            chunks=(spec.chunk_rows, *shape[1:]) if dims[0] == "row" else shape,
            dtype=dtype,
            fill_value=fill,
            dimension_names=dims,
            attributes=attributes,
            **codecs,  # type: ignore[arg-type]
        )

    names = Coordinate("parameter", "parameter", np.array(spec.parameters, dtype=object))
    units = Coordinate("parameter_unit", "parameter", np.array(spec.units, dtype=object))
    for coordinate in (names, units, *spec.coordinates):
        text = coordinate.values.dtype == object
        attributes = {} if text else {"units": coordinate.unit}
        shape: tuple[int, ...] = (coordinate.values.size,)
        create(coordinate.name, str if text else "f8", "" if text else np.nan, (coordinate.dim,), shape, attributes)
        group[coordinate.name][:] = coordinate.values  # type: ignore[index]
    create("parameters", "f8", np.nan, ("row", "parameter"), (0, len(spec.parameters)), {"long_name": "parameters"})
    for field in spec.fields:
        shape = (0, *(lengths[dim] for dim in field.dims))
        attributes = {"units": field.unit, "long_name": field.description}
        create(field.name, "f8", np.nan, ("row", *field.dims), shape, attributes)
    flags = {"flag_values": [PENDING, *range(len(STATUSES))], "flag_meanings": " ".join(("pending", *STATUSES))}
    create("status", "i1", PENDING, ("row",), (0,), flags)
    create("attempts", "i2", 0, ("row",), (0,), {"long_name": "how often the row was tried"})
    create("wall_seconds", "f8", np.nan, ("row",), (0,), {"units": "s", "long_name": "time of its evaluation"})
    create("worker", str, "", ("row",), (0,), {"long_name": "host, job and process that evaluated the row"})
    create("message", str, "", ("row",), (0,), {"long_name": "why the row failed, in the solver's words"})
    group.update_attributes(
        {
            "title": spec.title,
            "key": spec.key,
            "identity": json.dumps(spec.identity, sort_keys=True),
            "fields": [field.name for field in spec.fields],
            "coordinates": " ".join(["parameter_unit", *(c.name for c in spec.coordinates if c.name != c.dim)]),
            "chunk_rows": spec.chunk_rows,
            "complete": True,
        }
    )


def _repair_table(path: Path, group: zarr.Group) -> int:
    status = group["status"]
    assert isinstance(status, zarr.Array)
    chunk_rows = int(group.attrs["chunk_rows"])  # type: ignore[arg-type]
    lost = np.zeros(status.shape[0], dtype=bool)
    fields: Any = group.attrs["fields"]
    for name, array in sorted(group.arrays(), key=lambda item: item[0] != "status"):
        if array.metadata.dimension_names[0] != "row":  # type: ignore[index, union-attr]
            continue
        for chunk, rows in enumerate(_slices(lost.size, chunk_rows)):
            try:
                found = np.asarray(array[rows])
                if name in fields:
                    absent = np.isnan(found.reshape(len(found), -1)).any(axis=1)
                    lost[rows] |= absent & (np.asarray(status[rows]) == 0)
            except (ValueError, RuntimeError):  # a checksum, not a disk that fails to answer
                place = path / group.path / name / "c" / str(chunk)
                for file in [place] if place.is_file() else place.rglob("*"):
                    if file.is_file():
                        file.unlink()
                # when the status itself is damaged, which rows had an outcome is not known any more
                lost[rows] |= True if name == "status" else np.asarray(status[rows]) != PENDING
    for rows in _slices(lost.size, chunk_rows):
        if lost[rows].any():
            status[rows] = np.where(lost[rows], PENDING, np.asarray(status[rows])).astype(np.int8)
    return int(lost.sum())


def _column(segment: Segment, name: str, inside: Array) -> Any:
    """A column of a segment at the positions ``inside``."""
    if name == "attempts":
        return segment.attempts[inside]
    if name == "wall_seconds":
        return segment.wall_seconds[inside]
    if name == "worker":
        return np.array([segment.worker] * inside.size, dtype=object)
    if name == "message":
        return np.array([segment.messages[i] if segment.messages else "" for i in inside], dtype=object)
    # a batch that failed as a whole has no values
    if name not in segment.values:
        return np.nan
    return segment.values[name] if inside.size == segment.rows.size else segment.values[name][inside]


def _hash_rows(parameters: Array) -> Array:
    numbers = np.asarray(parameters, dtype=np.float64) + 0.0  # -0.0 and 0.0 are one number
    return pd.util.hash_pandas_object(pd.DataFrame(numbers), index=False).to_numpy()


def _slices(count: int, size: int) -> Iterator[slice]:
    for start in range(0, count, size):
        yield slice(start, min(start + size, count))


def _blocks(rows: Array, chunk_rows: int) -> Iterator[Array]:
    """Positions in ``rows``, grouped by the chunk that they lie in."""
    if rows.size:
        order = np.argsort(rows // chunk_rows, kind="stable")
        cuts = np.flatnonzero(np.diff(rows[order] // chunk_rows)) + 1
        yield from np.split(order, cuts)


def _slug(title: str) -> str:
    return "".join(c if c.isalnum() and c.isascii() else "-" for c in title.lower())[:60].strip("-") or "table"


def _open_root(path: Path, mode: Any) -> zarr.Group:
    try:
        root = zarr.open_group(path, mode=mode, zarr_format=3)
    except FileNotFoundError:
        raise StoreError(f"{path}: not a store of sinew (its zarr.json is missing); give another --out") from None
    if "sinew_format" not in root.attrs or "study" not in root.attrs:
        raise StoreError(f"{path}: a Zarr hierarchy, but not a store of sinew; give another --out")
    if root.attrs["sinew_format"] != FORMAT:
        raise StoreError(f"{path}: format {root.attrs['sinew_format']}, but this sinew reads {FORMAT}")
    return root


@contextmanager
def _errors_named(path: Path) -> Iterator[None]:
    """Turn what Zarr and the system raise about ``path`` into one clear line."""
    try:
        yield
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{path}: {of_the_system(error)}") from error
    except (ValueError, RuntimeError, KeyError, json.JSONDecodeError) as error:
        raise StoreError(
            f"{path}: damaged ({str(error).splitlines()[0][:120]}); `sinew repair {_result_folder(path)}` makes its "
            "rows pending, all others stay"
        ) from error


def _result_folder(path: Path) -> Path:
    for parent in (path, *path.parents):
        if parent.name == "store.zarr":
            return parent.parent
    return path


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Hold the folder's lock; the system releases it when the process ends, however it ends."""
    try:
        descriptor = os.open(folder / "lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise StoreError(f"{folder / 'lock'}: {error.strerror}") from None
    with open(descriptor, "r+", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            raise StoreError(
                f"{folder}: in use by {file.read().strip() or 'another process'}; wait or stop it"
            ) from None
        file.seek(0)
        file.truncate()
        job = os.environ.get("SLURM_JOB_ID")
        file.write(f"process {os.getpid()} on {socket.gethostname()}{f', SLURM job {job}' if job else ''}\n")
        file.flush()
        yield
