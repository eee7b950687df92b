"""Repair of a damaged store: only what is damaged beyond doubt is removed, and its rows become pending.

Where reading fails because memory or threads are short, nothing is removed.
"""

import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import zarr

from sinew.runner.errors import StoreError
from sinew.runner.files import remove_folder
from sinew.runner.store.arrays import COLUMNS, create_column
from sinew.runner.store.chunks import chunk_fault, chunk_files
from sinew.runner.store.damage import is_shortage, words
from sinew.runner.store.layout import (
    Damaged,
    chunk_rows_of,
    coordinate,
    fields_of,
    journal_of,
    row_array,
    status_array,
    table_group,
    table_key,
    unknown_status,
)
from sinew.runner.store.rows import slices
from sinew.runner.store.schema import PENDING, Array
from sinew.runner.store.segment import Segment

Widths = Mapping[str, tuple[int, ...]]  # by field: dimensions behind the rows
NO_LIMIT = 2**62  # rows: those whose plan was lost are removed where the table is opened


@dataclass(frozen=True)
class Repaired:
    """What a repair did: ``rows`` that are pending now, and a line for each thing that it removed or made anew."""

    rows: int
    removed: tuple[str, ...]


def repair_tables(store: Path, root: zarr.Group, journal: Path) -> Repaired:
    """Repair all tables of a store and their segments. Raises ``StoreError`` when something cannot be read now."""
    rows, removed = 0, list[str]()
    widths: dict[str, Widths] = {}
    folder = store / "evaluations"
    for place in sorted(folder.iterdir()) if folder.is_dir() else ():
        if not (place / "zarr.json").is_file():
            continue
        try:
            with _refuse_shortage(place):
                with _damage("zarr.json"):
                    group = table_group(root, place.name)
                if group.attrs.get("complete"):
                    table_key(group)
                    lost, made = _repair_table(place, group)
                    if key := journal_of(place.name):
                        widths[key] = {name: row_array(group, name).shape[1:] for name in fields_of(group)}
                    rows, removed = rows + lost, removed + made
        except Damaged as error:
            _drop(place, journal)
            removed.append(f"{place}: {error}; it cannot be mended, all of its rows are computed again")
    return Repaired(rows, (*removed, *remove_damaged_segments(journal, widths)))


def remove_damaged_segments(journal: Path, widths: Mapping[str, Widths] = MappingProxyType({})) -> list[str]:
    """Remove segments that are not whole, or do not fit to their table; returns a line for each.

    ``widths``: of the fields of tables, by the names of these in the journal. Raises ``StoreError`` as
    :func:`repair_tables`.
    """
    removed = []
    for path in sorted(journal.glob("*/rows-*.safetensors")):
        with _refuse_shortage(path):
            try:
                segment = Segment.read(path, whole=True)
                table = widths.get(path.parent.name)
                if table is not None and (wrong := segment.misfit(NO_LIMIT, table)):
                    raise StoreError(f"{path}: holds {wrong}")
            except StoreError as error:
                path.unlink() if path.is_file() else remove_folder(path)
                removed.append(f"{str(error).partition(';')[0]}; it is removed, its rows are computed again")
    return removed


