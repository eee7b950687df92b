"""FEBio's plot file (.xplt): the mesh, and the variables that the solver wrote for each of its states.

Read as FEBio 3 and 4 write it (versions 3.0 to 3.5 of the format), compressed or not. Numbers are float32 there and
stay so. The file is untrusted, see :mod:`sinew.tasks.simulate.febio.plot_chunks`; besides, no more than ``max_bytes``
are decompressed, and the arrays that are made have no more together. That is why no library reads it: febio-python
decompresses without a limit, and pyfebio reads no compressed files.
"""

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from sinew.runner.errors import shown
from sinew.runner.files import NotReadable, read_regular
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio import plot_chunks
from sinew.tasks.simulate.febio.plot_chunks import chunks, damaged, integer, name_in, one_of_each
from sinew.tasks.simulate.febio.plot_mesh import Mesh, Region, read_mesh

Where = Literal["global", "node", "domain", "surface", "edge"]
Per = Literal["node", "item", "corner", "region"]
Kind = Literal["float", "vec3f", "mat3fs", "mat3fd", "tens4fs", "mat3f", "array", "array_vec3f"]
_Place = tuple[Where, int]  # a variable: where it is, and its number there

_WHERE: dict[int, Where] = {0x01021000: "global", 0x01023000: "node", 0x01024000: "domain", 0x01025000: "surface",
                            0x01026000: "edge"}  # fmt: skip
_DATA: dict[int, Where] = {0x02020100: "global", 0x02020300: "node", 0x02020400: "domain", 0x02020500: "surface",
                           0x02020600: "edge"}  # fmt: skip
_PER: tuple[Per, ...] = ("node", "item", "corner", "region")
KINDS: tuple[Kind, ...] = ("float", "vec3f", "mat3fs", "mat3fd", "tens4fs", "mat3f", "array", "array_vec3f")
_SIZES = {"float": 1, "vec3f": 3, "mat3fs": 6, "mat3fd": 3, "tens4fs": 21, "mat3f": 9}
COMPONENTS: dict[str, tuple[str, ...]] = {
    "float": ("",),
    "vec3f": ("x", "y", "z"),
    "mat3fs": ("xx", "yy", "zz", "xy", "yz", "xz"),
    "mat3fd": ("1", "2", "3"),
    "mat3f": ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"),
}
MAX_VARIABLES, MAX_ARRAY, MAX_STATES = 1000, 4096, 100_000
MAX_BYTES = 2**28  # of a file, of its states, and of the arrays that are made of them: what can be kept and read again
MAX_REGIONS = 2**22  # of all variables in all states, each of which is looked at


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable: ``values`` ``[state, item, component]`` float32, in the units of the model.

    The items are those of ``regions`` one after the other: ``(position of the region in the mesh, its items)``. ``per``
    says what an item is: a node, an item (element, face, line), a corner of one, or a whole region. Nodes of a domain
    or surface are its own, by their position in the mesh.
    """

    name: str
    where: Where
    per: Per
    kind: Kind
    unit: str
    values: Array
    regions: tuple[tuple[int, int], ...]

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the components, such as ``x``; those of arrays are numbers from 1."""
        return COMPONENTS.get(self.kind) or tuple(str(1 + number) for number in range(self.values.shape[2]))


@dataclass(frozen=True, eq=False)
class PlotFile:
    """A plot file: the times of its states ``[state]`` (s, increasing), its mesh at rest, and its variables by name."""

    time_s: Array
    mesh: Mesh
    variables: Mapping[str, Variable]


@dataclass(frozen=True)
class _Entry:
    """A variable as the dictionary of the file announces it."""

    name: str
    where: Where
    per: Per
    kind: Kind
    unit: str
    width: int


def read_plot_file(path: Path, max_bytes: int) -> PlotFile:
    """Read a plot file of at most ``max_bytes`` and 256 MiB. Raises :class:`Failed` for any damage."""
    max_bytes = min(max_bytes, MAX_BYTES)
    try:
        content = read_regular(path, max_bytes)
    except FileNotFoundError:
        raise damaged(f"the solver wrote no {path.name}") from None
    except NotReadable as odd:
        raise damaged(f"{path.name} is {odd}") from None
    except OSError as error:
        raise damaged(f"{path.name} cannot be read ({error.strerror})") from None
    return plot_file_of(content, max_bytes)


def plot_file_of(content: bytes, max_bytes: int) -> PlotFile:
    """The plot file with this content. Raises :class:`Failed` for any damage."""
    if content[:4] != plot_chunks.MAGIC:
        raise damaged("it does not begin as FEBio's plot files do")
    view = memoryview(content)
    root, rest = _top(view[4:], plot_chunks.ROOT, "header and dictionary")
    parts = one_of_each(root, "the root")
    header = one_of_each(parts.get(plot_chunks.HEADER, memoryview(b"")), "the header")
    version = integer(header, 0x01010001, "the version")
    if not 0x0030 <= version <= 0x003F:
        raise damaged(f"version {version >> 4}.{version & 15}; versions 3.x are read")
    entries = _dictionary(parts.get(plot_chunks.DICTIONARY, memoryview(b"")))
    mesh_part, rest = _top(rest, plot_chunks.MESH, "the mesh")
    mesh = read_mesh(mesh_part)
    return _with_states(entries, mesh, rest, max_bytes - len(mesh_part))


