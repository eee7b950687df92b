"""The mesh in FEBio's plot file: nodes, domains of elements, surfaces, edges, and sets of nodes and elements."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sinew.runner.errors import shown
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.plot_chunks import chunks, damaged, integer, name_in, one_of_each, records

#: Shapes of elements in the order of the format, with their numbers of nodes.
SHAPES = (
    ("hex8", 8), ("penta6", 6), ("tet4", 4), ("quad4", 4), ("tri3", 3), ("line2", 2), ("hex20", 20), ("tet10", 10),
    ("tet15", 15), ("hex27", 27), ("tri6", 6), ("quad8", 8), ("quad9", 9), ("penta15", 15), ("tet20", 20),
    ("tri10", 10), ("pyra5", 5), ("tet5", 5), ("pyra13", 13), ("line3", 3),
)  # fmt: skip
MAX_REGIONS = 1_500  # of each kind: a model has a few, and each of those that are kept takes a millisecond to read
MAX_CORNERS = 27
MAX_PART = 2**31 - 1


@dataclass(frozen=True, eq=False)
class Region:
    """Elements of a domain, faces of a surface or lines of an edge: ``corners`` ``[item, corner]`` are positions of
    nodes in the mesh, -1 where an item has fewer corners; ``ids`` ``[item]`` are the solver's numbers of the items.
    """

    name: str
    shape: str
    part: int
    ids: Array
    corners: Array

    @cached_property
    def nodes(self) -> Array:
        """The nodes of the region by their position in the mesh, in the order in which the solver lists them."""
        return in_order_of_first(self.corners[self.corners >= 0])


@dataclass(frozen=True, eq=False)
class Mesh:
    """The mesh at rest: ``nodes`` ``[n, 3]`` float32 (units of the model) with the solver's numbers, and its regions.

    ``node_sets`` hold positions of nodes, ``element_sets`` the solver's numbers of elements, ``parts`` the names of the
    materials by number.
    """

    node_ids: Array
    nodes: Array
    domains: tuple[Region, ...] = ()
    surfaces: tuple[Region, ...] = ()
    edges: tuple[Region, ...] = ()
    node_sets: Mapping[str, Array] | None = None
    element_sets: Mapping[str, Array] | None = None
    parts: Mapping[int, str] | None = None


def in_order_of_first(numbers: Array) -> Array:
    """The different ``numbers`` ``[n]``, each where it comes first."""
    _, first = np.unique(numbers, return_index=True)
    return np.asarray(numbers[np.sort(first)])


def repeats(items: Array) -> bool:
    """Whether one of ``items`` ``[n]`` comes again. NumPy's ``unique`` takes several times the memory."""
    ordered = np.sort(items)
    return bool((ordered[1:] == ordered[:-1]).any())


def read_mesh(content: memoryview) -> Mesh:
    """The mesh. Raises :class:`Failed` for any damage."""
    parts = one_of_each(content, "the mesh")
    nothing = memoryview(b"")
    node_ids, nodes = _nodes(one_of_each(parts.get(0x01041000, nothing), "the nodes"))
    count = len(nodes)
    surfaces = _faces(parts.get(0x01043000, nothing), _SURFACE, count)
    return Mesh(
        node_ids,
        nodes,
        tuple(_domains(parts.get(0x01042000, nothing), count)),
        surfaces,
        _faces(parts.get(0x01048000, nothing), _EDGE, count),
        _sets(parts.get(0x01044000, nothing), _NODE_SET, count),
        _sets(parts.get(0x01046000, nothing), _ELEMENT_SET, None),
        _parts(parts.get(0x01045000, nothing)),
    )


def _nodes(parts: dict[int, memoryview]) -> tuple[Array, Array]:
    header = one_of_each(parts.get(0x01041100, memoryview(b"")), "the header of the nodes")
    count, dim = integer(header, 0x01041101, "the number of nodes"), integer(header, 0x01041102, "the dimension", 3)
    content = parts.get(0x01041200, memoryview(b""))
    if dim != 3 or not count or len(content) != 16 * count:
        raise damaged(f"{count:,} nodes of {dim} coordinates in {len(content):,} bytes")
    ids = np.frombuffer(content, "<i4").reshape(count, 4)[:, 0].copy()
    nodes = np.frombuffer(content, "<f4").reshape(count, 4)[:, 1:].copy()
    if not np.isfinite(nodes).all():
        raise damaged("coordinates of nodes are not finite")
    return ids, nodes


