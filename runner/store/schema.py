"""What a table holds: its parameters, fields, coordinates and identity, and the statuses of its rows."""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

CHUNK_ROWS = 2048
MAX_CHUNK_ROWS = 4 * CHUNK_ROWS  # that are read
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
    """One number or one curve per row; ``dims`` names the axes after ``row``."""

    name: str
    dims: tuple[str, ...]
    unit: str
    description: str


@dataclass(frozen=True)
class Coordinate:
    """Values along a dimension: numbers with a unit, or names."""

    name: str
    dim: str
    values: Array
    unit: str = ""


@dataclass(frozen=True)
class TableSpec:
    """The schema of a table. ``identity`` holds everything that an outcome depends on, except the parameters."""

    title: str
    identity: Mapping[str, Any]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    fields: tuple[Field, ...]
    coordinates: tuple[Coordinate, ...]

    @property
    def chunk_rows(self) -> int:
        """Rows per chunk; fewer for wide fields, so that no chunk exceeds 32 MB."""
        lengths = {coordinate.dim: coordinate.values.size for coordinate in self.coordinates}
        widest = max(math.prod(lengths[dim] for dim in field.dims) for field in self.fields)
        return max(16, min(CHUNK_ROWS, 2 ** int(math.log2(max(16, CHUNK_BYTES // (8 * widest))))))

    @property
    def key(self) -> str:
        """A hash of the identity: 32 hexadecimal digits."""
        text = json.dumps(self.identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
