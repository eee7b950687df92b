"""Effects inside a FEBio model of the user's own: where they go in its input, and which of them it can have."""

import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.model.effect import model_with
from sinew.tasks.model.effects import library
from sinew.tasks.model.parameters import own_parameter
from sinew.tasks.simulate.effects import simulate_with
from sinew.tasks.simulate.febio.attempt import solver_version
from sinew.tasks.simulate.febio.constituents import NotFound, located
from sinew.tasks.simulate.febio.effects_inside import fit_together, why_not, with_effects
from sinew.tasks.simulate.febio.output import Logged
from sinew.tasks.simulate.febio.simulator import FEBio
from sinew.tasks.simulate.febio.template import OwnTemplate, with_constituents
from sinew.tasks.simulate.row_by_row import Failed
from sinew.tasks.simulate.uniaxial import Uniaxial
from sinew.tasks.study.resources import resource
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
    with pytest.raises(NotFound) as wrong:
        at("tendon.solid[3]")
    assert "tendon.solid[1].elastic" in wrong.value.args[1]


def test_an_exponent_that_varies_is_none_of_the_models_own():
    other = TENDON.replace("<beta>2</beta>", "<beta>3</beta>")
    assert at(FIBRE, None, TENDON, other)["fibre"].exponent is None
    with pytest.raises(NotFound):
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
    assert outer.find("prestrain").get("type") == "prestrain gradient"
    assert outer.findtext("prestrain/F0") == "1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.004"


def test_a_stretch_is_along_the_models_own_fibres():
    text = TENDON.replace("0,0,1</fiber>", "3, 0, 4</fiber>")
    root = edited(LIBRARY["toe-slack"], found=at(FIBRE, None, text), text=text, slack_stretch=0.9)
    numbers = root.findtext("Material/material[2]/solid[2]/prestrain/F0").split(",")
    gradient = np.array(numbers, dtype=float).reshape(3, 3)
    along = np.array([0.6, 0.0, 0.8])
    assert gradient @ along == pytest.approx(0.9 * along)
    assert gradient @ [0.0, 1.0, 0.0] == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('type="vector">0,0,1<', 'type="local">1,2<'),
        ("<lam0>", '<mat_axis type="local">1,2,3</mat_axis><lam0>'),
        ('type="solid mixture">', 'type="solid mixture"><mat_axis type="local">1,2,3</mat_axis>'),
    ],
)
def test_fibres_that_are_not_straight_are_found_by_febio_and_only_right_behind(old, new):
    text = TENDON.replace(old, new)
    assert text != TENDON
    found = at(FIBRE, None, text)
    assert (found["fibre"].directed, found["fibre"].straight) == (True, False)
    root = edited(LIBRARY["toe-slack"], found=found, text=text, slack_stretch=0.99)
    stretched = root.find("Material/material[2]/solid[2]/prestrain")
    assert stretched.get("type") == "in-situ stretch"
    assert {child.tag: child.text for child in stretched} == {"stretch": "0.99", "isochoric": "0"}
    assert not fit_together((LIBRARY["toe-slack"], LIBRARY["softening"]), found)
    assert fit_together((LIBRARY["toe-slack"], LIBRARY["relaxation-mode"]), found)
    assert fit_together((LIBRARY["toe-slack"], LIBRARY["softening"]), at())


def test_directions_of_each_element_keep_their_way():
    """FEBio finds them by the way to the material, which a wrapper would change; a term changes none."""
    data = '<MeshData><ElementData type="solid[2].fiber" elem_set="all"/></MeshData></febio_spec>'
    found = at(FIBRE, MATRIX, TENDON.replace("</febio_spec>", data))
    assert "directions for each element" in why_not(LIBRARY["softening"], found, settles=True)
    assert "directions for each element" in why_not(LIBRARY["relaxation-mode"], found, settles=True)
    assert why_not(LIBRARY["fluid-flow"], found, settles=True) is None
    assert why_not(LIBRARY["toe-exponent"], found, settles=True) is None


def test_a_name_that_stands_for_two_materials_is_refused():
    inner = '<material name="t" type="viscoelastic"><elastic type="neo-Hookean"/></material>'
    both = f'<febio_spec><Material>{inner}<material name="t.elastic" type="Yeoh"/></Material></febio_spec>'
    with pytest.raises(NotFound, match=r"several materials 't\.elastic'"):
        located([both], "t.elastic")
    assert located([both.replace('"t"', '" u "')], "u").law == "neo-Hookean", "as `sinew init` names it"


