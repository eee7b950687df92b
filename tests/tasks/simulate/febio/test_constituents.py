"""Effects inside a FEBio model of the user's own: where they go in its input, and which of them it can have."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.model.effects import library
from sinew.tasks.simulate.febio.constituents import NoMaterial, NoUnits, located, why_not, with_effects
from sinew.tasks.simulate.febio.template import with_constituents
from sinew.tasks.simulate.row_by_row import Failed
from tests.tasks.simulate.febio.dogbone import DOGBONE, OWN, dogbone

LIBRARY = library()
SIMO = LIBRARY["softening"].other_forms[0]
TENDON = """<febio_spec version="4.0"><Material>
  <material id="1" name="bone" type="rigid body"><density>1</density></material>
  <material id="2" name="tendon" type="solid mixture">
    <solid type="viscoelastic">
      <g1>0.5</g1><t1>2</t1><g2>0.1</g2><t2>20</t2>
      <elastic type="isotropic elastic"><E>50</E><v>0.2</v></elastic>
    </solid>
    <solid type="fiber-exp-pow-linear">
      <E>300</E><alpha>500</alpha><beta>2</beta><lam0>1.02</lam0><fiber type="vector">0,0,1</fiber>
    </solid>
  </material>
  <material id="3" type="Mooney-Rivlin"><density>1e-9</density><c1>1</c1><k>1000</k></material>
