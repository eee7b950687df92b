"""Reading kept runs, which may come from anywhere: nothing is believed that a file says about its own size."""

import os
import stat
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from sinew.runner.errors import StoreError, of_the_system, shown
from sinew.runner.files import what_is
from sinew.runner.store.chunks import BLOSC_HEADER, blosc_fault, codecs_fault, too_large
from sinew.runner.store.damage import words
from sinew.runner.zip_end import directory_of
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.kept import ENDING, FORMAT, Entry, Run, as_zarr, key_of
from sinew.tasks.simulate.febio.plot_file import MAX_VARIABLES, PlotFile, Variable, fits
from sinew.tasks.simulate.febio.plot_mesh import MAX_PART, MAX_REGIONS, SHAPES, Mesh, Region, repeats

MAX_MEMBERS, MAX_DIRECTORY = 200_000, 2**25  # entries of a zip, and the bytes that all of them take
MAX_ARRAY_BYTES = 2**28
MAX_JSON = 2**22
MAX_RUNS = 10_000  # of a file, which keeps those of a batch


@dataclass(frozen=True)
class Place:
    """Where a run is kept: in which file, and as which of its runs."""

    path: Path
    number: int
    mesh: int


def files(folder: Path) -> list[Path]:
    """The files of kept runs in a folder, which may not be there."""
    return sorted(path for path in folder.glob(f"rows-*{ENDING}") if path.is_file()) if folder.is_dir() else []


def contents(path: Path) -> list[tuple[Entry, Place]]:
    """The runs in a file. Raises :class:`StoreError`."""
    with _sound(path) as (_, root):
        about = root.attrs.asdict()
        if about.get("sinew_fields") != FORMAT:
            raise ValueError(f"its format is {str(about.get('sinew_fields'))[:20]}, not {FORMAT}")
        runs: Any = about["runs"]
        if len(runs) > MAX_RUNS:
            raise ValueError(f"it lists {len(runs):,} runs")
        found, keys = [], set[str]()
        for number, run in enumerate(runs):
            parameters = {str(name): float(value) for name, value in run["parameters"].items()}
            entry = Entry(str(run["key"]), str(run["of"]), str(run["protocol"]), parameters)
            if entry.key in keys:  # all runs with a key are read
                raise ValueError("it lists a run twice")
            if entry.key != key_of(entry.of, tuple(parameters), np.array(list(parameters.values()))):
                raise ValueError("it lists a run with parameters that are not those of its key")
            keys.add(entry.key)
            found.append((entry, Place(path, number, int(run["mesh"]))))
        return found


def read_run(place: Place) -> Run:
    """A kept run. Raises :class:`StoreError` for a file that is damaged."""
    with _sound(place.path) as (archive, root):
        read = _Reader(archive, root)
        group = f"run_{place.number}"
        names = _variables(read, group)
        courses = read.array(f"{group}/logged", "f8", 2)
        logged = [str(name) for name in read.about(f"{group}/logged")["names"]]
        if len(logged) != len(courses):
            raise ValueError("its logged outputs have other names")
        mesh = _mesh(read, f"mesh_{place.mesh}")
        time_s = read.array(f"{group}/time_s", "f8", 1)
        if not np.isfinite(time_s).all() or (np.diff(time_s) <= 0).any() or not np.isfinite(courses).all():
            raise ValueError("its times or logged outputs are no courses")
        numbered = [_variable(read, f"{group}/{name}", mesh, time_s.size) for name in names]
        variables = {variable.name: variable for _, variable in sorted(numbered, key=lambda one: one[0])}
        return Run(dict(zip(logged, courses, strict=True)), PlotFile(time_s, mesh, variables))


def count_variables(place: Place) -> int:
    """How many variables of the plot file are kept of a run. Raises :class:`StoreError`."""
    with _sound(place.path) as (archive, root):
        return len(_variables(_Reader(archive, root), f"run_{place.number}"))


@contextmanager
def _sound(path: Path) -> Iterator[tuple[zipfile.ZipFile, zarr.Group]]:
    """A file whose members are what they claim to be, as a zip and as a hierarchy."""
    try:
        if not stat.S_ISREG(mode := os.lstat(path).st_mode):
            raise ValueError(f"it is {what_is(mode)}")  # a device has no end, and zipfile looks for it
        with path.open("rb") as file:
            count, size = directory_of(file)  # zipfile reads all of it before it looks at it
        if count > MAX_MEMBERS or size > MAX_DIRECTORY:
            raise ValueError(f"it lists {count:,} members in {size:,} bytes")
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            stored = all(
                one.compress_type == zipfile.ZIP_STORED and one.file_size == one.compress_size for one in members
            )
            small = all(one.file_size <= MAX_JSON for one in members if one.filename.endswith("zarr.json"))
            if not stored or not small or len(members) > MAX_MEMBERS:
                raise ValueError("its members are not those that are written here")
            if sum(one.file_size for one in members) > path.stat().st_size:
                raise ValueError("its members are larger than it is")
            root = as_zarr(path)
            try:
                yield archive, root
            finally:
                root.store.close()
    except StoreError:
        raise
    except OSError as error:
        raise StoreError(f"{path}: {of_the_system(error)}") from None
    except Exception as error:  # noqa: BLE001 - what zipfile, Zarr and its codecs raise for damaged files is no closed list
        raise StoreError(
            f"{path}: damaged ({words(error)}); delete it, its rows are solved again if asked for"
        ) from None


