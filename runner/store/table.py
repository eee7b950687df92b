"""One table of the store: planned rows of parameters, their committed outcomes, and what has no outcome yet."""

import logging
import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.store.arrays import COLUMNS
from sinew.runner.store.damage import store_errors
from sinew.runner.store.durable import sync_file, sync_folder, sync_names
from sinew.runner.store.layout import (
    KEY_DIGITS,
    Damaged,
    check_arrays,
    check_chunks,
    chunk_rows_of,
    coordinate,
    fields_of,
    has,
    identity_of,
    row_array,
    statuses,
    table_key,
)
from sinew.runner.store.planned import PlannedRows
from sinew.runner.store.repair import without_numbers
from sinew.runner.store.results import PLAIN
from sinew.runner.store.rows import RowIndex, by_chunk, hash_rows, slices, spans
from sinew.runner.store.schema import CHUNK_BYTES, PENDING, Array
from sinew.runner.store.segment import Part, Segment, column_of

log = logging.getLogger("sinew")

FOLD_CHUNKS = 8  # a call of Zarr and the synchronisation of a folder cost more than the bytes of a chunk
PLANNED_CHUNKS = 16  # of parameters, which are small
LOADED_BYTES = 2 * CHUNK_BYTES  # of chunks whose segments are read as a whole, not one column after the other


