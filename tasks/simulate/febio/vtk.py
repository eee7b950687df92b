"""Fields as VTK files: an unstructured grid (.vtu) for each state, and a list of them with their times (.pvd).

Written here, as the format is a page of XML around arrays; the libraries that write it (vtk, pyvista, meshio) bring
hundreds of megabytes, or read more formats than are safe. ParaView, PyVista and meshio open these files.
Source: VTK file formats, docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html.
"""

import base64
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from sinew.runner.errors import BadInput
from sinew.runner.store.durable import write_whole
from sinew.tasks.simulate import Array
from sinew.tasks.simulate.febio.plot_file import PlotFile, Variable
from sinew.tasks.simulate.febio.plot_mesh import Region

#: VTK's type of cell for each shape, and how many of its nodes VTK takes: it has no cell with the others.
_CELLS = {
    "hex8": (12, 8), "penta6": (13, 6), "tet4": (10, 4), "quad4": (9, 4), "tri3": (5, 3), "line2": (3, 2),
    "hex20": (25, 20), "tet10": (24, 10), "tet15": (24, 10), "hex27": (25, 20), "tri6": (22, 6), "quad8": (23, 8),
    "quad9": (28, 9), "penta15": (26, 15), "tet20": (10, 4), "tri10": (5, 3), "pyra5": (14, 5), "tet5": (10, 4),
    "pyra13": (27, 13), "line3": (21, 3),
}  # fmt: skip
_TYPES = {"f4": "Float32", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
MAX_STATES = 20_000
MAX_NUMBERS = 2**24  # of the mesh, and of a field in a state: each takes some thirty bytes while it is written
MAX_ALL = 2**30  # numbers in all files
_FULL = (0, 3, 5, 3, 1, 4, 5, 4, 2)  # xx, yy, zz, xy, yz, xz as a matrix by rows


def write_vtk(path: Path, plot: PlotFile) -> list[str]:
    """Write ``path``, which ends in .pvd, and a folder of states beside it. Points are those at rest.

    Returns the names of variables that VTK's files have no place for: those of surfaces, edges, the whole model, and of
    nodes by domain. Raises :class:`BadInput` for more states than a folder should hold files, and ``OSError``.
    """
    if plot.time_s.size > MAX_STATES:
        raise BadInput(path, f"its fields have {plot.time_s.size:,} states", f"at most {MAX_STATES:,}, a file for each")
    cells = sum(len(region.corners) for region in plot.mesh.domains)
    width = max((variable.values.shape[2] for variable in plot.variables.values()), default=1)
    numbers = 3 * len(plot.mesh.nodes) + sum(region.corners.size for region in plot.mesh.domains)
    if max(numbers, cells * width, len(plot.mesh.nodes) * width) > MAX_NUMBERS:
        raise BadInput(path, "its mesh or a field of it is too large", f"at most {MAX_NUMBERS:,} numbers")
    of_a_state = numbers + len(plot.mesh.nodes) + 2 * cells
    of_a_state += sum(variable.values[0].size for variable in plot.variables.values()) if plot.time_s.size else 0
    if plot.time_s.size * of_a_state > MAX_ALL:
        problem = f"its {plot.time_s.size:,} states would have {of_a_state:,} numbers each"
        raise BadInput(path, problem, f"at most {MAX_ALL:,} numbers in all")
    folder = path.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    frame = _frame(plot)
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        "<Collection>",
    ]
    for state, time in enumerate(plot.time_s):
        name = f"state_{state:05d}.vtu"
        _write(folder / name, _with_data(plot, frame, state))
        lines.append(f'<DataSet timestep="{float(time)!r}" file={quoteattr(f"{folder.name}/{name}")}/>')
    _write(path, "\n".join([*lines, "</Collection>", "</VTKFile>", ""]))
    return [name for name, variable in plot.variables.items() if not has_place(variable)]


def _write(path: Path, text: str) -> None:
    write_whole(path, path.with_name(f".{path.name}.partial"), text.encode())


