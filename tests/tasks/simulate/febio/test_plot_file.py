"""Reading FEBio's plot files, and refusing damaged ones in one line."""

import tracemalloc
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.simulate.febio import plot_file
from sinew.tasks.simulate.febio.plot_file import plot_file_of, read_plot_file
from sinew.tasks.simulate.row_by_row import Failed
from tests.effort import at_most
from tests.tasks.simulate.febio import plot_writer as w

MB = 2**20


@pytest.mark.parametrize("compressed", [False, True])
def test_mesh_and_states_are_read(compressed):
    found = plot_file_of(w.plot_file(compressed=compressed), MB)
    assert found.time_s.tolist() == list(w.TIMES)
    assert np.array_equal(found.mesh.nodes, np.array(w.GRID))
    assert found.mesh.node_ids.tolist() == list(range(10, 22))
    blocks = [(region.name, region.shape, region.part, region.ids.tolist()) for region in found.mesh.domains]
    assert blocks == [("block", "hex8", 1, [1, 2]), ("", "tet4", 2, [3])]
    assert found.mesh.domains[0].corners.tolist() == w.HEXES
    (top,) = found.mesh.surfaces
    assert top.name == "top"
    assert top.corners.tolist() == [[8, 9, 11, -1], [8, 9, 11, 10]]
    assert top.nodes.tolist() == [8, 9, 11, 10]
    assert {name: ids.tolist() for name, ids in found.mesh.node_sets.items()} == {"side": [1, 3, 5]}
    assert {name: ids.tolist() for name, ids in found.mesh.element_sets.items()} == {"upper": [2]}
    assert found.mesh.parts == {1: "tissue"}


def test_each_format_and_type_of_variable():
    found = plot_file_of(w.plot_file(), MB).variables
    shapes = {name: (one.where, one.per, one.values.shape[1:], one.regions) for name, one in found.items()}
    assert shapes == {
        "energy": ("global", "item", (1, 1), ((0, 1),)),
        "displacement": ("node", "node", (12, 3), ((0, 12),)),
        "pair": ("node", "node", (12, 6), ((0, 12),)),
        "stress": ("domain", "item", (3, 6), ((0, 2), (1, 1))),
        "volume": ("domain", "region", (2, 1), ((0, 1), (1, 1))),
        "density": ("domain", "corner", (16, 1), ((0, 16),)),
        "a": ("domain", "node", (16, 3), ((0, 12), (1, 4))),
        "gap": ("surface", "item", (2, 1), ((0, 2),)),
        "pull": ("surface", "region", (1, 3), ((0, 1),)),
        "pressure": ("surface", "corner", (8, 1), ((0, 8),)),
    }
    assert np.array_equal(found["displacement"].values[1].ravel(), w.numbers(0.5, "displacement", 36))
    assert np.isnan(found["stress"].values[0]).all()  # the file has none at rest
    assert np.array_equal(found["stress"].values[2, :2].ravel(), w.numbers(2.0, "stress", 12))
    assert found["stress"].components == ("xx", "yy", "zz", "xy", "yz", "xz")
    assert found["displacement"].unit == "mm"
    assert found["a"].components == ("1", "2", "3")


def test_a_file_that_could_not_be_kept_is_refused(tmp_path, monkeypatch):
    (tmp_path / "whole.xplt").write_bytes(w.plot_file())
    monkeypatch.setattr("sinew.tasks.simulate.febio.plot_file.MAX_BYTES", 2000)
    with pytest.raises(Failed, match="more than 2,000"):
        read_plot_file(tmp_path / "whole.xplt", MB)


def test_a_missing_file(tmp_path):
    with pytest.raises(Failed, match=r"the solver wrote no model\.xplt"):
        read_plot_file(tmp_path / "model.xplt", MB)
    (tmp_path / "model.xplt").mkdir()
    with pytest.raises(Failed, match=r"model\.xplt is a folder"):
        read_plot_file(tmp_path / "model.xplt", MB)
    (tmp_path / "whole.xplt").write_bytes(w.plot_file())
    assert read_plot_file(tmp_path / "whole.xplt", MB).time_s.size == 3
    with pytest.raises(Failed, match="more than 1,000"):
        read_plot_file(tmp_path / "whole.xplt", 1000)