def _top(content: memoryview, tag: int, what: str) -> tuple[memoryview, memoryview]:
    """The content of the first chunk, and what follows it."""
    if len(content) < 8 or int.from_bytes(content[:4], "little") != tag:
        raise damaged(f"{what} is missing")
    size = int.from_bytes(content[4:8], "little")
    if size > len(content) - 8:
        raise damaged(f"{what} is cut short")
    return content[8 : 8 + size], content[8 + size :]


def _dictionary(content: memoryview) -> list[_Entry]:
    """The variables, in the order of the file within each part of it."""
    found: list[_Entry] = []
    for tag, inside in one_of_each(content, "the dictionary").items():
        if tag not in _WHERE:
            raise damaged(f"the dictionary has a part {tag:#010x}")
        for _, item in chunks(inside, "the dictionary"):
            found.append(_entry(_WHERE[tag], item))
            if len(found) > MAX_VARIABLES:
                raise damaged(f"more than {MAX_VARIABLES} variables")
    names = [(entry.where, entry.name) for entry in found]
    if len(set(names)) < len(names):
        raise damaged("a variable is there twice")
    return found


def _entry(where: Where, content: memoryview) -> _Entry:
    parts = one_of_each(content, "a variable", again=MAX_ARRAY)  # names of an array's parts repeat
    kind, per = integer(parts, 0x01020002, "a variable's type"), integer(parts, 0x01020003, "a variable's format")
    size = integer(parts, 0x01020005, "an array's size", 0)
    name = name_in(parts.get(0x01020004, memoryview(b"")), "a variable's name", counted=False)
    unit = name_in(parts.get(0x01020007, memoryview(b"")), "a variable's unit", counted=False)
    if not name or kind >= len(KINDS) or per >= len(_PER):
        raise damaged(f"variable {shown(name)} has type {kind} and format {per}, which are not read")
    width = _SIZES.get(KINDS[kind], size * (3 if KINDS[kind] == "array_vec3f" else 1))
    if not 0 < width <= MAX_ARRAY:
        raise damaged(f"variable {shown(name)} has {width} components")
    return _Entry(name, where, _PER[per], KINDS[kind], unit, width)


@dataclass(frozen=True)
class _Course:
    """What the states hold of a variable, one after the other: its ``numbers``, and of which ``regions`` these are.

    ``states``: how many regions each of them has. ``items``: of each region. All is flat: with an object for each
    region of each state, a file of many empty regions would take far more memory than it has bytes.
    """

    entry: _Entry
    items: dict[int, int] = field(default_factory=dict)
    states: "array[int]" = field(default_factory=lambda: array("I"))
    regions: "array[int]" = field(default_factory=lambda: array("I"))
    numbers: bytearray = field(default_factory=bytearray)


def _with_states(entries: list[_Entry], mesh: Mesh, rest: memoryview, max_bytes: int) -> PlotFile:
    at, courses, first = _courses(entries, mesh, rest, max_bytes)
    if not (np.isfinite(at).all() and (np.diff(at) >= 0).all()):
        raise damaged("its times do not increase")
    rows = np.cumsum(np.diff(at, prepend=np.nan) != 0) - 1  # of times that are equal as float32, the last state counts
    variables, left = {}, max_bytes
    for place in list(courses):
        course = courses.pop(place)  # the memory of its numbers is needed for the next
        variable = _variable(course, rows[first.get(place, 0) :], int(rows[-1]) + 1 if rows.size else 0, left)
        left -= variable.values.nbytes
        name = variable.name if variable.name not in variables else f"{variable.name} ({variable.where})"
        variables[name] = variable
    return PlotFile(np.unique(at), mesh, variables)


def _courses(
    entries: list[_Entry], mesh: Mesh, rest: memoryview, max_bytes: int
) -> tuple[Array, dict[_Place, _Course], dict[_Place, int]]:
    """The times of all states, what they hold of each variable, and the state in which it comes first.

    No later state may lack it.
    """
    times: list[float] = []
    regions = 0
    courses = {
        (where, number): _Course(entry)
        for where in _WHERE.values()
        for number, entry in enumerate((each for each in entries if each.where == where), 1)
    }
    first: dict[_Place, int] = {}
    for state in plot_chunks.states(rest, max_bytes):
        parts = one_of_each(state, "a state")
        if len(times) == MAX_STATES:
            raise damaged(f"more than {MAX_STATES:,} states")
        times.append(_time(parts))
        seen = 0
        for place, content in _state_data(parts.get(0x02020000, memoryview(b""))):
            if place not in courses:
                raise damaged("a state has variables that the dictionary lacks")
            course, seen = courses[place], seen + 1
            if first.setdefault(place, len(times) - 1) + len(course.states) == len(times):
                seen = -1
                break
            regions += max(1, _append(course, mesh, content))  # one without any is looked at, too
            if regions > MAX_REGIONS:
                raise damaged(f"its states have more than {MAX_REGIONS:,} regions")
        if seen != len(first):
            raise damaged(f"the state at {times[-1]:g} s does not hold each variable once")
    return np.array(times), courses, first


