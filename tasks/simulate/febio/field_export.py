"""Kept fields of chosen rows as files for ParaView."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from sinew.runner.errors import BadInput, StoreError, shown
from sinew.runner.store.store import open_store
from sinew.runner.store.table import Table
from sinew.tasks.simulate.evaluation import HISTORY
from sinew.tasks.simulate.febio.keeping import Index
from sinew.tasks.simulate.febio.kept import key_of, settings_of
from sinew.tasks.simulate.febio.vtk import write_vtk

MOST_HISTORIES, MAX_MODEL = 2_000, 2**17  # of a table, each hashed with its model of so many characters

FOLDER = "fields"  # in a result folder


@dataclass(frozen=True)
class Exported:
    """The files that were written, and the variables that VTK's files have no place for.

    ``damaged``: of each file of kept runs that cannot be read, a line that names it. ``missing``: a line for each row
    that has no fields, but may have had them in one of these.
    """

    paths: tuple[Path, ...]
    left_out: tuple[str, ...]
    damaged: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


def export_rows(folder: Path, rows: Sequence[int], to: Path, name: str | None = None) -> Exported:
    """Write the kept fields of ``rows`` of a result folder into the folder ``to``, for each protocol.

    Rows are numbered as in the store, in the table ``name``, or in that whose rows have kept fields. A file of kept
    runs that is damaged costs no other file's rows. Raises :class:`BadInput` for rows without fields, and
    :class:`sinew.runner.errors.StoreError`.
    """
    index = Index(folder / FOLDER)
    index.look()
    tables = [table for table in open_store(folder).tables() if name in (None, table.name)]
    if not tables:
        raise BadInput("--table", shown(name), "the name of a table in store.zarr/evaluations")
    chosen: dict[str, str] = {}
    missing = []
    for row in rows:
        found = {table.name: _runs(table, row, index) for table in tables}
        found = {title: keys for title, keys in found.items() if keys}
        if not found:
            most = max(len(table) for table in tables)
            problem = f"its fields were not kept; the store has {most:,} rows"
            absent = BadInput(f"--row {row}", problem, "a row that was evaluated with keep: fields")
            if not index.damaged or row >= most:
                raise absent
            missing.append(f"--row {row}: its fields were not kept, or are in a file that is damaged")
            continue
        if len({tuple(sorted(keys.values())) for keys in found.values()}) > 1:
            raise BadInput(f"--row {row}", "is there in several tables", f"--table: {', '.join(sorted(found))}"[:200])
        title, keys = next(iter(sorted(found.items())))
        for along, key in keys.items():
            stem = f"{_plain(title)}_row{row:06d}_{_plain(along)}"
            more = count(2)
            while chosen.setdefault(stem, key) != key:  # names that differ in other characters
                stem = f"{stem.rpartition('__')[0] or stem}__{next(more)}"
    paths: list[Path] = []
    left_out: dict[str, None] = {}
    for stem, key in chosen.items():
        run = next(index.runs(key), None)
        if run is None:
            missing.append(f"{stem}: its fields are in a file that is damaged")
            continue
        paths.append(to / f"{stem}.pvd")
        left_out |= dict.fromkeys(write_vtk(paths[-1], run.plot))
    return Exported(tuple(paths), tuple(left_out), tuple(index.damaged.values()), tuple(missing))


def _plain(name: str) -> str:
    return "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in name)[:80]


def _runs(table: Table, row: int, index: Index) -> dict[str, str]:
    """The keys of a row's runs that are kept, by protocol, or by specimen and protocol in a table of a whole site."""
    histories = table.coordinate(HISTORY)
    if histories is None or row >= len(table):
        return {}
    if histories.size > MOST_HISTORIES:
        raise StoreError(f"{table.folder / 'store.zarr'}: {table.title} holds {histories.size:,} histories")
    curves = table.coordinate("curve")
    titles = table.coordinate("protocol") if curves is None else curves
    identity, found = table.identity, {}
    if len(json.dumps({name: identity.get(name) for name in ("model", "simulator")})) > MAX_MODEL:
        return {}  # the identity of something else
    try:
        specimens = identity["specimens"] if "specimens" in identity else [identity["specimen"]]
        of_curve = [one for one in specimens for _ in one["curves"]]  # in the order of the coordinate
        settings = [
            settings_of(identity["model"], one, identity["simulator"], str(history))
            for one, history in zip(of_curve, histories, strict=False)
        ]
    except (KeyError, TypeError, AttributeError):  # the identity of something else
        return {}
    values = table.parameters(np.array([row]))[0]
    for title, of in zip([] if titles is None else titles, settings, strict=False):
        if (key := key_of(of, tuple(table.names), values)) in index.places:
            found[str(title)] = key
    return found
