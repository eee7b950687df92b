"""Kept fields of chosen rows as files for ParaView."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput, shown
from sinew.runner.store.store import open_store
from sinew.runner.store.table import Table
from sinew.tasks.simulate.febio.kept import entry_of, settings_of
from sinew.tasks.simulate.febio.kept_files import Place, contents, files, read_run
from sinew.tasks.simulate.febio.vtk import write_vtk

FOLDER = "fields"  # in a result folder


@dataclass(frozen=True)
class Exported:
    """The files that were written, and the variables that VTK's files have no place for."""

    paths: tuple[Path, ...]
    left_out: tuple[str, ...]


def export_rows(folder: Path, rows: Sequence[int], to: Path, name: str | None = None) -> Exported:
    """Write the kept fields of ``rows`` of a result folder into the folder ``to``, for each protocol.

    Rows are numbered as in the store, in the table ``name``, or in that whose rows have kept fields. Raises
    :class:`BadInput` for rows without fields, and :class:`sinew.runner.errors.StoreError`.
    """
    kept = {entry.key: place for path in files(folder / FOLDER) for entry, place in contents(path)}
    tables = [table for table in open_store(folder).tables() if name in (None, table.name)]
    if not tables:
        raise BadInput("--table", shown(name), "the name of a table in store.zarr/evaluations")
    chosen: dict[str, tuple[str, Place]] = {}
    for row in rows:
        found = {table.name: _runs(table, row, kept) for table in tables}
        found = {title: places for title, places in found.items() if places}
        if not found:
            most = max(len(table) for table in tables)
            problem = f"its fields were not kept; the store has {most:,} rows"
            raise BadInput(f"--row {row}", problem, "a row that was evaluated with keep: fields")
        if len({tuple(sorted(map(str, places.values()))) for places in found.values()}) > 1:
            raise BadInput(f"--row {row}", "is there in several tables", f"--table: {', '.join(sorted(found))}"[:200])
        title, places = next(iter(sorted(found.items())))
        for protocol, place in places.items():
            chosen[f"{_plain(title)}_row{row:06d}_{_plain(protocol)}"] = title, place
    paths, left_out = [], dict[str, None]()
    for stem, (_, place) in chosen.items():
        paths.append(to / f"{stem}.pvd")
        left_out |= dict.fromkeys(write_vtk(paths[-1], read_run(place).plot))
    return Exported(tuple(paths), tuple(left_out))


def _plain(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in name)[:80]


def _runs(table: Table, row: int, kept: dict[str, Place]) -> dict[str, Place]:
    """Where the runs of a row are kept, by protocol."""
    identity = table.identity
    protocols = table.coordinate("protocol")
    if protocols is None or row >= len(table) or not {"simulator", "model", "specimen"} <= set(identity):
        return {}
    of, values = settings_of(identity), table.parameters(np.array([row]))[0]
    keys = {str(name): entry_of(of, str(name), tuple(table.names), values).key for name in protocols}
    return {name: kept[key] for name, key in keys.items() if key in kept}