def _time(parts: dict[int, memoryview]) -> float:
    header = one_of_each(parts.get(0x02010000, memoryview(b"")), "a state's header")
    if len(header.get(0x02010002, b"")) != 4:
        raise damaged("a state has no time")
    return float(np.frombuffer(header[0x02010002], "<f4")[0])


def _state_data(content: memoryview) -> Iterator[tuple[_Place, memoryview]]:
    """Of each variable of a state: where it is, its number there, and what the state has of it by region."""
    for tag, inside in one_of_each(content, "a state's data").items():
        if tag not in _DATA:
            raise damaged(f"a state's data has a part {tag:#010x}")
        for _, each in chunks(inside, "a state's data"):
            parts = one_of_each(each, "a variable of a state")
            number = integer(parts, 0x02020002, "a variable's number")
            yield (_DATA[tag], number), parts.get(0x02020003, memoryview(b""))


def _append(course: _Course, mesh: Mesh, content: memoryview) -> int:
    """Add what one state has of a variable, region by region; returns how many these are."""
    entry, seen = course.entry, set[int]()
    for region, numbers in chunks(content, "a variable's data"):
        if region not in course.items:
            course.items[region] = _items_of(entry, region, mesh)
        expected = course.items[region] * entry.width
        if region in seen:
            raise damaged(f"variable {shown(entry.name)} has region {region} twice")
        if len(numbers) != 4 * expected:
            problem = f"{len(numbers) / 4:,g} numbers, not {expected:,}"
            raise damaged(f"variable {shown(entry.name)} has {problem}, in region {region}")
        seen.add(region)
        course.regions.append(region)
        course.numbers.extend(numbers)
    course.states.append(len(seen))
    return len(seen)


def _items_of(entry: _Entry, number: int, mesh: Mesh) -> int:
    """How many items a variable has in the region of this number in the file."""
    regions = _regions(entry.where, mesh)
    position = number - _first(entry.where)
    if not 0 <= position < len(regions):
        raise damaged(f"variable {shown(entry.name)} is for region {number}, which the mesh lacks")
    return _items(entry, regions[position], mesh)


def _first(where: Where) -> int:
    """The number of the first region; the whole mesh is region 0."""
    return 0 if where in ("global", "node") else 1


def _variable(course: _Course, rows: Array, states: int, left: int) -> Variable:
    """The variable of all ``states``; ``rows``: which of them each entry of the course is. NaN where there is none."""
    entry, there = course.entry, sorted(course.items)
    total = sum(course.items.values())
    if 4 * states * total * entry.width > left:
        raise damaged("its variables have too many numbers")
    starts = dict(zip(there, np.cumsum([0, *(course.items[number] for number in there)]).tolist(), strict=False))
    values = np.full((states, total, entry.width), np.nan, np.float32)
    numbers, at, region = np.frombuffer(course.numbers, "<f4"), 0, 0
    filled = -1
    for count, row in zip(course.states, rows, strict=True):
        if row == filled:
            values[row] = np.nan  # of a former state at this time
        filled = row if count else -1
        for number in course.regions[region : region + count]:
            items = course.items[number]
            size = items * entry.width
            values[row, starts[number] : starts[number] + items] = numbers[at : at + size].reshape(items, entry.width)
            at += size
        region += count
    regions = tuple((number - _first(entry.where), course.items[number]) for number in there)
    return Variable(entry.name, entry.where, entry.per, entry.kind, entry.unit, values, regions)


def fits(variable: Variable, mesh: Mesh) -> bool:
    """Whether a variable that was not read here has a known place, format and type, and the items of the mesh."""
    known = variable.where in (*_WHERE.values(), "edge") and variable.per in _PER and variable.kind in KINDS
    if not known or not (variable.name.isprintable() and variable.unit.isprintable()):
        return False
    regions = _regions(variable.where, mesh)
    width = variable.values.shape[2]
    return _SIZES.get(variable.kind, width) == width and all(
        0 <= number < len(regions) and count == _items(variable, regions[number], mesh)
        for number, count in variable.regions
    )


def _regions(where: Where, mesh: Mesh) -> tuple[Region | None, ...]:
    if where in ("global", "node"):
        return (None,)
    return {"domain": mesh.domains, "surface": mesh.surfaces, "edge": mesh.edges}[where]


def _items(entry: _Entry | Variable, region: Region | None, mesh: Mesh) -> int:
    """How many items a variable has in a region; None stands for the whole mesh."""
    if region is None:
        return len(mesh.node_ids) if entry.where == "node" else 1
    if entry.per == "corner":
        return region.corners.size
    if entry.per == "node":
        return region.nodes.size
    return len(region.corners) if entry.per == "item" else 1