def without_numbers(values: Array) -> Array:
    """Which of ``values`` ``[n, ...]`` are not all finite: Zarr reads a missing chunk file as an empty one, of NaN."""
    return np.asarray(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


def _repair_table(place: Path, group: zarr.Group) -> tuple[int, list[str]]:
    """Returns the number of rows that are pending now, and a line for each column that was created again.

    Raises :class:`Damaged` for what no repair can bring back.
    """
    chunk_rows, fields = chunk_rows_of(group), fields_of(group)
    arrays = {}
    for name in ("parameters", *fields):
        with _damage(name):
            arrays[name] = row_array(group, name)
    _check_coordinates(place, group, arrays.values())
    planned = min(array.shape[0] for array in arrays.values())
    made: list[str] = []
    status = _column(place, group, "status", planned, made)
    forgotten = status.shape[0] if made and not chunk_files(place / "status" / "c") else 0
    for name in COLUMNS:
        arrays[name] = _column(place, group, name, status.shape[0], made)
    for array in arrays.values():
        if array.shape[0] < status.shape[0]:
            array.resize((status.shape[0], *array.shape[1:]))
    lost = _repair_chunks(place, {"status": status, **arrays}, fields, chunk_rows)
    return max(lost, forgotten), made


def _check_coordinates(place: Path, group: zarr.Group, arrays: Iterable[zarr.Array[Any]]) -> None:
    """Raises :class:`Damaged` for a coordinate that is missing, or cannot be read."""
    dims = {str(dim) for array in arrays for dim in (array.metadata.dimension_names or ())[1:]}  # type: ignore[union-attr]
    others = str(group.attrs.get("coordinates", "")).split()
    along = set()
    for name in sorted({*others, *(dim for dim in dims if dim in group)}):
        with _damage(name):
            coordinate(group, name, place / name)
            along |= set(group[name].metadata.dimension_names or ())  # type: ignore[union-attr]
    if lost := sorted(dims - along):
        raise Damaged(f"{lost[0]}: the array is missing")


def _column(place: Path, group: zarr.Group, name: str, count: int, made: list[str]) -> zarr.Array[Any]:
    """A column of a table; where it is missing or laid out wrongly, it is created again, and its chunks stay.

    What was wrong is added to ``made``.
    """
    try:
        with _damage(name):
            return status_array(group, place) if name == "status" else row_array(group, name)
    except Damaged as error:
        made.append(f"{place / name}: damaged ({str(error).removeprefix(f'{name}: ')}); it is created again")
        (place / name / "zarr.json").unlink(missing_ok=True)
        create_column(group, name, count, chunk_rows_of(group))
        return row_array(group, name)


def _repair_chunks(place: Path, arrays: dict[str, zarr.Array[Any]], fields: tuple[str, ...], chunk_rows: int) -> int:
    """Remove damaged chunks and make their rows pending; returns the number of these rows."""
    status = arrays["status"]
    lost = np.zeros(status.shape[0], dtype=bool)
    for name in arrays:  # the status first
        if (stray := place / name / "c").is_file():  # in the place of the folder of chunks
            stray.unlink()
            lost[:] = True
        for chunk, rows in enumerate(slices(lost.size, chunk_rows)):
            with _refuse_shortage(place / name):
                try:
                    for file in chunk_files(place / name / "c" / str(chunk)):
                        if fault := chunk_fault(file, arrays[name]):
                            raise Damaged(fault)
                    values = np.asarray(arrays[name][rows])
                except Exception as error:
                    if is_shortage(error) or isinstance(error, OSError):
                        raise
                    _remove_chunk(place / name / "c" / str(chunk))
                    # when the status itself is damaged, nobody knows which rows had an outcome
                    lost[rows] |= True if name == "status" else np.asarray(status[rows]) != PENDING
                    continue
            if name in fields:
                lost[rows] |= without_numbers(values) & (np.asarray(status[rows]) == 0)
            if name == "parameters":
                lost[rows] |= without_numbers(values) & (np.asarray(status[rows]) != PENDING)
            if name == "status":
                lost[rows] |= unknown_status(values)
    for rows in slices(lost.size, chunk_rows):
        if lost[rows].any():
            status[rows] = np.where(lost[rows], PENDING, np.asarray(status[rows])).astype(np.int8)
    return int(lost.sum())


def _drop(place: Path, journal: Path) -> None:
    """Give a table up: without its ``zarr.json`` it is created anew. Its segments speak of rows that are gone."""
    (place / "zarr.json").unlink()
    if segments := journal_of(place.name):
        shutil.rmtree(journal / segments, ignore_errors=True)


def _remove_chunk(place: Path) -> None:
    for file in [place] if place.is_file() else place.rglob("*"):
        if file.is_file():
            file.unlink()


@contextmanager
def _damage(name: str) -> Iterator[None]:
    """Raise whatever Zarr raises for a damaged array as :class:`Damaged`."""
    try:
        yield
    except Exception as error:  # what Zarr raises for damaged files is no closed list
        if is_shortage(error) or isinstance(error, OSError):
            raise
        raise Damaged(f"{name}: {words(error)}") from error


@contextmanager
def _refuse_shortage(path: Path) -> Iterator[None]:
    """Let :class:`Damaged` pass; everything else ends the repair with one line."""
    try:
        yield
    except (Damaged, OSError):
        raise
    except Exception as error:
        raise StoreError(f"{path}: cannot be checked now ({words(error)}); nothing of it was removed") from error