def test_only_materials_are_materials():
    for step in ("[2].fiber", "[2].fiber.x", "[0]", "[3]", "", "[2]x"):
        path = f"tendon.solid{step}"
        with pytest.raises(NotFound) as wrong:
            at(path, None)
        assert "fiber" not in wrong.value.args[1]


def test_strange_models_take_neither_memory_nor_the_stack():
    name = "n" * 100_000
    many = "".join('<solid type="x"/>' for _ in range(2000))
    deep = '<elastic type="x">' * 3000 + "</elastic>" * 3000
    text = f'<febio_spec><Material><material name="{name}" type="y">{many}{deep}</material></Material></febio_spec>'
    with pytest.raises(NotFound) as wrong:
        located([text], "nobody")
    assert len("".join(wrong.value.args)) < 3000
    one = located([text.replace(name, "n")], "n")
    with pytest.raises(Failed, match="nested too deeply"):
        edited(LIBRARY["softening"], found={"fibre": one}, text=text.replace(name, "n"))


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
    with pytest.raises(NotFound):
        at(FIBRE, None, text.replace("um-nN-s", "furlong"))


def test_a_single_material_is_fibre_and_matrix():
    found = at("material3", "material3")
    root = edited(LIBRARY["softening"], LIBRARY["relaxation-mode"], found=found)
    whole = root.find("Material/material[3]")
    assert [whole.get("type"), whole.get("id")] == ["uncoupled viscoelastic", "3"]
    assert whole.find("elastic").get("type") == "uncoupled elastic damage"
    assert whole.find("elastic/elastic").get("type") == "Mooney-Rivlin"
    assert whole.findtext("density") == "1e-9", "a body force acts on the whole"
    assert [whole.findtext("k"), *(one.findtext("k") for one in whole.iter("elastic"))] == ["1000", None, None]
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
    assert not fit_together((LIBRARY["fluid-flow"], LIBRARY["rate-viscosity"]), found)
    with pytest.raises(Failed, match="more than 6 relaxation times"):
        edited(LIBRARY["fluid-flow"], LIBRARY["rate-viscosity"], found=found, text=text)
    more = text.replace("<elastic type=", "<g6>1</g6><t6>9</t6><elastic type=", 1)
    assert "6 relaxation times already" in why_not(LIBRARY["fluid-flow"], at(FIBRE, MATRIX, more), settles=True)


@pytest.mark.parametrize(
    ("slug", "old", "new", "told"),
    [
        ("rate-viscosity", "<E>50</E>", "<E>0</E>", "no modulus E above 0"),
        ("rate-viscosity", "<E>50</E>", "", "no modulus E above 0"),
        ("rate-viscosity", "<E>50</E>", "<E>nan</E>", "no modulus E above 0"),
        ("rate-viscosity", "<E>50</E>", "<E>5_0</E>", "no modulus E above 0"),
        ("rate-viscosity", "<E>50</E>", '<E lc="1">50</E>', "no modulus E above 0"),
        ("rate-viscosity", "<E>50</E>", '<E type="map">50</E>', "no modulus E above 0"),
        ("toe-exponent", "<beta>2</beta>", "", "no exponent beta of 2"),
        ("toe-exponent", "<beta>2</beta>", '<beta lc="2">2</beta>', "no exponent beta of 2"),
    ],
)
def test_numbers_that_an_effect_needs_must_be_there_for_each_row(slug, old, new, told):
    text = TENDON.replace(old, new)
    assert text != TENDON
    with pytest.raises(Failed, match=told):
        edited(LIBRARY[slug], text=text)
    assert why_not(LIBRARY[slug], at(FIBRE, MATRIX, text), settles=True) is not None


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
    assert not full.can_have((LIBRARY["relaxation-mode"], LIBRARY["rate-viscosity"])), "one series, by two names"
    alone = template(tmp_path, fibre="tissue").with_effects((LIBRARY["softening"],))
    assert alone.identity(*steps) == having.identity(*steps), "the matrix is not used"


def test_a_material_that_is_not_there_is_one_line(tmp_path):
    with pytest.raises(BadInput) as wrong:
        template(tmp_path, fibre="tissu")
    assert "simulator.fibre: no material 'tissu' in model.feb.j2; expected one of tissue, tissue.elastic" in str(
        wrong.value
    )
    assert "\n" not in str(wrong.value)


# ---- the solver

