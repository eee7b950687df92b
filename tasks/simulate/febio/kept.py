"""Kept runs: what the solver computed for rows, so that a new output of them needs no new run.

They lie in ``OUT/fields``, one zip of a Zarr v3 hierarchy for the rows of a batch along a protocol. A worker writes its
file whole and under a name that its content decides, and before the outcomes of the batch: two processes never write
into one file, and a row that counts has its fields. Files of rows that never came to count are overwritten or unused.

```text
OUT/fields/<rows>.zarr.zip
    zarr.json     attributes: format, and of each run its key, protocol, parameters, and the number of its mesh
    mesh_0/       node_ids, nodes, domain_0 (id and corners of each element), surface_0, node_set_0, ...
    run_0/        time_s, logged (the log's outputs along the protocol), and one array [state, item, component] of each
                  variable
```
"""

import hashlib
import io
import json
import uuid
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.core.buffer import default_buffer_prototype
from zarr.core.sync import sync
from zarr.storage import MemoryStore, ZipStore

from sinew.runner.store.durable import sync_folder, write_whole
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.plot_file import PlotFile
from sinew.tasks.simulate.febio.plot_mesh import Mesh, Region

FORMAT = 1
ENDING = ".zarr.zip"
CHUNK_BYTES = 2**24
_EPOCH = (1980, 1, 1, 0, 0, 0)  # of files in an archive: equal rows give equal bytes


@dataclass(frozen=True, eq=False)
class Run:
    """One run of the solver: the outputs of its log, by what they are, along its protocol ``[t]``; and its fields."""

    logged: Mapping[str, Array]
    plot: PlotFile


@dataclass(frozen=True, eq=False)
class Entry:
    """A run that is kept in a file: its ``key``, and the protocol and the parameters that it is of.

    ``of`` is the hash of all that it depends on besides the parameters.
    """

    key: str
    of: str
    protocol: str
    parameters: Mapping[str, float]


def settings_of(
    model: Mapping[str, Any], specimen: Mapping[str, Any], simulator: Mapping[str, Any], protocol: str
) -> str:
    """The hash of what a run depends on besides the parameters, from identities and the digest of its ``protocol``.

    That is the model, the size of the specimen, the solver and its template, and the history. It is neither what was
    measured, nor how noisy that is, nor which outputs are read: none of these needs a new run.
    """
    counts = {
        "model": model,
        "size": {name: specimen[name] for name in ("length_mm", "width_mm", "thickness_mm")},
        "simulator": {k: v for k, v in simulator.items() if k not in ("outputs", "fields", "force")},
        "protocol": protocol,
    }
    return hashlib.blake2b(json.dumps(counts, sort_keys=True).encode(), digest_size=16).hexdigest()


def key_of(of: str, names: tuple[str, ...], values: Array) -> str:
    """The key of the run with parameter ``values`` ``[d]``."""
    words = json.dumps([of, list(names)]).encode()
    content = (np.asarray(values, "<f8") + 0.0).tobytes()
    return hashlib.blake2b(content, key=hashlib.blake2b(words).digest(), digest_size=16).hexdigest()


def entry_of(of: str, protocol: str, names: tuple[str, ...], values: Array) -> Entry:
    """The entry of the run with parameter ``values`` ``[d]`` along the ``protocol`` of this name."""
    return Entry(key_of(of, names, values), of, protocol, dict(zip(names, map(float, values), strict=True)))


def write_runs(folder: Path, runs: list[tuple[Entry, Run]]) -> Path:
    """Write runs into one file, whole or not at all. Raises ``OSError``."""
    store = MemoryStore()
    root = zarr.open_group(store, mode="w", zarr_format=3)
    meshes: dict[str, int] = {}
    listed = []
    for number, (entry, run) in enumerate(runs):
        digest = _digest(run.plot.mesh)
        if digest not in meshes:
            meshes[digest] = len(meshes)
            _write_mesh(root.create_group(f"mesh_{meshes[digest]}"), run.plot.mesh)
        _write_run(root.create_group(f"run_{number}"), run)
        about = {"key": entry.key, "of": entry.of, "protocol": entry.protocol, "parameters": dict(entry.parameters)}
        listed.append(about | {"mesh": meshes[digest]})
    root.update_attributes({"sinew_fields": FORMAT, "runs": listed})
    name = hashlib.blake2b("".join(entry.key for entry, _ in runs).encode(), digest_size=12).hexdigest()
    path = folder / f"rows-{name}-{len(runs):05d}{ENDING}"
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(path, folder / f".{path.name}.{uuid.uuid4().hex}.partial", _packed(store))
    sync_folder(folder)
    return path