def _domains(content: memoryview, nodes: int) -> Iterator[Region]:
    for number, (_, inside) in enumerate(chunks(content, "the domains"), 1):
        if number > MAX_REGIONS:
            raise damaged(f"more than {MAX_REGIONS:,} domains")
        parts = one_of_each(inside, "a domain")
        header = one_of_each(parts.get(0x01042101, memoryview(b"")), "the header of a domain")
        kind = integer(header, 0x01042102, "the shape of a domain's elements")
        if kind >= len(SHAPES):
            raise damaged(f"elements of shape {kind}")
        shape, corners = SHAPES[kind]
        name = name_in(header[0x01032105], "a domain's name", counted=True) if 0x01032105 in header else ""
        table = records(parts.get(0x01042200, memoryview(b"")), 0x01042201, corners + 1, "a domain")
        claimed = integer(header, 0x01032104, "the number of a domain's elements")
        if claimed != len(table):
            raise damaged(f"a domain has {len(table):,} elements and claims {claimed:,}")
        part = integer(header, 0x01042103, "the part of a domain")
        if part > MAX_PART:
            raise damaged(f"a domain of part {part}")
        _known(table[:, 1:], nodes)
        yield Region(name, shape, part, table[:, 0].copy(), table[:, 1:].copy())


def _known(corners: Array, nodes: int) -> None:
    if corners.size and (corners.min() < 0 or corners.max() >= nodes):
        raise damaged("elements or faces have nodes that the mesh lacks")


#: Tags of a kind of region: its header, number of items, name, corners of an item, list, and one item of the list.
_SURFACE = (0x01043101, 0x01043103, 0x01043104, 0x01043105, 0x01043200, 0x01043201)
_EDGE = (0x01048102, 0x01048103, 0x01048104, 0x01048105, 0x01048200, 0x01048201)


def _faces(content: memoryview, tags: tuple[int, ...], nodes: int) -> tuple[Region, ...]:
    head, count_tag, name_tag, corners_tag, list_tag, each = tags
    found: list[Region] = []
    for _, inside in chunks(content, "the surfaces"):
        parts = one_of_each(inside, "a surface")
        # an edge's header has the tag of its own number inside
        header = one_of_each(parts.get(head, parts.get(head - 1, memoryview(b""))), "the header of a surface")
        corners = integer(header, corners_tag, "the corners of a face")
        if corners > MAX_CORNERS or len(found) >= MAX_REGIONS:
            raise damaged(f"faces of {corners} corners, or too many surfaces")
        table = records(parts.get(list_tag, memoryview(b"")), each, corners + 2, "a surface")
        claimed = integer(header, count_tag, "the number of faces")
        own = table[:, 1]
        if claimed != len(table) or (own.size and not (own.min() >= 0 and own.max() <= corners)):
            raise damaged(f"a surface has {len(table):,} faces and claims {claimed:,}, or one has too many corners")
        there = np.arange(corners) < own[:, np.newaxis]
        name = name_in(header[name_tag], "a surface's name", counted=True) if name_tag in header else ""
        filled = np.where(there, table[:, 2:], 0)
        _known(filled, nodes)
        filled[~there] = -1
        found.append(Region(name, "", 0, table[:, 0].copy(), filled))
    return tuple(found)


#: Tags of a kind of set: its header, name, size, and list.
_NODE_SET = (0x01044101, 0x01044103, 0x01044104, 0x01044200)
_ELEMENT_SET = (0x01046101, 0x01046103, 0x01046104, 0x01046200)


def _sets(content: memoryview, tags: tuple[int, ...], below: int | None) -> dict[str, Array]:
    head, name_tag, size_tag, list_tag = tags
    found: dict[str, Array] = {}
    for number, (_, inside) in enumerate(chunks(content, "the sets")):
        parts = one_of_each(inside, "a set")
        header = one_of_each(parts.get(head, memoryview(b"")), "the header of a set")
        name = name_in(header.get(name_tag, memoryview(b"")), "the name of a set", counted=True)
        size, inside = integer(header, size_tag, "the size of a set"), parts.get(list_tag, memoryview(b""))
        if len(inside) != 4 * size or number >= MAX_REGIONS:
            raise damaged(f"set {shown(name)} has {len(inside):,} bytes for {size:,} items")
        items = np.frombuffer(inside, "<i4").copy()
        if size and (items.min() < 0 or (below is not None and items.max() >= below)):
            raise damaged(f"set {shown(name)} has nodes that the mesh lacks")
        if repeats(items):  # its fields would fill the memory, and count twice
            raise damaged(f"set {shown(name)} has an item twice")
        found.setdefault(name, items)
    return found


def _parts(content: memoryview) -> dict[int, str]:
    found = {}
    for number, (_, inside) in enumerate(chunks(content, "the parts"), 1):
        if number > MAX_REGIONS:
            raise damaged(f"more than {MAX_REGIONS:,} parts")
        parts = one_of_each(inside, "a part")
        name = name_in(parts.get(0x01045102, memoryview(b"")), "the name of a part", counted=False)
        found[integer(parts, 0x01045101, "the number of a part")] = name
    return found