TIMES = np.linspace(0.0, 30.0, 121)
PULLED = Protocol(
    "pulled", TIMES, 10.0 * np.interp(TIMES, [0, 5, 10, 15, 22, 30], [0, 0.03, 0.03, 0.005, 0.042, 0.042])
)
FORMS = [form for effect in LIBRARY.values() for form in (effect, *effect.other_forms)]
INSIDE = [form for form in FORMS if form.febio and not form.around]
STRIP = Specimen("strip", 10.0, 8.0, 4.0)
#: One element of a single uncoupled material, in place of the tendon's mixture.
GEL = """    <material id="1" name="tendon" type="Mooney-Rivlin">
      <density>1</density><c1>{{ c1 }}</c1><c2>0</c2><k>100</k>
    </material>
"""


def own_tendon(folder, material=None, **paths):
    """The built-in tendon as a model of a user's own, with the parameters of the tissue or ``c1`` alone."""
    text = resource("templates/tendon.feb.j2").read_text()
    text = text.replace("parameters.", "").replace("constants.beta", "2.0").replace("constants.lambda_0", "1.01")
    own = [own_parameter(p.name, p.unit, p.minimum, p.maximum, p.reference) for p in Model().parameters]
    if material is not None:
        begin, end = text.index('    <material id="1"'), text.index("  </Material>")
        text, own = text[:begin] + material + text[end:], [own_parameter("c1", "MPa", 0.5, 2.0, 1.0)]
    force = Logged("force", "N", "max", "node_data", "Rz", (5, 6, 7, 8), None, "sum", 2.0)
    bare = OwnTemplate({"m.feb.j2": text}, "m.feb.j2", (force,), "force", settle_s=2000.0)
    model = Model(tuple(own), law="template")
    template = with_constituents(folder / "study.yaml", bare, model, paths, sized=True)
    program = Path(shutil.which("febio4"))
    return FEBio(str(program), solver_version(program), template, folder, timeout_s=60.0, hold_growth=0.0), model


def forces(simulator, model, effects, values, own):
    parameters = np.concatenate([own, values])[np.newaxis]
    done = simulator.with_effects(effects).simulate(model_with(model, effects), STRIP, PULLED, parameters)
    assert done.messages == ("",)
    return done.force_N[0]


def apart(force, other):
    return float(np.abs(force - other).max() / np.abs(other).max())


@pytest.mark.febio
@pytest.mark.parametrize("effect", INSIDE, ids=lambda effect: effect.name)
def test_the_solver_gives_the_force_of_the_tendon_with_the_effect(tmp_path, effect):
    simulator, model = own_tendon(tmp_path, fibre="tendon.solid[2].elastic", matrix=MATRIX)
    tissue = Model()
    own = tissue.full(("alpha_f", "E_m"), np.array([[1500.0, 50.0]]))[0]
    baseline = Uniaxial().simulate(tissue, STRIP, PULLED, own[np.newaxis]).force_N[0]
    assert apart(forces(simulator, model, (effect,), effect.null_values, own), baseline) < 1e-9
    expected = simulate_with(tissue, (effect,), STRIP, PULLED, own[np.newaxis], effect.typical[np.newaxis])[0]
    force = forces(simulator, model, (effect,), effect.typical, own)
    assert apart(force, expected) < (0.02 if effect.slug == "permanent-set" else 1e-6)
    assert apart(force, baseline) > 1e-3


@pytest.mark.febio
def test_stretch_and_damage_go_together(tmp_path):
    simulator, model = own_tendon(tmp_path, fibre="tendon.solid[2]", matrix="tendon.solid[1]")
    tissue, both = Model(), (LIBRARY["softening"], LIBRARY["toe-slack"])
    own = tissue.full(("alpha_f", "E_m"), np.array([[1500.0, 50.0]]))[0]
    values = np.concatenate([effect.typical for effect in both])
    expected = simulate_with(tissue, both, STRIP, PULLED, own[np.newaxis], values[np.newaxis])[0]
    assert apart(forces(simulator, model, both, values, own), expected) < 1e-6


@pytest.mark.febio
@pytest.mark.parametrize("effects", [("softening",), ("relaxation-mode",), ("softening", "relaxation-mode")])
def test_a_single_uncoupled_material_takes_effects(tmp_path, effects):
    simulator, model = own_tendon(tmp_path, GEL, fibre="tendon")
    chosen, own = tuple(LIBRARY[slug] for slug in effects), np.array([1.3])
    bare = forces(simulator, model, (), np.empty(0), own)
    null = np.concatenate([effect.null_values for effect in chosen])
    assert apart(forces(simulator, model, chosen, null, own), bare) < 1e-6
    typical = np.concatenate([effect.typical for effect in chosen])
    assert apart(forces(simulator, model, chosen, typical, own), bare) > 0.01