class _Reader:
    """The arrays of a hierarchy, each checked before a byte of it is decompressed."""

    def __init__(self, archive: zipfile.ZipFile, root: zarr.Group) -> None:
        self.archive = archive
        self.root = root
        self.left = 2 * MAX_ARRAY_BYTES
        self._children: dict[str, set[str]] = {}  # of each group
        self._chunks: dict[str, list[str]] = {}  # of each array
        self._members = len(archive.namelist())
        for member in archive.namelist():
            if member.endswith("/zarr.json"):
                group, _, name = member.removesuffix("/zarr.json").rpartition("/")
                self._children.setdefault(group, set()).add(name)
            else:
                self._chunks.setdefault(member.rpartition("/c/")[0], []).append(member)

    def names(self, group: str) -> list[str]:
        return sorted(self._children.get(group, ()))

    def about(self, name: str) -> Mapping[str, Any]:
        return self.root[name].attrs.asdict()

    def array(self, name: str, dtype: str, dims: int) -> Array:
        """Raises ``ValueError`` for an array that is not what is written here, and whatever Zarr raises."""
        array = self.root[name]
        if not isinstance(array, zarr.Array):
            raise ValueError(f"{name} is no array")
        if array.dtype != np.dtype(dtype) or array.ndim != dims or (fault := codecs_fault(array)):
            raise ValueError(f"{name} has another type or shape, or other codecs ({fault or array.dtype})")
        size = array.dtype.itemsize * int(np.prod(array.shape, dtype=object))
        chunk = array.dtype.itemsize * int(np.prod(array.chunks, dtype=object))
        if too_large(array):
            raise ValueError(f"{name} has the shape {array.shape} and chunks {array.chunks}")
        self.left -= max(size, chunk * len(self._chunks.get(name, ())))
        parts = int(
            np.prod([-(-length // part) for length, part in zip(array.shape, array.chunks, strict=True)], dtype=object)
        )
        if parts > self._members:  # it may have fewer files: chunks of zeros are not written
            raise ValueError(f"{name} claims {parts:,} chunks")
        if size > MAX_ARRAY_BYTES or self.left < 0 or chunk > MAX_ARRAY_BYTES:
            raise ValueError(f"{name} claims {size:,} bytes")
        for member in self._chunks.get(name, ()):
            with self.archive.open(member) as file:
                header = file.read(BLOSC_HEADER.size)
            if fault := blosc_fault(header, self.archive.getinfo(member).file_size, chunk):
                raise ValueError(f"{name}: {fault}")
        return np.asarray(array[...])


def _variables(read: _Reader, group: str) -> list[str]:
    """The names of the arrays of a run that are variables."""
    names = [name for name in read.names(group) if name not in ("time_s", "logged")]
    if len(names) > MAX_VARIABLES:
        raise ValueError(f"a run has {len(names):,} variables")
    return names


def _variable(read: _Reader, name: str, mesh: Mesh, states: int) -> tuple[int, Variable]:
    about = read.about(name)
    values = read.array(name, "f4", 3)
    regions = tuple((int(number), int(count)) for number, count in about["regions"])
    if len(values) != states or sum(count for _, count in regions) != values.shape[1]:
        raise ValueError(f"{name} has other states or items")
    kind = (str(about["variable"]), about["where"], about["per"], about["kind"], str(about["units"]))
    variable = Variable(*kind, values, regions)
    if not fits(variable, mesh):
        raise ValueError(f"{name} does not fit the mesh")
    return int(about["number"]), variable


def _mesh(read: _Reader, group: str) -> Mesh:
    about = read.about(group)
    nodes, node_ids = read.array(f"{group}/nodes", "f4", 2), read.array(f"{group}/node_ids", "i4", 1)
    if nodes.shape != (node_ids.size, 3):
        raise ValueError("its nodes are not three numbers each")
    if not np.isfinite(nodes).all():
        raise ValueError("coordinates of nodes are not finite")

    def numbers(kind: str) -> range:
        count = int(about[f"{kind}s"])
        if count > MAX_REGIONS:
            raise ValueError(f"a mesh has {count:,} {kind.replace('_', ' ')}s")
        return range(count)

    def regions(kind: str) -> tuple[Region, ...]:
        found = []
        for number in numbers(kind):
            name = f"{group}/{kind}_{number}"
            table, own = read.array(name, "i4", 2), read.about(name)
            corners = table[:, 1:]
            if corners.size and (corners.min() < -1 or corners.max() >= len(nodes)):
                raise ValueError(f"{name} has nodes that the mesh lacks")
            shape, part = str(own["shape"]), int(own["part"])
            if kind == "domain" and (dict(SHAPES).get(shape) != corners.shape[1] or (corners < 0).any()):
                raise ValueError(f"{name} has elements of another shape than {shown(shape)}")
            if not 0 <= part <= MAX_PART:
                raise ValueError(f"{name} is of part {part}")
            found.append(Region(str(own["region"]), shape, part, table[:, 0], corners))
        return tuple(found)

    def sets(kind: str, below: float) -> dict[str, Array]:
        found = {}
        for number in numbers(kind):
            name = f"{group}/{kind}_{number}"
            items = read.array(name, "i4", 1)
            if items.size and not (items.min() >= 0 and items.max() < below):
                raise ValueError(f"{name} has nodes that the mesh lacks")
            if repeats(items):  # its fields would fill the memory, and count twice
                raise ValueError(f"{name} has an item twice")
            found[str(read.about(name)["set"])] = items
        return found

    parts = {int(number): str(name) for number, name in about["parts"].items()}
    node_sets, element_sets = sets("node_set", len(nodes)), sets("element_set", np.inf)
    where = regions("domain"), regions("surface"), regions("edge")
    return Mesh(node_ids, nodes, *where, node_sets, element_sets, parts)
