"""What a FEBio model holds: each number with its path, what can be moved, and its sets."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.febio.model_file.contents import contents_of, fibre_and_matrix, nodes_of_surface
from sinew.tasks.simulate.febio.model_file.listing import as_json, lines
from sinew.tasks.simulate.febio.model_file.loading import loading_of, units
from sinew.tasks.simulate.febio.model_file.source import read_source
from sinew.tasks.simulate.febio.model_file.template import template_of
from tests.effort import at_most
from tests.tasks.simulate.febio.model_file.cube import CUBE, in_format_3
from tests.tasks.simulate.febio.model_file.test_source import read

GEL = "gel ä"
NUMBERS = {
    f"{GEL}.t1": 2.5,
    f"{GEL}.g1": 0.5,
    f"{GEL}.elastic.density": 1.0,
    f"{GEL}.elastic.E": 10.0,
    f"{GEL}.elastic.v": 0.3,
    **{f"{GEL}.elastic.mat_axis.a[{i}]": value for i, value in ((1, 1.0), (2, 0.0), (3, 0.0))},
    **{f"{GEL}.elastic.mat_axis.d[{i}]": value for i, value in ((1, 0.0), (2, 1.0), (3, 0.0))},
}


@pytest.mark.parametrize("text", [CUBE, in_format_3(CUBE)])
def test_every_number_of_a_material_has_a_path_and_a_place(tmp_path, text):
    source = read(tmp_path, text)
    found = contents_of(source)
    assert {one.path: one.value for one in found.materials} == NUMBERS
    for one in found.numbers.values():
        assert float(source.text[one.start : one.end]) == one.value
    assert found.texts == (f"{GEL}.elastic.map ({{X}}*2)",)
    assert {one.path for one in found.others} >= {
        "Globals.Constants.T",
        "Boundary.base.z_dof",
        "Boundary.pull.relative",
    }


@pytest.mark.parametrize("text", [CUBE, in_format_3(CUBE)])
def test_displacements_and_sets_are_found_by_name(tmp_path, text):
    source = read(tmp_path, text)
    found = contents_of(source)
    (one,) = found.moved
    assert (one.name, one.target, one.rigid, one.axis, one.factor, one.controller) == (
        "pull", "@surface:top", False, "z", 0.4, 2,
    )  # fmt: skip
    sets = found.sets
    assert (sets.nodes, sets.elements, sets.surfaces, sets.rigid) == (("cube", "bottom"), ("part",), ("top",), ())
    assert nodes_of_surface(source, "top") == [5, 6, 7, 8]


def test_names_that_are_there_twice_and_parts_without_a_name_get_numbers(tmp_path):
    second = '<material id="2" type="neo-Hookean"><E>1</E><E>2</E></material>'
    same = second.replace('id="2"', 'id="3" name="gel ä"')
    paths = [
        one.path
        for one in contents_of(read(tmp_path, CUBE.replace("</Material>", f"{second}{same}</Material>"))).materials
    ]
    assert len(set(paths)) == len(paths) == len(NUMBERS) + 4
    assert "material2.E[1]" in paths
    assert "gel ä[2].E[2]" in paths
    assert "gel ä[1].t1" in paths


def test_the_only_fibre_is_the_fibre_and_the_only_other_law_the_matrix(tmp_path):
    def laws(*solids):
        mixture = "".join(
            f'<solid type="viscoelastic"><elastic type="{law}"><E>1</E></elastic></solid>' for law in solids
        )
        rigid = '<material id="2" name="clamp" type="rigid body"><density>1</density></material>'
        begin, end = CUBE.index("<Material>"), CUBE.index("</Material>")
        tendon = f'<Material><material id="1" name="tendon" type="solid mixture">{mixture}</material>{rigid}'
        return contents_of(read(tmp_path, CUBE[:begin] + tendon + CUBE[end:])).laws

    both = laws("neo-Hookean", "fiber-exp-pow")
    assert [(one.path, one.elementary) for one in both] == [
        ("tendon", False),
        ("tendon.solid[1]", False),
        ("tendon.solid[1].elastic", True),
        ("tendon.solid[2]", False),
        ("tendon.solid[2].elastic", True),
    ]
    found = fibre_and_matrix(both)
    assert {name: one.path for name, one in found.items()} == {
        "fibre": "tendon.solid[2].elastic",
        "matrix": "tendon.solid[1].elastic",
    }
    assert set(fibre_and_matrix(laws("neo-Hookean", "neo-Hookean", "fiber-exp-pow"))) == {"fibre"}
    assert fibre_and_matrix(laws("neo-Hookean", "fiber-exp-pow", "fiber-exp-pow")) == {}
    assert fibre_and_matrix(laws("neo-Hookean", "isotropic elastic")) == {}
    one = fibre_and_matrix(laws("neo-Hookean"))
    assert one["fibre"] == one["matrix"]


def test_a_rigid_body_can_be_moved(tmp_path):
    rigid = '<material id="2" name="clamp" type="rigid body"><density>1</density></material></Material>'
    up = '<rigid_bc name="up" type="rigid_displacement"><rb>clamp</rb><dof>z</dof><value lc="2">1</value></rigid_bc>'
    text = CUBE.replace("</Material>", rigid).replace("<LoadData>", f"<Rigid>{up}</Rigid><LoadData>")
    found = contents_of(read(tmp_path, text))
    assert [(one.name, one.target, one.rigid) for one in found.moved] == [
        ("pull", "@surface:top", False),
        ("up", "clamp", True),
    ]
    assert found.sets.rigid == ("clamp",)


def test_loads_of_steps_have_the_name_of_their_step(tmp_path):
    load = '<Loads><surface_load name="press"><pressure>3</pressure></surface_load></Loads>'
    step = f'<Step><step id="1" name="first">{load}</step></Step>'
    found = contents_of(read(tmp_path, CUBE.replace("<LoadData>", f"{step}<LoadData>")))
    assert found.numbers["Step.first.Loads.press.pressure"].value == 3.0


def test_a_model_without_materials_is_refused(tmp_path):
    with pytest.raises(BadInput, match="has no material; expected a FEBio model with a Material section"):
        contents_of(read(tmp_path, '<febio_spec version="4.0"><Material/></febio_spec>'))


def test_what_it_holds_is_listed_for_a_person_and_for_a_program(tmp_path):
    source = read(tmp_path, CUBE)
    found = contents_of(source)
    listed = list(lines(source, found))
    assert "  gel ä.elastic.E = 10.0" in listed
    assert "  pull (nodes @surface:top, along z)" in listed
    assert "  surfaces: top" in listed
    assert as_json(source, found)["materials"] == NUMBERS


ODD = (
    b"<",
    b">",
    b"/>",
    b'"',
    b"1e999",
    b"9" * 5000,
    b"-",
    b"<a>",
    b"</Mesh>",
    b"&x;",
    b"\x00",
    b"\xff",
    b"{{",
    b"lc",
    b"",
)


@settings(max_examples=300, deadline=None)
@given(st.integers(0, len(CUBE)), st.integers(0, 40), st.sampled_from(ODD))
def test_any_bytes_as_a_model_are_read_or_refused_in_one_line(tmp_path_factory, at, length, odd):
    path = tmp_path_factory.mktemp("odd") / "cube.feb"
    model = CUBE.encode("latin-1")
    path.write_bytes(model[:at] + odd + model[at + length :])
    try:
        source = read_source(path)
        found = contents_of(source)
        list(lines(source, found))
        for surface in found.sets.surfaces:
            nodes_of_surface(source, surface)
        units(source)
        for moved in (None, *found.moved):
            template_of(source, (), moved, 1.0, ())
            loading_of(source, moved, 1.0)
    except BadInput as error:
        assert "\n" not in str(error)
        assert len(str(error)) < 400


def test_numbers_of_nodes_and_controllers_are_of_a_reasonable_length(tmp_path):
    long = "9" * 5000
    source = read(tmp_path, CUBE.replace("5,6,7,8</quad4>", f"5,6,7,{long}</quad4>").replace('lc="2"', f'lc="{long}"'))
    assert contents_of(source).moved == ()
    with pytest.raises(BadInput, match="the facets of surface 'top' cannot be read; expected numbers of nodes"):
        nodes_of_surface(source, "top")


def test_a_long_number_takes_no_time(tmp_path):
    source = read(tmp_path, CUBE.replace("2.50", "1" * 30_000 + "x"))
    with at_most(5):
        contents_of(source)


def test_lists_of_thousands_of_numbers_do_not_vary(tmp_path):
    found = contents_of(
        read(tmp_path, CUBE.replace("<v>0.3</v>", f"<v>0.3</v><a>{'1,' * 499}1</a><b>{'1,' * 500}1</b>"))
    )
    paths = [one.path for one in found.materials]
    assert sum(path.startswith(f"{GEL}.elastic.a[") for path in paths) == 500
    assert not any(".b" in path for path in paths)


def test_paths_of_numbers_take_no_more_memory_than_their_limit(tmp_path, monkeypatch):
    nested = "".join(f"<{name}>" for name in "abcdefgh") + "<n>1,2,3</n>" * 10 + "".join(f"</{n}>" for n in "hgfedcba")
    text = CUBE.replace("<v>0.3</v>", f"<v>0.3</v>{nested}")
    assert sum(".h.n[" in one.path for one in contents_of(read(tmp_path, text)).materials) == 30
    monkeypatch.setattr("sinew.tasks.simulate.febio.model_file.contents.MOST_CHARACTERS", 700)
    with pytest.raises(BadInput, match="has too many numbers beside its mesh, or names that are too long"):
        contents_of(read(tmp_path, text))


def test_numbers_with_short_paths_have_a_limit(tmp_path, monkeypatch):
    text = CUBE.replace("<v>0.3</v>", "<v>0.3</v>" + "<n>1,2,3</n>" * 10)
    contents_of(read(tmp_path, text))
    monkeypatch.setattr("sinew.tasks.simulate.febio.model_file.contents.MOST_NUMBERS", 29)
    with pytest.raises(BadInput, match="has too many numbers beside its mesh"):
        contents_of(read(tmp_path, text))
