"""Segments: the outcomes of one batch in one file of the journal, written completely or not at all."""

import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import google_crc32c
import numpy as np
import safetensors.numpy
from safetensors import SafetensorError, safe_open

from sinew.runner.errors import StoreError
from sinew.runner.store.damage import is_shortage, words
from sinew.runner.store.schema import MAX_CHUNK_ROWS, STATUSES, Array

if TYPE_CHECKING:  # workers write segments, and nothing else of the store
    import zarr

CHECKSUMS = "crc32c"  # the key of the checksums in a segment's metadata
TABLE = "table"  # that of the folder in which a segment is, which is named after its table
MAX_BYTES, MAX_WORDS_BYTES = 2**29, 2**24  # of a file; of its names, messages and checksums
LONGEST_MESSAGE, LONGEST_WORKER = 2000, 200  # characters
OWN = {"rows": "int64", "status": "int8", "attempts": "int16", "wall": "float64"}


@dataclass(frozen=True)
class Segment:
    """The outcomes of a batch, as a worker writes them; ``values[field]`` is ``[row, *dims]`` float64."""

    rows: Array
    status: Array
    attempts: Array
    wall_seconds: Array
    values: Mapping[str, Array]
    messages: tuple[str, ...]
    worker: str

    def write(self, path: Path) -> None:
        """Write the file completely or not at all. Raises ``OSError``, for example for a full disk."""
        arrays = {f"value:{name}": np.ascontiguousarray(array) for name, array in self.values.items()}
        arrays |= {"rows": self.rows, "status": self.status, "attempts": self.attempts, "wall": self.wall_seconds}
        metadata = {
            "messages": json.dumps(_whole(_shortened(self.messages))),
            "worker": _whole([self.worker])[0][:LONGEST_WORKER],
            TABLE: path.parent.name,
        }
        checksums = {name: _checksum(array) for name, array in arrays.items()} | {"": _checksum_of_words(metadata)}
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            try:
                safetensors.numpy.save_file(arrays, temporary, {**metadata, CHECKSUMS: json.dumps(checksums)})
            except SafetensorError as error:  # the system's error number is only in its text
                raise OSError(errno.ENOSPC if "os error 28" in str(error) else errno.EIO, str(error)) from error
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)

    @staticmethod
    def read(path: Path, *, whole: bool = False) -> "Segment":
        """Read a segment; its values are read on access, or at once if ``whole``. Raises ``StoreError``."""
        with _segment_errors(path), _opened(path) as file:
            metadata = file.metadata() or {}
            names = [name.removeprefix("value:") for name in file.keys() if name.startswith("value:")]  # noqa: SIM118
            checksums = _checksums(metadata)
            if checksums and set(checksums) != {"", *file.keys()}:
                raise ValueError("its arrays have other names than its checksums")
            if metadata.get(TABLE, path.parent.name) != path.parent.name:
                raise ValueError("it is of another table")
            slices = {name: file.get_slice(f"value:{name}") for name in names}
            lazy = _LazyValues(path, {name: tuple(each.get_shape()[1:]) for name, each in slices.items()}, checksums)
            values = lazy.read() if whole else lazy
            own = {name: _checked(file, name, checksums) for name in OWN}
            messages, worker = _shortened(json.loads(metadata["messages"])), metadata["worker"][:LONGEST_WORKER]
            segment = Segment(
                own["rows"], own["status"], own["attempts"], own["wall"], values, tuple(messages), str(worker)
            )
            _check_ranges(segment)
            for each in slices.values():
                if each.get_dtype() != "F64" or each.get_shape()[:1] != [segment.rows.size]:
                    raise ValueError("its values are those of other rows")
            return segment

    def misfit(self, count: int, widths: Mapping[str, tuple[int, ...]]) -> str:
        """What a table of so many rows, whose fields have these dimensions behind them, does not have; or nothing."""
        if int(self.rows.max()) >= count:
            return "rows that were never planned"
        lazy = self.values if isinstance(self.values, _LazyValues) else None
        own = lazy.widths if lazy is not None else {name: np.shape(each)[1:] for name, each in self.values.items()}
        wrong = [name for name, width in own.items() if widths.get(name) != width]
        return f"values of {wrong[0]!r} with another shape than those of its table" if wrong else ""

    def loaded(self) -> "Segment":
        """The same segment with its values in memory: they are read together, not one after the other."""
        return replace(self, values=self.values.read() if isinstance(self.values, _LazyValues) else self.values)

    def column(self, name: str, inside: Array) -> Any:
        """The table's column ``name`` at the positions ``inside`` of this segment."""
        if name == "attempts":
            return self.attempts[inside]
        if name == "wall_seconds":
            return self.wall_seconds[inside]
        if name == "worker":
            return np.array([self.worker] * inside.size, dtype=object)
        if name == "message":
            return np.array([self.messages[i] if self.messages else "" for i in inside], dtype=object)
        if name not in self.values:  # a batch that failed as a whole has no values
            return np.nan
        return self.values[name] if inside.size == self.rows.size else self.values[name][inside]