def _packed(store: MemoryStore) -> bytes:
    """The content of a store as a zip without compression: its chunks are compressed."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_STORED) as archive:
        for key in sorted(store._store_dict):
            buffer = sync(store.get(key, default_buffer_prototype()))
            assert buffer is not None
            archive.writestr(zipfile.ZipInfo(key, _EPOCH), buffer.to_bytes())
    return packed.getvalue()


def as_zarr(path: Path) -> zarr.Group:
    """The hierarchy of a file that is known to be sound."""
    return zarr.open_group(ZipStore(path, mode="r"), mode="r", zarr_format=3, use_consolidated=False)


def _create(group: zarr.Group, name: str, values: Array, dims: tuple[str, ...], **attributes: Any) -> None:
    each = max(1, values.nbytes // max(1, len(values)))
    rows = min(max(1, len(values)), max(1, CHUNK_BYTES // each))
    group.create_array(
        name,
        shape=values.shape,
        chunks=(rows, *(max(1, size) for size in values.shape[1:])),
        dtype=values.dtype,
        fill_value=0,
        dimension_names=dims,
        attributes=attributes,
        compressors=[BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"), Crc32cCodec()],
    )[...] = values


def _write_run(group: zarr.Group, run: Run) -> None:
    plot = run.plot
    _create(group, "time_s", plot.time_s, ("state",), units="s")
    courses = np.stack(list(run.logged.values())) if run.logged else np.zeros((0, 0))
    _create(group, "logged", courses, ("logged", "time"), names=list(run.logged))
    taken: set[str] = set()
    for number, (name, variable) in enumerate(plot.variables.items()):
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:60]
        plain = plain if plain not in taken | {"time_s", "logged", ""} else f"{plain}_{number}"
        taken.add(plain)
        about = {"where": variable.where, "per": variable.per, "kind": variable.kind, "units": variable.unit}
        regions = [list(region) for region in variable.regions]
        # named by its items, so that xarray opens variables of nodes, elements and faces together
        dims = ("state", f"items_{plain}", f"components_{plain}")
        _create(group, plain, variable.values, dims, variable=name, number=number, regions=regions, **about)


def _write_mesh(group: zarr.Group, mesh: Mesh) -> None:
    _create(group, "node_ids", mesh.node_ids, ("node",))
    _create(group, "nodes", mesh.nodes, ("node", "axis"))
    for kind, regions in (("domain", mesh.domains), ("surface", mesh.surfaces), ("edge", mesh.edges)):
        for number, region in enumerate(regions):
            about = {"region": region.name, "shape": region.shape, "part": region.part}
            table = np.column_stack([region.ids, region.corners])
            _create(group, f"{kind}_{number}", table, (f"{kind}_{number}", f"corners_{kind}_{number}"), **about)
    for kind, sets in (("node_set", mesh.node_sets or {}), ("element_set", mesh.element_sets or {})):
        for number, (name, items) in enumerate(sets.items()):
            _create(group, f"{kind}_{number}", items, (f"{kind}_{number}",), set=name)
    counts = {"domains": len(mesh.domains), "surfaces": len(mesh.surfaces), "edges": len(mesh.edges)}
    counts |= {"node_sets": len(mesh.node_sets or {}), "element_sets": len(mesh.element_sets or {})}
    group.update_attributes({**counts, "parts": {str(number): name for number, name in (mesh.parts or {}).items()}})


def _digest(mesh: Mesh) -> str:
    found = hashlib.blake2b(digest_size=16)

    def region(one: Region) -> None:
        found.update(json.dumps([one.name, one.shape, one.part, one.corners.shape]).encode())
        found.update(one.ids.tobytes() + one.corners.tobytes())

    found.update(mesh.node_ids.tobytes() + mesh.nodes.tobytes())
    for one in (*mesh.domains, *mesh.surfaces, *mesh.edges):
        region(one)
    for name, items in (*(mesh.node_sets or {}).items(), *(mesh.element_sets or {}).items()):
        found.update(json.dumps([name, items.size]).encode() + items.tobytes())
    found.update(json.dumps(sorted((mesh.parts or {}).items())).encode())
    return found.hexdigest()
