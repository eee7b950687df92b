"""How a new table is laid out in Zarr: what a person or program finds who opens it without sinew."""

import json

import numpy as np
import pytest
import zarr

from sinew.runner.store.arrays import create_table
from sinew.runner.store.schema import STATUSES, Coordinate, Field, TableSpec

SPEC = TableSpec(
    title="specimen 1",
    identity={"b": 2, "a": "µ"},
    parameters=("E_f", "E_m"),
    units=("MPa", "kPa"),
    fields=(Field("objective", ("protocol",), "N", "distance"), Field("force", ("time",), "mN", "the force")),
    coordinates=(
        Coordinate("protocol", "protocol", np.array(["pull", "hold"], dtype=object)),
        Coordinate("time", "time", np.array([0.0, 0.5, 1.0]), "s"),
        Coordinate("displacement", "time", np.array([0.0, 1.0, 2.0]), "mm"),
    ),
)


@pytest.fixture
def group(tmp_path):
    root = zarr.open_group(tmp_path / "store.zarr", mode="w")
    create_table(root, "one", SPEC)
    return zarr.open_group(tmp_path / "store.zarr", mode="r")["one"]


def test_what_a_table_says_of_itself(group):
    assert dict(group.attrs) == {
        "title": "specimen 1",
        "key": SPEC.key,
        "identity": json.dumps({"a": "µ", "b": 2}),
        "fields": ["objective", "force"],
        "coordinates": "parameter_unit displacement",
        "chunk_rows": SPEC.chunk_rows,
        "complete": True,
    }


@pytest.mark.parametrize(
    ("name", "dims", "shape", "kind", "attributes"),
    [
        ("parameters", ("row", "parameter"), (0, 2), "<f8", {"long_name": "parameters"}),
        ("objective", ("row", "protocol"), (0, 2), "<f8", {"units": "N", "long_name": "distance"}),
        ("force", ("row", "time"), (0, 3), "<f8", {"units": "mN", "long_name": "the force"}),
        ("attempts", ("row",), (0,), "<i2", {"long_name": "how often the row was tried"}),
        ("wall_seconds", ("row",), (0,), "<f8", {"units": "s", "long_name": "time of its evaluation"}),
        (
            "status",
            ("row",),
            (0,),
            "|i1",
            {"flag_values": [-1, *range(len(STATUSES))], "flag_meanings": " ".join(("pending", *STATUSES))},
        ),
    ],
)
def test_rows_have_named_dimensions_and_units(group, name, dims, shape, kind, attributes):
    array = group[name]
    assert (array.metadata.dimension_names, array.shape, array.dtype.str) == (dims, shape, kind)
    assert array.chunks == (SPEC.chunk_rows, *shape[1:])
    assert dict(array.attrs) == attributes
    assert np.isnan(array.fill_value) if kind == "<f8" else array.fill_value == {"attempts": 0, "status": -1}[name]


def test_numbers_are_compressed_fast_and_have_a_checksum(group):
    blosc, checksum = group["force"].compressors
    settings = blosc.to_dict()["configuration"]
    assert (settings["cname"], settings["clevel"], settings["shuffle"]) == ("lz4", 1, "noshuffle")
    assert checksum.to_dict()["name"] == "crc32c"


def test_texts_of_rows_are_empty_at_first(group):
    for name in ("worker", "message"):
        assert group[name].metadata.dimension_names == ("row",)
        assert group[name].fill_value == ""
        assert group[name].chunks == (SPEC.chunk_rows,)


def test_coordinates_are_there_with_their_units(group):
    assert group["parameter"][:].tolist() == ["E_f", "E_m"]
    assert group["parameter_unit"][:].tolist() == ["MPa", "kPa"]
    assert group["protocol"][:].tolist() == ["pull", "hold"]
    assert group["protocol"].metadata.dimension_names == ("protocol",)
    assert dict(group["protocol"].attrs) == {}
    assert group["displacement"][:].tolist() == [0.0, 1.0, 2.0]
    assert group["displacement"].metadata.dimension_names == ("time",)
    assert dict(group["displacement"].attrs) == {"units": "mm"}
    assert group["displacement"].chunks == (3,)
    assert np.isnan(group["time"].fill_value)


def test_a_table_that_was_cut_short_is_written_anew(tmp_path):
    root = zarr.open_group(tmp_path / "store.zarr", mode="w")
    root.create_group("one", attributes={"old": True})
    create_table(root, "one", SPEC)
    assert "old" not in root["one"].attrs