</Material></febio_spec>"""
MATRIX, FIBRE = "tendon.solid[1].elastic", "tendon.solid[2]"


def at(fibre: str | None = FIBRE, matrix: str | None = MATRIX, *texts: str):
    paths = {"fibre": fibre, "matrix": matrix}
    return {name: located(list(texts or [TENDON]), path) for name, path in paths.items() if path}


def typical(*effects):
    return {p.name: p.reference for effect in effects for p in effect.parameters}


def edited(*effects, found=None, text=TENDON, **values):
    return ET.fromstring(with_effects(text, found or at(), effects, typical(*effects) | values))


def test_materials_are_found_by_their_paths():
    found = at()
    assert (found["fibre"].law, found["fibre"].free_terms, found["fibre"].exponent) == ("fiber-exp-pow-linear", 6, 2.0)
    assert found["fibre"].directed
    assert (found["matrix"].law, found["matrix"].free_terms, found["matrix"].modulus) == ("isotropic elastic", 4, True)
    assert at("tendon.solid[1]", None)["fibre"].law == "isotropic elastic", "what relaxes stands for its elastic part"
    assert at("material3", None)["fibre"].uncoupled
    assert not found["matrix"].uncoupled
    with pytest.raises(NoMaterial) as wrong:
        at("tendon.solid[3]")
    assert "tendon.solid[1].elastic" in wrong.value.args


def test_an_exponent_that_varies_is_none_of_the_models_own():
    other = TENDON.replace("<beta>2</beta>", "<beta>3</beta>")
    assert at(FIBRE, None, TENDON, other)["fibre"].exponent is None
    with pytest.raises(NoMaterial):
        at(
            FIBRE,
            None,
            TENDON,
            TENDON.replace("solid mixture", "x").replace("<solid", "<part").replace("</solid", "</part"),
        )


def test_damage_is_around_the_fibres_law_and_nothing_else_changes():
    root = edited(LIBRARY["softening"], softening_loss=0.25)
    damaged = root.find("Material/material[2]/solid[2]")
    assert damaged.get("type") == "elastic damage"
    assert damaged.find("elastic").get("type") == "fiber-exp-pow-linear"
    assert [child.tag for child in damaged.find("elastic")] == ["E", "alpha", "beta", "lam0", "fiber"]
    assert damaged.findtext("damage/Dmax") == "0.25"
    before = ET.fromstring(TENDON)
    for path in ("Material/material[1]", "Material/material[2]/solid[1]", "Material/material[3]"):
        assert ET.canonicalize(ET.tostring(root.find(path)), strip_text=True) == ET.canonicalize(
            ET.tostring(before.find(path)), strip_text=True
        )


def test_terms_go_into_the_series_that_is_there_or_into_a_new_one():
    root = edited(
        LIBRARY["fluid-flow"], LIBRARY["rate-viscosity"], fluid_modulus=10.0, diffusion_time=7.0, viscosity=5.0
    )
    series = root.find("Material/material[2]/solid[1]")
    terms = {child.tag: float(child.text) for child in series if child.tag[0] in "gt"}
    assert terms == pytest.approx(
        {"g1": 0.5, "t1": 2, "g2": 0.1, "t2": 20, "g3": 10 / 50, "t3": 7, "g4": 5 / 50 / 1e-4, "t4": 1e-4}
    )
    root = edited(LIBRARY["relaxation-mode"], LIBRARY["softening"])
    series = root.find("Material/material[2]/solid[2]")
    assert [series.get("type"), series.find("elastic").get("type")] == ["viscoelastic", "elastic damage"]
    assert series.find("elastic/elastic").get("type") == "fiber-exp-pow-linear"
    assert {child.tag for child in series} == {"elastic", "g1", "t1"}


def test_the_changed_stretch_reaches_the_laws_inside():
    root = edited(LIBRARY["softening"], LIBRARY["preload"], preload_stretch=1.004)
    outer = root.find("Material/material[2]/solid[2]")
    assert [outer.get("type"), outer.find("elastic").get("type")] == ["prestrain elastic", "elastic damage"]
    assert outer.findtext("prestrain/stretch") == "1.004", "along the model's own fibres"


def test_the_exponent_takes_the_place_of_the_models_own():
    root = edited(LIBRARY["toe-exponent"], toe_exponent=3.5)
    assert root.findtext("Material/material[2]/solid[2]/beta") == "3.5"


def test_stresses_are_in_the_units_of_the_model():
    text = TENDON.replace("<Material>", "<Module><units>um-nN-s</units></Module><Material>")
    found = at(FIBRE, MATRIX, text)
    assert found["matrix"].stress_MPa == pytest.approx(1e-3), "kPa"
    root = edited(LIBRARY["permanent-set"], found=found, text=text, yield_stress=0.5, yield_spread=0.25)
    assert float(root.findtext(".//Y0")) == pytest.approx(500.0)
    assert float(root.findtext(".//Ymax")) == pytest.approx(750.0)
    root = edited(SIMO, LIBRARY["rate-viscosity"], found=found, text=text, softening_stress_root=0.5, viscosity=2.0)
    assert float(root.findtext(".//a")) == pytest.approx(0.5 * 1000**0.5)
    assert float(root.findtext("Material/material[2]/solid[1]/g3")) == pytest.approx(2000.0 / 50 / 1e-4)
    with pytest.raises(NoUnits):
        at(FIBRE, None, text.replace("um-nN-s", "furlong"))


def test_a_single_material_is_fibre_and_matrix():
    found = at("material3", "material3")
    root = edited(LIBRARY["softening"], LIBRARY["relaxation-mode"], found=found)
    whole = root.find("Material/material[3]")
    assert [whole.get("type"), whole.get("id")] == ["uncoupled viscoelastic", "3"]
    assert whole.find("elastic").get("type") == "uncoupled elastic damage"
    assert whole.find("elastic/elastic").get("type") == "Mooney-Rivlin"
    assert whole.findtext("density") == "1e-9", "a body force acts on the whole"
    assert why_not(LIBRARY["fluid-flow"], found, settles=True) == "in a single material it is relaxation-mode"


@pytest.mark.parametrize(
    ("slug", "found", "why"),
    [
        ("softening", at(None), "simulator.fibre does not say which material is the fibre"),
        ("permanent-set", at(FIBRE, None), "simulator.matrix does not say which material is the matrix"),
        ("permanent-set", at(FIBRE, "material3"), "material3 (Mooney-Rivlin) is uncoupled"),
        ("toe-slack", at(MATRIX), "tendon.solid[1].elastic (isotropic elastic) has no fibres along a direction"),
        ("toe-exponent", at(MATRIX), "has no exponent beta that stays 2"),
        ("rate-viscosity", at(FIBRE, "material3"), "material3 (Mooney-Rivlin) has no modulus E"),
        ("preload", at(), "simulator.settle_s does not say how long it takes to relax at rest"),
        ("area-error", at(), "it acts around the specimen"),
        ("creep", at(), LIBRARY["creep"].no_febio),
        ("softening", at(), None),
        ("permanent-set", at(), None),
    ],
)
def test_why_a_model_cannot_have_an_effect(slug, found, why):
    told = why_not(LIBRARY[slug], found, settles=False)
    assert told == why if why is None else why in told


def test_a_full_series_takes_no_more_terms():
    full = "".join(f"<g{i}>0.1</g{i}><t{i}>{i}</t{i}>" for i in range(3, 6))
    text = TENDON.replace("<elastic type=", f"{full}<elastic type=", 1)
    found = at(FIBRE, MATRIX, text)
    assert found["matrix"].free_terms == 1
    assert why_not(LIBRARY["fluid-flow"], found, settles=True) is None
    with pytest.raises(Failed, match="more than 6 relaxation times"):
        edited(LIBRARY["fluid-flow"], LIBRARY["rate-viscosity"], found=found, text=text)
    more = text.replace("<elastic type=", "<g6>1</g6><t6>9</t6><elastic type=", 1)
    assert "6 relaxation times already" in why_not(LIBRARY["fluid-flow"], at(FIBRE, MATRIX, more), settles=True)


def test_parameters_that_make_another_model_fail_the_row():
    other = TENDON.replace('<solid type="fiber', '<part type="fiber').replace(
        "</solid>\n  </material>", "</part>\n  </material>"
    )
    with pytest.raises(Failed, match=r"no material tendon\.solid\[2\]"):
        edited(LIBRARY["softening"], text=other)


# ---- a template


def template(tmp_path, **paths):
    bare = dogbone(tmp_path, DOGBONE.read_text()).template
    return with_constituents(tmp_path / "study.yaml", bare, OWN, paths, sized=True)


def test_a_template_with_effects_is_another_one_and_without_them_the_same(tmp_path):
    bare, own = template(tmp_path), template(tmp_path, fibre="tissue", matrix="tissue.elastic")
    steps = (0.0, 0.0, 0.0)
    assert own.identity(*steps) == bare.identity(*steps), "its rows are those of the model without effects"
    having = own.with_effects((LIBRARY["softening"],))
    assert having.identity(*steps) not in (bare.identity(*steps), own.with_effects((SIMO,)).identity(*steps))
    assert own.completed("<a/>", {}) == "<a/>"
    assert own.can_have((LIBRARY["softening"], LIBRARY["relaxation-mode"]))
    assert not own.can_have((LIBRARY["fluid-flow"],))
    assert not bare.can_have((LIBRARY["softening"],))
    with pytest.raises(BadInput, match=r"model\.effects: softening: simulator\.fibre does not say"):
        bare.with_effects((LIBRARY["softening"],))
    full = replace(own, constituents={name: replace(one, free_terms=1) for name, one in own.constituents.items()})
    assert not full.can_have((LIBRARY["relaxation-mode"], replace(LIBRARY["relaxation-mode"], slug="fifth")))


def test_a_material_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(BadInput) as wrong:
        template(tmp_path, fibre="tissu")
    assert "simulator.fibre: no material 'tissu' in model.feb.j2; expected one of tissue, tissue.elastic" in str(
        wrong.value
    )
    assert "\n" not in str(wrong.value)