class Table:
    """The rows of one identity. Rows are numbered from 0 in the order in which they were first planned."""

    def __init__(self, folder: Path, group: zarr.Group, *, writable: bool) -> None:
        self.folder = folder
        self.group = group
        self.title = str(group.attrs["title"])
        self.key = table_key(group)
        self.chunk_rows = chunk_rows_of(group)
        self.fields: tuple[str, ...] = fields_of(group)
        self.journal = folder / "journal" / self.key[:KEY_DIGITS]
        self._planned = PlannedRows(self.journal / "planned")
        self._arrays: dict[str, zarr.Array[Any]] = {}
        self._synced: set[Path] = set()
        self._chunk: tuple[int, Array] = -1, np.empty((0, 0))  # the last one whose parameters were asked for
        self._unsettled: list[Array] = []  # parameters of the last rows, which are not in the arrays yet
        with store_errors(self._path("status")):
            self.status: Array = statuses(group, self._path(""))
        self._index = self._build_index()
        if writable and self._planned.path.is_file():
            self._restore_planned()
            self.settle()
        if writable:
            self._remove_unplanned()

    def __len__(self) -> int:
        return int(self.status.size)

    @property
    def name(self) -> str:
        return self.group.path.rsplit("/", 1)[-1]

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Everything that an outcome depends on, except the parameters."""
        with store_errors(self._path("zarr.json")):
            return identity_of(self.group)

    @property
    def names(self) -> list[str]:
        """The parameters' names."""
        found = self.coordinate("parameter")
        return [] if found is None else [str(name) for name in found]

    def nothing(self, field: str) -> Array:
        """The value of a field for a failed row: NaN, in the field's shape."""
        return np.full(self._array(field).shape[1:], np.nan)

    # ---- planning

    def plan(self, parameters: Array, *, settle: bool = True) -> Array:
        """Row numbers ``[n]`` of ``parameters`` ``[n, d]``; unknown parameter sets become new rows.

        Equal parameter sets share a row. Without ``settle``, new rows are only noted in the journal, which is fast for
        many small requests; the next fold enters them into the arrays. Raises ``ValueError`` for parameters that are
        not finite.
        """
        if not all(np.isfinite(parameters[block]).all() for block in slices(len(parameters), self.chunk_rows)):
            raise ValueError("parameters must be finite numbers")
        hashes = hash_rows(parameters, self.chunk_rows)
        rows = self._find(parameters, hashes)
        new = np.flatnonzero(rows < 0)
        if new.size:
            unique, first, inverse = np.unique(hashes[new], return_index=True, return_inverse=True)
            rank = np.empty(first.size, dtype=np.int64)  # unique sorts by hash; rows keep the order of asking
            rank[np.argsort(first)] = np.arange(first.size)
            rows[new] = len(self) + rank[inverse]
            self._append(parameters, new[np.sort(first)], unique, len(self) + rank, settle=settle)
        return rows

    def find(self, parameters: Array) -> Array:
        """Row numbers ``[n]`` of known parameter sets ``[n, d]``, -1 for unknown ones."""
        return self._find(parameters, hash_rows(parameters, self.chunk_rows))

    @property
    def settled(self) -> int:
        """The number of rows that are in the arrays."""
        return len(self) - sum(map(len, self._unsettled))

    def settle(self) -> None:
        """Enter planned rows into the arrays."""
        if self._unsettled:
            parameters = np.concatenate(self._unsettled)
            self._extend(self.settled, parameters, np.arange(len(parameters)))
            self._unsettled = []
        self._planned.remove()

    def pending(self, rows: Array) -> Array:
        """Those of ``rows`` that have no outcome, sorted and unique."""
        asked = np.zeros(len(self), dtype=bool)
        asked[rows] = True
        return np.flatnonzero(asked & (self.status == PENDING))

    def reopen(self, rows: Array) -> None:
        """Make failed rows pending again, so that they are evaluated anew."""
        self.settle()
        status = self._array("status")
        for start in range(0, len(self), self.chunk_rows):
            chosen = rows[(rows >= start) & (rows < start + self.chunk_rows)]
            chosen = chosen[self.status[chosen] > 0]
            if chosen.size:
                self.status[chosen] = PENDING
                with store_errors(self._path("status")):
                    status[start : start + self.chunk_rows] = self.status[start : start + self.chunk_rows]

    # ---- committing

    def segments(self) -> list[Path]:
        """The segments in the journal, which are not folded in yet."""
        return sorted(self.journal.glob("rows-*.safetensors")) if self.journal.is_dir() else []

    @property
    def fold_chunks(self) -> int:
        """How many chunks are written together: as many as fit into ``CHUNK_BYTES``, and at most ``FOLD_CHUNKS``."""
        largest = max((8 * math.prod(self._array(name).chunks) for name in self.fields), default=1)
        return max(1, min(FOLD_CHUNKS, CHUNK_BYTES // largest))

    @property
    def _row_bytes(self) -> int:
        return sum(8 * math.prod(self._array(name).shape[1:]) for name in self.fields)

    def finished(self) -> int:
        """The number of rows with a committed outcome."""
        return int((self.status != PENDING).sum())

    def waiting(self) -> int:
        """The number of rows in segments that are not folded in yet."""
        return sum(int(count) for path in self.segments() if (count := path.stem.rpartition("-")[2]).isdecimal())

    def fold(self, paths: Iterable[Path] | Mapping[Path, Segment]) -> None:
        """Commit segments: write the chunks that they touch, ``status`` last, then delete the segments.

        Callers that have read the segments already pass them as the values of a mapping.
        """
        self.settle()
        known = paths if isinstance(paths, Mapping) else {}
        segments = [(path, known.get(path) or Segment.read(path)) for path in paths]
        widths = {name: self._array(name).shape[1:] for name in self.fields}
        for path, segment in segments:
            if wrong := segment.misfit(len(self), widths):
                raise StoreError(f"{path}: holds {wrong}; delete it, its rows are computed again")
        touched = {int(chunk) for _, segment in segments for chunk in np.unique(segment.rows // self.chunk_rows)}
        for first, last in spans(sorted(touched), self.fold_chunks):
            self._write_chunks(first, last, [segment for _, segment in segments])
        with store_errors(self._path("status")):
            sync_names(self.group)
        for path, _ in segments:
            path.unlink(missing_ok=True)

    def sync(self) -> None:
        """Bring to the disk what only the journal holds, while another thread may add rows and fold them in."""
        with store_errors(self.journal):
            self._planned.sync()
            segments = set(self.segments())
            for path in segments - self._synced:
                sync_file(path)
            if segments - self._synced:
                for folder in (self.journal, self.journal.parent, self.folder):
                    sync_folder(folder)
            self._synced = segments

    def _remove_unplanned(self) -> None:
        """Remove segments of rows whose plan was lost with the power, or by damage: nobody knows what they are of."""
        for path in self.segments():
            rows = Segment.read(path).rows
            if int(rows.max()) >= len(self) or self._lost[rows[rows < self._lost.size]].any():
                path.unlink()
                log.warning("segment", extra={"error": f"{path}: its rows were not planned; they are computed again"})

    def _write_chunks(self, first: int, last: int, segments: list[Segment]) -> None:
        """Write the rows of ``segments`` in the chunks from ``first`` to ``last``: the columns, then the status."""
        start, stop = first * self.chunk_rows, min((last + 1) * self.chunk_rows, len(self))
        status = self.status[start:stop].copy()
        parts: list[Part] = []
        for segment in segments:
            inside = np.flatnonzero((segment.rows >= start) & (segment.rows < stop))
            inside = inside[status[segment.rows[inside] - start] == PENDING]  # a committed row stays as it is
            if inside.size:
                parts.append((segment, inside, segment.rows[inside] - start))
                status[parts[-1][2]] = segment.status[inside]
        if not parts:
            return
        if self._row_bytes * (stop - start) <= LOADED_BYTES:
            parts = [(segment.loaded(), inside, rows) for segment, inside, rows in parts]
        had_some = bool((self.status[start:stop] != PENDING).any())
        names = [*self.fields, "attempts", "wall_seconds", "worker"]
        old = any((self._path("message") / "c" / str(chunk)).exists() for chunk in range(first, last + 1))
        if had_some or old or any(segment.messages for segment, _, _ in parts):
            names.append("message")
        for name in names:
            with store_errors(self._path(name)):
                array = self._array(name)
                held = np.asarray(array[start:stop]) if had_some else None
                array[start:stop] = column_of(parts, array, name, stop - start, held)
        with store_errors(self._path("status")):
            sync_names(self.group)  # a row has its numbers before it has a status
            self._array("status")[start:stop] = status
        self.status[start:stop] = status

    # ---- reading

    def parameters(self, rows: Array) -> Array:
        """Parameters ``[n, d]`` of ``rows``."""
        late = rows >= self.settled
        if not late.any():
            return self._planned_before(rows)
        found = np.empty((rows.size, self._width))
        self._unsettled = [np.concatenate(self._unsettled)]  # noted batch by batch, asked for row by row
        found[late] = self._unsettled[0][rows[late] - self.settled]
        found[~late] = self._planned_before(rows[~late])
        return found

    def _planned_before(self, rows: Array) -> Array:
        """Parameters ``[n, d]`` of ``rows`` that are in the arrays. Batches ask for one chunk, part by part."""
        if not rows.size or int(rows.min()) // self.chunk_rows != int(rows.max()) // self.chunk_rows:
            return self.read("parameters", rows)
        start = int(rows[0]) // self.chunk_rows * self.chunk_rows
        if self._chunk[0] != start or int(rows.max()) - start >= len(self._chunk[1]):
            stop = min(start + self.chunk_rows, self.settled)
            self._chunk = start, self.read("parameters", np.arange(start, stop))
        return np.asarray(self._chunk[1][rows - start])

    def read(self, name: str, rows: Array, columns: slice = slice(None)) -> Array:
        """A field at ``rows``, ``[n, ...]``, NaN for pending rows; ``columns`` selects along its first own axis.

        Raises ``StoreError`` when rows with an outcome have no numbers.
        """
        if rows.size and int(rows.max()) >= self.settled:
            self.settle()
        array = self._array(name)
        width = array.shape[1:]
        if len(width):
            width = (len(range(*columns.indices(width[0]))), *width[1:])
        out = np.empty((rows.size, *width), dtype=array.dtype)
        order = np.argsort(rows, kind="stable")
        for block in by_chunk(rows[order], self.chunk_rows):
            chosen = order[block]
            start = int(rows[chosen[0]]) // self.chunk_rows * self.chunk_rows
            with store_errors(self._path(name)):
                chunk = np.asarray(array[start : start + self.chunk_rows])
                if len(width):
                    chunk = chunk[:, columns]
            out[chosen] = chunk[rows[chosen] - start]
        if name in self.fields:
            out[self.status[rows] == PENDING] = np.nan  # a reopened row still has its old numbers there
            missing = without_numbers(out) & (self.status[rows] == 0)
            if missing.any():
                remedy = f"`sinew repair {self.folder}` makes them pending"
                raise StoreError(f"{self._path(name)}: {missing.sum()} rows with an outcome have no numbers; {remedy}")
        return out

    def coordinate(self, name: str) -> Array | None:
        """The values of a coordinate, or None where the table has none of this name."""
        with store_errors(self._path(name)):
            return coordinate(self.group, name, self._path(name)) if has(self.group, name) else None

    def dataset(self) -> xr.Dataset:
        """The table as a lazily loaded :class:`xarray.Dataset` with named dimensions and units."""
        with store_errors(self._path("")):
            check_arrays(self.group, self._path(""))
            return xr.open_zarr(self.folder / "store.zarr", group=self.group.path, zarr_format=3, **PLAIN)

    # ---- arrays and index

    def _array(self, name: str) -> zarr.Array[Any]:
        if name not in self._arrays:  # opening an array reads its metadata from the disk
            with store_errors(self._path(name)):
                array = row_array(self.group, name)
                if array.shape[0] < self.settled:
                    raise Damaged(f"it has {array.shape[0]:,} rows, the status has {self.settled:,}")
                check_chunks(array, self._path(name))
            self._arrays[name] = array
        return self._arrays[name]

    def _path(self, name: str) -> Path:
        return self.folder / "store.zarr" / self.group.path / name

    @property
    def _width(self) -> int:
        return int(self._array("parameters").shape[1])

    def _build_index(self) -> RowIndex:
        """Index the planned rows by content. Cuts rows off the end whose plan was interrupted."""
        planned = self._array("parameters")
        hashes = np.zeros(len(self), dtype=np.uint64)
        missing = np.zeros(len(self), dtype=bool)
        for rows in slices(len(self), self.chunk_rows):
            with store_errors(self._path("parameters")):
                block = np.asarray(planned[rows])
            hashes[rows] = hash_rows(block, self.chunk_rows)
            missing[rows] = np.isnan(block[:, 0])
        if (self.status[missing] != PENDING).any():
            raise StoreError(
                f"{self._path('parameters')}: parameters are missing for rows with an outcome; "
                f"`sinew repair {self.folder}` makes those rows pending"
            )
        if missing.any():  # at the end: a plan that was interrupted; elsewhere: rows lost to damage
            whole = len(self) - int(np.argmin(missing[::-1])) if not missing.all() else 0
            self.status, hashes, missing = self.status[:whole], hashes[:whole], missing[:whole]
        self._lost, kept = missing, np.flatnonzero(~missing)  # rows without parameters, and with them
        return RowIndex(hashes[kept], kept)

    def _find(self, parameters: Array, hashes: Array) -> Array:
        rows = self._index.find(hashes)
        known = np.flatnonzero(rows >= 0)
        for block in by_chunk(rows[known], self.chunk_rows):
            if not np.array_equal(self.parameters(rows[known[block]]), parameters[known[block]]):
                raise StoreError(f"{self._path('parameters')}: two parameter sets share one hash; please report this")
        return rows

    def _append(
        self, parameters: Array, chosen: Array, hashes: Array, rows: Array, *, settle: bool, note: bool = True
    ) -> None:
        """Plan the ``chosen`` of ``parameters`` as new rows; ``hashes`` and ``rows`` extend the index."""
        if settle:
            self.settle()
            self._extend(len(self), parameters, chosen)
        first = len(self)
        self.status = np.concatenate([self.status, np.full(chosen.size, PENDING, dtype=np.int8)])
        if not settle:
            self._unsettled.append(parameters[chosen] + 0.0)
            if note:
                self._planned.append(first, self._unsettled[-1])
        self._index.add(hashes, rows)

    def _restore_planned(self) -> None:
        """Plan the rows that the journal notes beyond the arrays."""
        noted, first = list[Array](), len(self)
        for row, values in self._planned.read(self._width):
            if row > first + len(noted) or not np.isfinite(values).all():
                break
            if row == first + len(noted):
                noted.append(values)
        if noted:
            parameters, chosen = np.array(noted), np.arange(len(noted))
            hashes = hash_rows(parameters, self.chunk_rows)
            self._append(parameters, chosen, hashes, first + chosen, settle=False, note=False)

    def _extend(self, first: int, parameters: Array, chosen: Array) -> None:
        """Extend the arrays, which hold ``first`` rows, by the ``chosen`` of ``parameters``; ``status`` comes last."""
        count = first + chosen.size
        with store_errors(self._path("parameters")):
            for name in (*self.fields, *COLUMNS, "parameters"):
                array = self._array(name)
                array.resize((count, *array.shape[1:]))
            planned = self._array("parameters")
            start = first
            together = max(1, min(PLANNED_CHUNKS, CHUNK_BYTES // (8 * self._width * self.chunk_rows)))
            while start < count:  # each chunk is written once, several of them together
                stop = min((start // self.chunk_rows + together) * self.chunk_rows, count)
                planned[start:stop] = parameters[chosen[start - first : stop - first]] + 0.0
                start = stop
            sync_names(self.group)
            self._array("status").resize((count,))  # a row exists once it has a status
            sync_names(self.group)
