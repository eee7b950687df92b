"""Fields as VTK files, read again by what the format says of itself."""

import base64
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.febio import vtk
from sinew.tasks.simulate.febio.plot_file import plot_file_of
from sinew.tasks.simulate.febio.vtk import write_vtk
from tests.tasks.simulate.febio import plot_writer as w

DTYPES = {"Float32": "<f4", "Int32": "<i4", "Int64": "<i8", "UInt8": "u1"}


def arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a .vtu file by name: blocks of zlib behind a header of 64-bit sizes, both in base64."""
    root = ElementTree.parse(path).getroot()
    assert root.get("header_type") == "UInt64"
    assert root.get("compressor") == "vtkZLibDataCompressor"
    found = {}
    for one in root.iter("DataArray"):
        raw = base64.b64decode(one.text[:44])
        blocks, size, last, packed = struct.unpack("<4Q", raw)
        assert (blocks, last) == (1, 0)
        content = zlib.decompress(base64.b64decode(one.text[44:])[:packed])
        assert len(content) == size
        width = int(one.get("NumberOfComponents"))
        found[one.get("Name")] = np.frombuffer(content, DTYPES[one.get("type")]).reshape(-1, width)
    (piece,) = root.iter("Piece")
    for part, count in (("PointData", "NumberOfPoints"), ("CellData", "NumberOfCells")):
        for one in root.iter(part):
            assert all(len(found[each.get("Name")]) == int(piece.get(count)) for each in one)
    return found


def test_points_cells_and_variables(tmp_path):
    plot = plot_file_of(w.plot_file(), 2**20)
    left_out = write_vtk(tmp_path / "row.pvd", plot)
    assert left_out == ["energy", "a", "gap", "pull", "pressure"]
    listed = list(ElementTree.parse(tmp_path / "row.pvd").getroot().iter("DataSet"))
    assert [float(one.get("timestep")) for one in listed] == list(w.TIMES)
    states = [arrays(tmp_path / one.get("file")) for one in listed]
    last = states[2]
    assert np.array_equal(last["points"], w.GRID)
    assert last["types"].ravel().tolist() == [12, 12, 10]
    assert last["offsets"].ravel().tolist() == [8, 16, 20]
    assert last["connectivity"].ravel().tolist() == [node for cell in (*w.HEXES, *w.TETS) for node in cell]
    assert last["element_id"].ravel().tolist() == [1, 2, 3]
    assert np.array_equal(last["displacement"].ravel(), w.numbers(2.0, "displacement", 36))
    xx, yy, zz, xy, yz, xz = w.numbers(2.0, "stress", 12)[6:]
    assert last["stress"][1].tolist() == [xx, xy, xz, xy, yy, yz, xz, yz, zz]
    assert np.isnan(states[0]["stress"]).all()
    corners = w.numbers(2.0, "density", 16).reshape(2, 8)
    assert np.array_equal(last["density"].ravel()[:2], corners.mean(1))
    assert np.isnan(last["density"][2, 0])
    volume = w.numbers(2.0, "volume", 1)[0]
    assert last["volume"].ravel().tolist() == [volume] * 3


def test_names_are_quoted(tmp_path):
    content = w.plot_file()
    odd = 'a"<&>'
    content = content.replace(w.padded(0x01020004, "density"), w.padded(0x01020004, odd))
    write_vtk(tmp_path / "row.pvd", plot_file_of(content, 2**20))
    assert odd in arrays(tmp_path / "row" / "state_00001.vtu")


@pytest.mark.parametrize("compressed", [False, True])
def test_equal_runs_are_equal_bytes(tmp_path, compressed):
    for name in ("one", "two"):
        write_vtk(tmp_path / name / "row.pvd", plot_file_of(w.plot_file(compressed=compressed), 2**20))
    one, two = (sorted((tmp_path / name).rglob("*.*")) for name in ("one", "two"))
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_states_without_end_become_no_files(tmp_path, monkeypatch):
    monkeypatch.setattr(vtk, "MAX_STATES", 2)
    plot = plot_file_of(w.plot_file(compressed=True), 2**20)
    many = replace(plot, time_s=np.arange(3.0))
    with pytest.raises(BadInput, match="its fields have 3 states; expected at most 2, a file for each"):
        write_vtk(tmp_path / "row.pvd", many)
    assert not list(tmp_path.iterdir())


def test_fields_that_would_fill_the_memory_become_no_files(tmp_path, monkeypatch):
    plot = plot_file_of(w.plot_file(compressed=True), 2**20)
    monkeypatch.setattr(vtk, "MAX_NUMBERS", 3)
    with pytest.raises(BadInput, match="its mesh or a field of it is too large; expected at most 3 numbers"):
        write_vtk(tmp_path / "row.pvd", plot)
    assert not list(tmp_path.iterdir())


def test_states_times_mesh_are_limited(tmp_path, monkeypatch):
    plot = plot_file_of(w.plot_file(compressed=True), 2**20)
    monkeypatch.setattr(vtk, "MAX_ALL", 700)
    with pytest.raises(BadInput, match=r"its 3 states would have 2\d\d numbers each; expected at most 700 numbers"):
        write_vtk(tmp_path / "row.pvd", plot)
    assert not list(tmp_path.iterdir())


def test_a_domain_without_elements_has_no_cells(tmp_path):
    """Its variables of corners have no numbers."""
    plot = plot_file_of(w.plot_file(), 2**20)
    block, tets = plot.mesh.domains
    none = replace(block, ids=block.ids[:0], corners=block.corners[:0])
    density = replace(plot.variables["density"], values=np.zeros((3, 0, 1), np.float32), regions=((0, 0),))
    few = replace(plot, mesh=replace(plot.mesh, domains=(none, tets)), variables={"density": density})
    write_vtk(tmp_path / "row.pvd", few)
    found = arrays(tmp_path / "row" / "state_00001.vtu")
    assert found["element_id"].ravel().tolist() == [3]
    assert np.isnan(found["density"]).all()