@dataclass(frozen=True)
class _LazyValues(Mapping[str, Array]):
    """The values of a segment, read field by field, so that no large chunk is in memory as a whole."""

    path: Path
    widths: Mapping[str, tuple[int, ...]]  # dimensions behind the rows
    checksums: Mapping[str, int]

    def __getitem__(self, name: str) -> Array:
        if name not in self.widths:
            raise KeyError(name)
        with _segment_errors(self.path), _opened(self.path) as file:
            return _checked(file, f"value:{name}", self.checksums)

    def read(self) -> dict[str, Array]:
        """All values."""
        with _segment_errors(self.path), _opened(self.path) as file:
            return {name: _checked(file, f"value:{name}", self.checksums) for name in self.widths}

    def __iter__(self) -> Iterator[str]:
        return iter(self.widths)

    def __len__(self) -> int:
        return len(self.widths)


def _shortened(messages: Any) -> Any:
    """Messages as long as people read them; what is no list of texts is refused later."""
    return [one[:LONGEST_MESSAGE] if isinstance(one, str) else one for one in messages]


def _whole(messages: Any) -> Any:
    """Texts without halves of surrogate pairs, which stand for bytes of names of files that are no text."""
    return [one.encode("utf-8", "replace").decode() if isinstance(one, str) else one for one in messages]


def _check_ranges(segment: Segment) -> None:
    """Raises ``ValueError`` for what no worker writes."""
    count = segment.rows.size
    own = (segment.rows, segment.status, segment.attempts, segment.wall_seconds)
    if [str(array.dtype) for array in own] != list(OWN.values()) or any(array.shape != (count,) for array in own):
        raise ValueError("its arrays have other types or lengths")
    if np.isinf(segment.wall_seconds).any() or (segment.wall_seconds < 0).any():
        raise ValueError("a time that no evaluation takes")
    if not 0 < count <= MAX_CHUNK_ROWS or segment.rows.min() < 0 or np.unique(segment.rows).size < count:
        raise ValueError("its rows are negative or not different")
    if (segment.status < 0).any() or (segment.status >= len(STATUSES)).any():
        raise ValueError(f"a status of {segment.status[(segment.status < 0) | (segment.status >= len(STATUSES))][0]}")
    if len(segment.messages) not in (0, count) or not all(isinstance(words, str) for words in segment.messages):
        raise ValueError("its messages are not those of its rows")
    for text in (segment.worker, *segment.messages):
        text.encode()  # half a surrogate pair is no text that a store can hold


def _checksums(metadata: Mapping[str, str]) -> dict[str, int]:
    """The checksums of a segment's arrays by name; none in those of versions that wrote none."""
    if CHECKSUMS not in metadata:
        return {}
    found = json.loads(metadata[CHECKSUMS])
    named = [name for name in ("messages", "worker", TABLE) if name in metadata]  # older ones do not tell the table
    if found[""] != _checksum_of_words({name: metadata[name] for name in named}):
        raise ValueError("a wrong checksum of its words")
    return dict(found)


def _checked(file: Any, name: str, checksums: Mapping[str, int]) -> Array:
    array: Array = file.get_tensor(name)
    if checksums and checksums[name] != _checksum(array):
        raise ValueError(f"a wrong checksum of {name}")
    return array


def _checksum(array: Array) -> int:
    return int(google_crc32c.value(np.ascontiguousarray(array).reshape(-1).view(np.uint8)))


def _checksum_of_words(metadata: Mapping[str, str]) -> int:
    return int(google_crc32c.value(json.dumps(metadata, sort_keys=True).encode()))


def _opened(path: Path) -> Any:
    """The file, if it is not larger than any segment. Raises ``ValueError``: memory is taken for what it says."""
    with path.open("rb") as file:
        words_size = int.from_bytes(file.read(8), "little")
    if path.stat().st_size > MAX_BYTES or words_size > MAX_WORDS_BYTES:
        raise ValueError("it is larger than any that is written")
    return safe_open(path, framework="numpy")


@contextmanager
def _segment_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (SafetensorError, OSError, LookupError, TypeError, ValueError, AttributeError, RecursionError) as error:
        if isinstance(error, OSError) and (is_shortage(error) or error.errno in (errno.EIO, errno.EACCES)):
            raise  # the file may be whole
        raise StoreError(
            f"{path}: not a whole segment ({words(error)}); `sinew repair {path.parent.parent.parent}` removes it, "
            "its rows are computed again"
        ) from None


def is_whole(path: Path) -> bool:
    """Whether a segment file exists and is complete."""
    try:
        with _opened(path):
            return True
    except (SafetensorError, OSError, ValueError):
        return False


#: Rows of a segment: their positions in it, and among those that are written.
Part = tuple[Segment, Array, Array]


def column_of(parts: list[Part], array: "zarr.Array[Any]", name: str, size: int, held: Array | None) -> Array:
    """The column ``name`` of ``size`` rows: what the store ``held``, or nothing, and ``parts``."""
    columns = [segment.column(name, inside) for segment, inside, _ in parts]
    ascend = [(np.diff(rows) == 1).all() for _, _, rows in parts]
    if held is None and ascend[0] and np.shape(columns[0])[:1] == (size,):
        return np.asarray(columns[0])  # these are all
    if held is not None:
        block = held
    elif sum(rows.size for _, _, rows in parts) == size:  # to fill what is overwritten would touch the memory twice
        block = np.empty((size, *array.shape[1:]), dtype=array.dtype)
    else:
        block = np.full((size, *array.shape[1:]), array.fill_value, dtype=array.dtype)
    for (_, _, rows), column, together in zip(parts, columns, ascend, strict=True):
        block[slice(rows[0], rows[-1] + 1) if together else rows] = column
    return block
