"""The Zarr arrays of a table: how a new table is laid out."""

import json
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from sinew.runner.store.durable import sync_names
from sinew.runner.store.schema import PENDING, STATUSES, Coordinate, TableSpec

#: Columns that every table has beside its parameters and fields: type, fill value, attributes. ``status`` is apart.
COLUMNS: dict[str, tuple[Any, Any, dict[str, Any]]] = {
    "attempts": ("i2", 0, {"long_name": "how often the row was tried"}),
    "wall_seconds": ("f8", np.nan, {"units": "s", "long_name": "time of its evaluation"}),
    "worker": (str, "", {"long_name": "host, job and process that evaluated the row"}),
    "message": (str, "", {"long_name": "why the row failed, in the solver's words"}),
}


def create_table(root: zarr.Group, name: str, spec: TableSpec) -> None:
    """Create the group ``name`` with the arrays of ``spec``, without rows. Its mark ``complete`` is written last."""
    lengths = {coordinate.dim: coordinate.values.size for coordinate in spec.coordinates}
    group = root.create_group(name, overwrite=True)
    _create_coordinates(group, spec)
    rows = spec.chunk_rows
    shape: tuple[int, ...] = (0, len(spec.parameters))
    _create(group, "parameters", "f8", np.nan, ("row", "parameter"), shape, {"long_name": "parameters"}, rows)
    for field in spec.fields:
        shape = (0, *(lengths[dim] for dim in field.dims))
        attributes = {"units": field.unit, "long_name": field.description}
        _create(group, field.name, "f8", np.nan, ("row", *field.dims), shape, attributes, rows)
    for column in ("status", *COLUMNS):
        create_column(group, column, 0, rows)
    sync_names(group)
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
    sync_names(group)


def create_column(group: zarr.Group, name: str, count: int, chunk_rows: int) -> None:
    """Create ``status`` or one of :data:`COLUMNS` for ``count`` rows."""
    flags = {"flag_values": [PENDING, *range(len(STATUSES))], "flag_meanings": " ".join(("pending", *STATUSES))}
    dtype, fill, attributes = ("i1", PENDING, flags) if name == "status" else COLUMNS[name]
    _create(group, name, dtype, fill, ("row",), (count,), attributes, chunk_rows)


def _create_coordinates(group: zarr.Group, spec: TableSpec) -> None:
    names = Coordinate("parameter", "parameter", np.array(spec.parameters, dtype=object))
    units = Coordinate("parameter_unit", "parameter", np.array(spec.units, dtype=object))
    for coordinate in (names, units, *spec.coordinates):
        text = coordinate.values.dtype == object
        dtype, fill = (str, "") if text else ("f8", np.nan)
        attributes = {} if text else {"units": coordinate.unit}
        size = coordinate.values.size
        _create(group, coordinate.name, dtype, fill, (coordinate.dim,), (size,), attributes, size)
        group[coordinate.name][:] = coordinate.values  # type: ignore[index]


def _create(
    group: zarr.Group,
    name: str,
    dtype: Any,
    fill: Any,
    dims: tuple[str, ...],
    shape: tuple[int, ...],
    attributes: dict[str, Any],
    chunk: int,
) -> None:
    # the fastest compression: it serves the empty rest of chunks, as the last digits of forces are noise
    codecs = [BloscCodec(cname="lz4", clevel=1, shuffle="noshuffle"), Crc32cCodec()]
    group.create_array(
        name,
        shape=shape,
        chunks=(chunk, *shape[1:]),
        dtype=dtype,
        fill_value=fill,
        dimension_names=dims,
        attributes=attributes,
        **({} if dtype is str else {"compressors": codecs}),  # type: ignore[arg-type]
    )