GOOD = w.plot_file()
DAMAGE = {
    "another file": (b"PK\3\4" + GOOD[4:], "does not begin as"),
    "version 2": (w.plot_file(version=0x25), r"version 2\.5"),
    "cut in the mesh": (GOOD[:1500], "the mesh is cut short"),
    "cut in a state": (GOOD[:-1], "claims"),
    "times": (w.plot_file((0.0, 1.0, 0.5)), "times do not increase"),
    "not a number": (w.plot_file((0.0, np.nan)), "times do not increase"),
    "mesh again": (GOOD + w.mesh(), "neither a state nor compressed"),
    "other compressed": (GOOD + zlib.compress(w.mesh()), "a mesh that changes"),
    "corner": (GOOD.replace(w.whole(0x01042201, 3, 0, 1, 3, 4), w.whole(0x01042201, 3, 0, 1, 3, 12)), "the mesh lacks"),
    "too few": (
        GOOD.replace(w.whole(0x01032104, 2), w.whole(0x01032104, 3)),
        "has 2 elements and claims 3",
    ),
    "unknown type": (GOOD.replace(w.item(0, 1, "gap"), w.item(8, 1, "gap")), "type 8"),
    "unknown format": (GOOD.replace(w.item(0, 1, "gap"), w.item(0, 4, "gap")), "format 4"),
    "no array": (GOOD.replace(w.item(6, 0, "a", 3), w.item(6, 0, "a", 0)), "0 components"),
    "twice": (GOOD.replace(w.item(0, 1, "gap"), w.item(0, 1, "pressure")), "twice"),
    "wider": (GOOD.replace(w.item(0, 1, "gap"), w.item(1, 1, "gap")), "2 numbers, not 6"),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_damage_is_one_clear_line(what):
    content, words = DAMAGE[what]
    assert content != GOOD
    with pytest.raises(Failed, match=words) as failed:
        plot_file_of(content, MB)
    assert failed.value.status == "bad_output"


def test_a_decompression_bomb_takes_no_memory():
    bomb = w.plot_file((), compressed=True) + zlib.compress(bytes(2**27))
    claims = w.plot_file((), compressed=True) + zlib.compress(w.chunk(0x02000000, bytes(2**27)))
    for content in (bomb, claims):
        tracemalloc.start()
        with pytest.raises(Failed, match=r"its states have more than 1,04\d,\d{3} bytes"):
            plot_file_of(content, MB)
        assert tracemalloc.get_traced_memory()[1] < 8 * MB
        tracemalloc.stop()


def test_states_that_lack_a_region_take_no_memory():
    """Each absent region is filled with NaN: a large mesh and many empty states must not multiply."""
    empty = w.chunk(0x02000000, w.chunk(0x02010000, w.floats(0x02010002, [3.0])), w.chunk(0x02020000))
    with pytest.raises(Failed, match="does not hold each variable once"):
        plot_file_of(GOOD + empty, MB)
    many = [w.absent(1.0 + number) for number in range(1000)]
    size = sum(map(len, many)) + len(w.state(0.5)) + len(w.mesh())
    plot_file_of(w.plot_file((0.5,)) + b"".join(many), 3 * size)
    with pytest.raises(Failed, match="too many numbers"):
        plot_file_of(w.plot_file((0.5,)) + b"".join(many), size)


HEADER = w.chunk(0x01010000, w.whole(0x01010001, 0x35))
NODES = w.chunk(
    0x01041000,
    w.chunk(0x01041100, w.whole(0x01041101, 1), w.whole(0x01041102, 3)),
    w.chunk(0x01041200, bytes(16)),
)


def empty_regions(states: int, each: int, domains: int) -> bytes:
    """A file whose mesh has ``domains`` of no element, of which ``states`` have a variable in ``each``."""
    words = w.chunk(0x01020000, w.chunk(0x01024000, w.item(0, 1, "density")))
    mesh = w.chunk(0x01040000, NODES, w.chunk(0x01042000, w.domain(0, 1, "", [], 1) * domains))
    data = w.chunk(0x02020000, w.chunk(0x02020400, w.value(1, *(w.chunk(1 + n) for n in range(each)))))
    every = [w.chunk(0x02000000, w.chunk(0x02010000, w.floats(0x02010002, [n])), data) for n in range(states)]
    return b"BEF\0" + w.chunk(0x01000000, HEADER, words) + mesh + b"".join(every)


NOTHING = b"".join(w.chunk(tag) for tag in range(100_000))
VARIABLE = w.chunk(0x01020000, w.chunk(0x01024000, w.chunk(0x01020001, NOTHING)))
EMPTY = 30_000  # chunks, which say nothing: with a file full of them, time would run
NO_DATA = w.chunk(0x02010000, w.floats(0x02010002, [9.0])), w.chunk(0x02020000, w.chunk(0x02020100) * EMPTY)
NO_NAMES = w.chunk(0x01020000, w.chunk(0x01023000, w.chunk(0x01020001, w.chunk(0x01020006) * EMPTY)))
SWOLLEN = {
    "the same part of a state's data": (
        GOOD + w.chunk(0x02000000, *NO_DATA),
        "a state's data has the chunk 0x02020100",
    ),
    "the same part of the dictionary": (
        b"BEF\0" + w.chunk(0x01000000, HEADER, w.chunk(0x01020000, w.chunk(0x01021000) * EMPTY)),
        "the dictionary has the chunk 0x01021000 too often",
    ),
    "names of an array's parts": (
        b"BEF\0" + w.chunk(0x01000000, HEADER, NO_NAMES),
        "a variable has the chunk 0x01020006",
    ),
    "parts of the root": (b"BEF\0" + w.chunk(0x01000000, NOTHING), "the root has more than 64 parts"),
    "parts of a variable": (b"BEF\0" + w.chunk(0x01000000, HEADER, VARIABLE), "a variable has more than 64 parts"),
    "parts of a state": (GOOD + w.chunk(0x02000000, NOTHING), "a state has more than 64 parts"),
    "regions": (empty_regions(1, 100_000, 1), "for region 2, which the mesh lacks"),
}


@pytest.mark.parametrize("what", SWOLLEN)
def test_many_empty_parts_are_refused_before_they_take_memory(what):
    content, words = SWOLLEN[what]
    tracemalloc.start()
    try:
        with pytest.raises(Failed, match=words):
            plot_file_of(content, 64 * MB)
        assert tracemalloc.get_traced_memory()[1] < MB  # each of the parts would take a hundred bytes
    finally:
        tracemalloc.stop()


def test_regions_and_materials_are_few(monkeypatch):
    value = w.value
    monkeypatch.setattr(w, "value", lambda number, *regions: value(number, *regions * 2))
    with pytest.raises(Failed, match="variable 'energy' has region 0 twice"):
        plot_file_of(w.plot_file(), MB)
    monkeypatch.setattr("sinew.tasks.simulate.febio.plot_mesh.MAX_REGIONS", 2)
    part = [w.chunk(0x01045100, w.whole(0x01045101, n), w.padded(0x01045102, "")) for n in range(3)]
    with pytest.raises(Failed, match="more than 2 parts"):
        plot_file_of(w.plot_file(()).replace(w.mesh(), w.chunk(0x01040000, NODES, w.chunk(0x01045000, *part))), MB)


def test_many_empty_regions_take_no_more_memory_than_the_file():
    content = empty_regions(300, 300, 1000)
    size = len(content)
    tracemalloc.start()
    try:
        found = plot_file_of(content, 64 * MB)
        assert tracemalloc.get_traced_memory()[1] < 2 * size
    finally:
        tracemalloc.stop()
    assert found.variables["density"].values.shape == (300, 0, 1)
    assert len(found.variables["density"].regions) == 300


def test_regions_of_all_states_are_limited(monkeypatch):
    monkeypatch.setattr("sinew.tasks.simulate.febio.plot_file.MAX_REGIONS", 299 * 100)
    with pytest.raises(Failed, match="its states have more than 29,900 regions"):
        plot_file_of(empty_regions(300, 100, 100), MB)
    assert plot_file_of(empty_regions(299, 100, 100), MB).time_s.size == 299


def test_variables_without_any_region_are_counted_too(monkeypatch):
    content = w.plot_file(()) + b"".join(w.absent(float(time)) for time in range(30))
    assert plot_file_of(content, MB).time_s.size == 30
    monkeypatch.setattr("sinew.tasks.simulate.febio.plot_file.MAX_REGIONS", 10 * 30 - 1)  # of ten variables
    with pytest.raises(Failed, match="its states have more than 299 regions"):
        plot_file_of(content, MB)


def test_a_part_has_a_number_that_files_can_hold():
    part = w.whole(0x01042103, 2)
    assert w.plot_file().count(part) == 1
    with pytest.raises(Failed, match="a domain of part 4294967295"):
        plot_file_of(w.plot_file().replace(part, w.whole(0x01042103, -1)), MB)


def test_the_same_material_again_and_again_is_refused():
    part = w.chunk(0x01045100, w.whole(0x01045101, 1), w.padded(0x01045102, ""))
    mesh = w.chunk(0x01040000, NODES, w.chunk(0x01045000, part * 100_001))
    with pytest.raises(Failed, match="more than 1,500 parts"):
        plot_file_of(w.plot_file(()).replace(w.mesh(), mesh), 64 * MB)


def test_memory_for_states_is_given_back_before_variables_take_theirs():
    count = 2**20
    nodes = np.zeros((count, 4), "<i4")
    place = w.chunk(
        0x01041000,
        w.chunk(0x01041100, w.whole(0x01041101, count), w.whole(0x01041102, 3)),
        w.chunk(0x01041200, nodes.tobytes()),
    )
    words = w.chunk(0x01020000, w.chunk(0x01023000, w.item(0, 0, "heat")))
    start = b"BEF\0" + w.chunk(0x01000000, HEADER, words) + w.chunk(0x01040000, place)

    def state(time: float) -> bytes:
        value = w.value(1, w.chunk(0, bytes(4 * count)))
        head = w.chunk(0x02010000, w.floats(0x02010002, [time]))
        return zlib.compress(w.chunk(0x02000000, head, w.chunk(0x02020000, w.chunk(0x02020300, value))), 1)

    content = start + state(1.0)
    tracemalloc.start()
    try:
        found = plot_file_of(content, 64 * MB)
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.variables["heat"].values.nbytes == 4 * MB
    assert used < 27 * MB  # 16 of nodes; the numbers as they were read, with room to grow; and as they are given


def test_of_states_whose_times_are_equal_as_float32_the_last_counts():
    late = 1e6
    content = w.plot_file((0.0, late)) + w.absent(np.float32(late + 0.01)) + w.state(late + 0.02)
    found = plot_file_of(content, MB)
    assert found.time_s.tolist() == [0.0, late]
    assert np.array_equal(found.variables["stress"].values[1, :2].ravel(), w.numbers(late + 0.02, "stress", 12))
    found = plot_file_of(w.plot_file((0.0, late)) + w.absent(late), MB)
    assert np.isnan(found.variables["stress"].values[1]).all()


@settings(max_examples=400, deadline=None)
@given(
    st.booleans(),
    st.lists(st.tuples(st.integers(0, 10_000), st.binary(min_size=1, max_size=8), st.booleans()), max_size=4),
    st.integers(0, 10_000),
)
def test_any_damage_is_read_or_refused(compressed, edits, cut):
    content = bytearray(w.plot_file(compressed=compressed))
    for at, new, replace in edits:
        at %= len(content)
        content[at : at + len(new) * replace] = new
    content = content[: len(content) - cut % len(content)] if cut % 3 == 0 else content
    try:
        found = plot_file_of(bytes(content), MB)
    except Failed as failed:
        assert failed.status == "bad_output"
        assert "\n" not in failed.words
    else:
        assert sum(one.values.nbytes for one in found.variables.values()) <= MB


def test_a_set_that_names_a_node_again_and_again_is_damage(monkeypatch):
    named = w.named_set
    monkeypatch.setattr(w, "named_set", lambda base, number, name, items: named(base, number, name, [*items, items[0]]))
    with pytest.raises(Failed, match="set 'side' has an item twice"):
        plot_file_of(w.plot_file(), MB)


@pytest.mark.parametrize("times", [(0.0,), (0.0, 1.0)])
def test_a_variable_that_is_twice_in_a_state_is_damage(monkeypatch, times):
    value = w.value
    monkeypatch.setattr(w, "value", lambda number, *regions: value(number, *regions) * (2 if number == 3 else 1))
    with pytest.raises(Failed, match="does not hold each variable once"):
        plot_file_of(w.plot_file(times), MB)


def test_states_of_one_time_without_numbers_are_cleared_once():
    """A hundred thousand of them, a few bytes each, took minutes."""
    count = 200_000
    entry = SimpleNamespace(width=1, name="a", where="node", per="node", kind="float", unit="")
    first, last = np.zeros(count, "<f4"), np.arange(count, dtype="<f4")
    course = SimpleNamespace(
        entry=entry, items={0: count}, states=[1, *[0] * 30_000, 1], regions=[0, 0],
        numbers=first.tobytes() + last.tobytes(),
    )  # fmt: skip
    with at_most(1.0):
        found = plot_file._variable(course, np.zeros(30_002, int), 1, 4 * count)
    assert np.array_equal(found.values[0, :, 0], last)
    course.states, course.regions, course.numbers = [1, 0], [0], first.tobytes()
    assert np.isnan(plot_file._variable(course, np.zeros(2, int), 1, 4 * count).values).all()