def has_place(variable: Variable) -> bool:
    """Whether VTK has a place for it: it is of nodes, or of elements."""
    return variable.where == "node" or (variable.where == "domain" and variable.per != "node")


def _grid(plot: PlotFile) -> Iterator[str]:
    """Points and cells, which are those of all states."""
    corners = [(region, *_CELLS.get(region.shape, (0, 0))) for region in plot.mesh.domains]
    joined = [region.corners[:, :count].ravel() for region, _, count in corners]
    sizes = np.concatenate([np.zeros(0, np.int64), *(np.full(len(r.corners), count) for r, _, count in corners)])
    types = np.concatenate([np.zeros(0, np.uint8), *(np.full(len(r.corners), kind) for r, kind, _ in corners)])
    yield f"<Points>\n{_array('points', plot.mesh.nodes)}</Points>\n<Cells>\n"
    yield _array("connectivity", np.concatenate([np.zeros(0, np.int64), *joined]).astype("i8"))
    yield _array("offsets", np.cumsum(sizes).astype("i8"))
    yield _array("types", types.astype("u1"))
    yield "</Cells>\n"


@dataclass(frozen=True)
class _Frame:
    """What is the same in the files of all states: points and cells, and the numbers of nodes, elements and parts."""

    grid: str
    of_points: str
    of_cells: str


def _frame(plot: PlotFile) -> _Frame:
    nothing, domains = np.zeros(0, np.int32), plot.mesh.domains
    elements = np.concatenate([nothing, *(one.ids for one in domains)])
    parts = np.concatenate([nothing, *(np.full(len(one.ids), one.part, np.int32) for one in domains)])
    of_cells = _array("element_id", elements) + _array("part", parts)
    return _Frame("".join(_grid(plot)), _array("node_id", plot.mesh.node_ids), of_cells)


def _with_data(plot: PlotFile, frame: _Frame, state: int) -> str:
    """The file of a state."""
    mesh = plot.mesh
    cells = sum(len(region.corners) for region in mesh.domains)
    points, inside = [frame.of_points], [frame.of_cells]
    for name, variable in plot.variables.items():
        if variable.where == "node":
            points.append(_array(name, _as_vtk(variable, variable.values[state])))
        elif has_place(variable):
            inside.append(_array(name, _as_vtk(variable, by_cell(variable, mesh.domains, cells, state))))
    return (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(mesh.nodes)}" NumberOfCells="{cells}">\n{frame.grid}'
        f"<PointData>\n{''.join(points)}</PointData>\n<CellData>\n{''.join(inside)}</CellData>\n"
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    )


def by_cell(variable: Variable, domains: tuple[Region, ...], cells: int, state: int) -> Array:
    """The values ``[cell, component]`` of a variable of domains: NaN where it has none, the mean of an element's
    corners, and that of a domain for each of its elements.
    """
    found = np.full((cells, variable.values.shape[2]), np.nan, np.float32)
    first = np.cumsum([0, *(len(region.corners) for region in domains)])
    start = 0
    for number, count in variable.regions:
        values = variable.values[state, start : start + count]
        elements = len(domains[number].corners)
        if variable.per == "corner" and elements:
            values = values.reshape(elements, -1, values.shape[1]).mean(axis=1)
        found[first[number] : first[number] + elements] = values
        start += count
    return found


def _as_vtk(variable: Variable, values: Array) -> Array:
    """Symmetric tensors have nine components in VTK."""
    return values[:, _FULL] if variable.kind == "mat3fs" else values


def _array(name: str, values: Array) -> str:
    little = values.astype(values.dtype.newbyteorder("<"))
    raw = little.tobytes()
    packed = zlib.compress(raw, 6)
    head = struct.pack("<4Q", 1, len(raw), 0, len(packed)) if raw else struct.pack("<Q", 0)
    content = base64.b64encode(head).decode() + base64.b64encode(packed if raw else b"").decode()
    width = values.shape[1] if values.ndim == 2 else 1
    kind = _TYPES[values.dtype.newbyteorder("=").str[1:]]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" format="binary">'
        f"{content}</DataArray>\n"
    )
