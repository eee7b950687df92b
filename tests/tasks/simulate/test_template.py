"""Studies with a user's own template: rendering, validation, parsing, and the real solver against what is known."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runner.store import STATUSES
from tasks.model import Curve, Model, Protocol, Specimen
from tasks.model.parameters import own_parameter
from tasks.problems import BadInput
from tasks.resources import resource
from tasks.simulate import rendering
from tasks.simulate.attempt import Failed, solver_version
from tasks.simulate.febio import FEBio, read_template
from tasks.simulate.rendering import Wrong, add_outputs, answer, check, rendered, used_names
from tasks.simulate.template import Logged, Template, check_template, read_files, read_output

BAR = Specimen("bar", 20.0, 4.0, 2.0)
RELAX = Protocol("relax", np.linspace(0.0, 12.0, 25), 0.3 * np.minimum(np.linspace(0.0, 12.0, 25), 4.0))
DOGBONE = resource("configs/dogbone/dogbone.feb.j2")
FORCE = Logged("force", "N", "max", "node_data", "Rz", (), "grip", "sum", 4.0)
STRESS = Logged("stress", "MPa", "max", "element_data", "sz", (), "gauge", "mean")
NARROWING = Logged("narrowing", "mm", "max", "node_data", "ux", (), "edge", "single", -2.0)
OWN = Model(
    (
        own_parameter("E_matrix", "MPa", 5.0, 50.0, 20.0),
        own_parameter("nu", "1", 0.1, 0.45, 0.3),
        own_parameter("g_1", "1", 0.1, 1.5, 0.8),
        own_parameter("tau_1", "s", 2.0, 30.0, 8.0),
    ),
    law="template",
)


def stand_in(folder: Path) -> Path:
    """The analytic bar of the tutorial as a program; it is not FEBio."""
    text = resource("configs/dogbone/analytic_bar.py").read_text()
    program = folder / "analytic-bar"
    program.write_text(text.replace("/usr/bin/env python3", f"{sys.executable} -I", 1))
    program.chmod(0o755)
    return program


def dogbone(folder: Path, text: str | None = None, program: Path | None = None) -> Template:
    """The dog-bone, or another template, with the stand-in or another solver."""
    program = program or stand_in(folder)
    files = {"model.feb.j2": DOGBONE.read_text() if text is None else text}
    return Template(
        str(program), "test", files, "model.feb.j2", (FORCE, STRESS, NARROWING), folder / "attempts", "force",
        timeout_s=120.0,
    )  # fmt: skip


def render(text: str, **variables):
    return rendered({"a": text}, "a", variables)


# ---- what a template may do


@pytest.mark.parametrize(
    ("text", "told"),
    {
        "attribute": ("{{ ''.__class__ }}", "attributes"),
        "attribute by item": ("{{ E['__class__'] }}", "for lists"),
        "attribute by filter": ("{{ E | attr('real') }}", "attr"),
        "method": ("{{ 'a'.upper() }}", "attributes"),
        "format method": ("{{ '{0.__class__}'.format(E) }}", "attributes"),
        "loop's own": ("{% for i in [1] %}{{ loop._iterator }}{% endfor %}", "attributes"),
        "globals of a macro": ("{% macro m() %}{% endmacro %}{{ m.__globals__ }}", "attributes"),
        "unknown": ("{{ E_matrxi }}", "'E_matrxi' is undefined"),
        "unknown item": ("{{ specimen.radius_mm }}", "radius_mm"),
        "unknown, full": ("{{ E_matrxi | full }}", "'E_matrxi' is undefined"),
        "nothing": ("{{ none }}", "prints nothing"),
        "a list": ("{{ [1, 2] }}", "something else"),
        "infinity": ("{{ E * 1e308 * 10 }}", "no finite number"),
        "nan": ("{{ E * 1e308 * 10 - E * 1e308 * 10 }}", "no finite number"),
        "division by zero": ("{{ E / 0 }}", "division by zero"),
        "random": ("{{ [1, 2] | random }}", "random"),
        "lipsum": ("{{ lipsum() }}", "lipsum"),
        "another file": ("{% include '/etc/passwd' %}", "/etc/passwd"),
        "syntax": ("{% if %}", "line 1"),
        "text for full": ("{{ 'a' | full }}", "prints numbers"),
        "large range": ("{{ range(10000000) | length }}", "MAX_RANGE|too big"),
    }.values(),
)
def test_a_template_has_numbers_and_nothing_else(text, told):
    with pytest.raises(Wrong) as wrong:
        render(text, E=1.5, specimen={"length_mm": 3.0})
    assert any(each in " ".join(map(str, wrong.value.args)) for each in told.split("|"))


def test_what_a_template_may_do():
    text = """<a{% set ns = namespace(n=0) %}>
    {%- for i in range(3) %}{% set ns.n = ns.n + i %}{{ loop.index }},{% endfor %}
    {{- ns.n }};{{ sqrt(E) }};{{ specimen.length_mm }};{{ [E, 1] | max }};{{ pi | round(3) }}</a>"""
    assert render(text, E=6.25, specimen={"length_mm": 3.0}).text == "1,2,3,3;2.5;3.0;6.25;3.142"


@given(st.floats(allow_nan=False, allow_infinity=False))
@settings(deadline=None)
def test_numbers_read_back_to_the_same_bits(value):
    assert float(render("<a>{{ E }}</a>", E=value).text) == value


@pytest.mark.parametrize(
    ("body", "told"),
    {
        "no FEBio": ("<html/>", "<html>"),
        "include": ("<febio_spec><Include>a.feb</Include></febio_spec>", "<Include>"),
        "from": ('<febio_spec><Mesh from="a.feb"/></febio_spec>', "Mesh from"),
        "file above": ('<febio_spec><x file="../x"/></febio_spec>', "x file"),
        "file elsewhere": ('<febio_spec><x file="/etc/x"/></febio_spec>', "x file"),
        "path in a text": ("<febio_spec><image> /etc/x</image></febio_spec>", "names a path"),
        "path above in a text": ("<febio_spec><image>a/../../x</image></febio_spec>", "names a path"),
        "drive": ("<febio_spec><image>C:\\x</image></febio_spec>", "names a path"),
    }.values(),
)
def test_what_could_name_a_file_is_refused(body, told):
    with pytest.raises(Wrong) as wrong:
        check("a", render(body))
    assert told in " ".join(wrong.value.args)


def test_entities_and_broken_xml_are_refused_with_their_line():
    with pytest.raises(Wrong, match="renders to no XML"):
        render('<!DOCTYPE x [<!ENTITY a "b">]><febio_spec>&a;</febio_spec>')
    with pytest.raises(Wrong) as wrong:
        render("<febio_spec>\n<a></b>\n</febio_spec>")
    assert "<a></b>" in wrong.value.args[1]


@pytest.mark.parametrize(
    ("text", "told"),
    {
        "time": ("{% for a in range(99999) %}{% for b in range(99999) %}{% endfor %}{% endfor %}", "more than 1 s"),
        "a constant": ("{{ 10 ** (10 ** 10) }}", "more than 1 s|GB to render"),
        "memory": ("{{ 'x' * 10 ** 11 }}", "GB to render|MemoryError"),
        "doubling": (
            "{% set ns = namespace(x='x' * 99) %}{% for i in range(99) %}{% set ns.x = ns.x ~ ns.x %}{% endfor %}",
            "GB to render|MemoryError|more than 1 s",
        ),
        "endless macro": ("{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}", "recursion"),
    }.values(),
)  # fmt: skip
def test_a_template_is_bounded_in_time_and_memory(tmp_path, monkeypatch, text, told):
    """In its own process; a second of processor time instead of a minute, so that the test does not take that long."""
    short = tmp_path / "rendering.py"
    own = Path(rendering.__file__).read_text()
    short.write_text(own.replace("SECONDS, MEMORY_BYTES, INPUT_BYTES = 60,", "SECONDS, MEMORY_BYTES, INPUT_BYTES = 1,"))
    assert short.read_text() != own
    monkeypatch.setattr(rendering, "__file__", str(short))
    monkeypatch.setattr(rendering, "SECONDS", 1)
    simulator = dogbone(tmp_path, f"<febio_spec>{{{{ E_matrix }}}}{text}</febio_spec>")
    found = simulator.simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis])
    assert STATUSES[found.status[0]] == "bad_input"
    assert any(each in found.messages[0] for each in told.split("|")), found.messages


# ---- outputs in the input


MESH = """<febio_spec><Material><material id="7" name="clamp" type="rigid body"/></Material><Mesh>
<Nodes name="n"><node id="1">0,0,0</node><node id="5">0,0,1</node></Nodes>
<Elements name="part" type="hex8"><elem id="3">1,5</elem></Elements>
<NodeSet name="top">5</NodeSet><NodeSet name="none"></NodeSet><NodeSet name="old"><n id="1"/><n id="5"/></NodeSet>
<NodeSet name="astray">1,9</NodeSet></Mesh>{}</febio_spec>"""


def asked(**changes) -> dict:
    return {"name": "q", "data": "node_data", "item": "uz", "ids": [], "set": None, "reduce": "sum"} | changes


@pytest.mark.parametrize(
    ("output", "ids"),
    [
        (asked(ids=[5, 1]), "5,1"),
        (asked(set="top"), "5"),
        (asked(set="old"), "1,5"),
        (asked(set="n"), "1,5"),
        (asked(data="element_data", set="part"), "3"),
        (asked(data="rigid_body_data", set="clamp"), "7"),
        (asked(data="rigid_body_data", ids=[7]), "7"),
    ],
)
@pytest.mark.parametrize("section", ["", "<Output><logfile/></Output>", "<Output><plotfile/></Output>"])
def test_outputs_are_added_to_the_log_file_section(output, ids, section):
    root = render(MESH.format(section))
    add_outputs("a", root, [output])
    (added,) = root.findall("Output/logfile/*")
    assert (added.tag, added.text, added.get("data"), added.get("file")) == (output["data"], ids, "uz", "sinew-0.txt")


@pytest.mark.parametrize(
    ("output", "told"),
    [
        (asked(ids=[2]), "node 2 is not in a"),
        (asked(set="botom"), "no set 'botom' of nodes"),
        (asked(set="none"), "is empty"),
        (asked(set="astray"), "node 9 is not in a"),
        (asked(set="old", reduce="single"), "set old has 2 items"),
        (asked(data="element_data", ids=[1]), "element 1 is not in a"),
        (asked(data="rigid_body_data", ids=[1]), "rigid body 1 is not in a"),
    ],
)
def test_outputs_of_what_is_not_there(output, told):
    with pytest.raises(Wrong) as wrong:
        add_outputs("a", render(MESH.format("")), [output])
    assert wrong.value.args[0] == "simulator.outputs.q"
    assert told in wrong.value.args[1]


def test_names_that_a_template_uses():
    text = "{% set a = E %}{% for i in range(2) %}{{ a * i * nu }}{% endfor %}{{ sqrt(pi) }}"
    assert used_names({"a": text}) == {"E", "nu"}
    with pytest.raises(Wrong, match="unknown variable"):
        answer({"files": {"a": text}, "main": "a", "known": ["E"], "renders": []})


# ---- validation


def check_dogbone(tmp_path, text: str, model: Model = OWN) -> None:
    check_template(tmp_path / "study.yaml", dogbone(tmp_path, text), model, sized=True, moved=True)


def test_the_dogbone_is_valid(tmp_path):
    check_dogbone(tmp_path, DOGBONE.read_text())


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("{{ nu }}", "0.3", "model.parameters.nu: not used in model.feb.j2; expected {{ nu }} where it acts"),
        ("{{ nu }}", "{{ 0 * nu + 0.3 }}", "model.parameters.nu: model.feb.j2 renders to the same input at both ends"),
        ("{{ nu }}", "0.3<!-- {{ nu }} -->", "renders to the same input at both ends"),
        ("{{ nu }}", "{{ nue }}", "model.feb.j2: unknown variable nue; expected some of"),
        ("{{ nu }}", "{{ nu / (nu - 0.45) }}", "line "),
        ("{{ displacement_points }}", "<pt>0,0</pt>", "does not follow the measured displacement"),
        ("</Mesh>", "", "renders to no XML"),
        ('name="grip">{{', 'name="crip">{{', "simulator.outputs.force: no set 'grip' of nodes"),
    ],
)
def test_validation_tells_one_line(tmp_path, old, new, told):
    text = DOGBONE.read_text()
    assert old in text
    with pytest.raises(BadInput) as wrong:
        check_dogbone(tmp_path, text.replace(old, new))
    assert told in str(wrong.value)
    assert "\n" not in str(wrong.value)


def test_files_stay_in_their_folders(tmp_path):
    (tmp_path / "study" / "sub").mkdir(parents=True)
    (tmp_path / "secret").write_text("x")
    home = tmp_path / "study"
    (home / "sub" / "a.feb").write_text("{% include 'b.xml' %}")
    (home / "sub" / "b.xml").write_text("b")
    assert read_files(home, "sub/a.feb") == ("a.feb", {"a.feb": "{% include 'b.xml' %}", "b.xml": "b"})
    for text, told in [
        ("{% include '../../secret' %}", "lies outside the template's folder"),
        ("{% include '/etc/hostname' %}", "lies outside the template's folder"),
        ("{% include x %}", "whose name is computed"),
        ("{% include 'gone' %}", "is not there"),
        ("{% if %}", "line 1"),
    ]:
        (home / "sub" / "a.feb").write_text(text)
        with pytest.raises(BadInput, match=told):
            read_files(home, "sub/a.feb")
    (home / "link.feb").symlink_to(tmp_path / "secret")
    for name in ("../secret", "link.feb", "a\0b"):
        with pytest.raises(BadInput):
            read_files(home, name)


# ---- what the solver logged


def logged(times, ids, values) -> str:
    text = ""
    for step, (at, row) in enumerate(zip(times, values, strict=True), 1):
        text += f"*Step  = {step}\n*Time  = {at!r}\n*Data  = q\n"
        text += "".join(f"{each},{value!r}\n" for each, value in zip(ids, row, strict=True))
    return text


NUMBERS = st.floats(-1e6, 1e6, allow_nan=False)


@st.composite
def logs(draw):
    steps, count = draw(st.integers(1, 8)), draw(st.integers(1, 5))
    times = np.cumsum(draw(st.lists(st.floats(1e-3, 10.0), min_size=steps, max_size=steps)))
    ids = draw(st.lists(st.integers(1, 999), min_size=count, max_size=count, unique=True))
    values = draw(st.lists(st.lists(NUMBERS, min_size=count, max_size=count), min_size=steps, max_size=steps))
    return times, ids, np.array(values)


@given(logs(), st.sampled_from(["sum", "mean", "max", "min"]), st.floats(-10, 10))
@settings(deadline=None)
def test_what_was_logged_is_read(tmp_path_factory, log, reduce, scale):
    times, ids, values = log
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_text(logged(times.tolist(), ids, values.tolist()))
    at, found = read_output(
        path, Logged("q", "1", "max", "node_data", "uz", tuple(ids), None, reduce, scale), 10**6, times[-1]
    )
    assert np.array_equal(at, times)
    assert np.allclose(found, scale * getattr(np, reduce)(values, axis=1), rtol=1e-12, atol=1e-6)


@given(logs(), st.data())
@settings(deadline=None)
def test_a_log_with_a_piece_missing_is_never_read_as_a_whole(tmp_path_factory, log, data):
    times, ids, values = log
    text = logged(times.tolist(), ids, values.tolist())
    begin = data.draw(st.integers(0, len(text) - 1))
    cut = text[:begin] + text[data.draw(st.integers(begin + 1, len(text))) :]
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_text(cut)
    try:
        at, found = read_output(path, Logged("q", "1", "max", "node_data", "uz", tuple(ids), None, "sum"), 10**6, 0.0)
    except Failed as failed:
        assert failed.status == "bad_output"
    else:  # whole steps or digits can be missing without a trace
        assert 1 <= at.size <= times.size
        assert np.isfinite(found).all()


@given(st.binary(max_size=300))
@settings(deadline=None)
def test_garbage_is_a_failure(tmp_path_factory, garbage):
    path = tmp_path_factory.mktemp("log") / "q.txt"
    path.write_bytes(garbage)
    with pytest.raises(Failed) as failed:
        read_output(path, FORCE, 10**6, 1.0)
    assert failed.value.status == "bad_output"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (logged([1.0, 2.0], [1], [[1.0], [float("nan")]]), "not finite at 2 s"),
        (logged([1.0], [1, 2], [[1e308, 1e308]]), "not finite"),
        (logged([2.0, 1.0], [1], [[1.0], [1.0]]), "times do not increase"),
        (logged([1.0], [3], [[1.0]]), "other ids"),
        (logged([1.0], [1], [[1.0]]).replace("1,1.0", "1,1.0,2.0"), "3 numbers"),
        ("", "q: 0 steps"),
        (logged([0.5], [1], [[1.0]]), "q ends at 0.5 s, the protocol at 1 s"),
    ],
)
def test_what_is_amiss_in_a_log_is_told(tmp_path, text, told):
    (tmp_path / "q.txt").write_text(text)
    ids = (1, 2) if "1e+308" in text else (1,)
    with pytest.raises(Failed, match=told):
        read_output(tmp_path / "q.txt", Logged("q", "1", "max", "node_data", "uz", ids, None, "sum"), 10**6, 1.0)


# ---- whole evaluations, with the stand-in


def test_an_evaluation_gives_all_outputs(tmp_path):
    simulator = dogbone(tmp_path)
    curve = Curve(RELAX, np.zeros(RELAX.time_s.size))
    keep = np.array([0, 8, 24])
    rows = np.stack([OWN.reference, [40.0, 0.3, 0.8, 8.0], [20.0, 0.2, 0.8, 8.0], [-1.0, 0.3, 0.8, 8.0]])
    found = simulator.compare(OWN, BAR, curve, rows, keep)
    assert [STATUSES[status] for status in found.status] == ["ok", "ok", "ok", "bad_input"]
    assert "E_matrix = -1; expected from 5 to 50" in found.messages[3]
    assert set(found.outputs) == set(found.summaries) == {"force", "stress", "narrowing"}
    assert np.allclose(found.force_N[1], 2 * found.force_N[0], rtol=1e-12)  # linear in the modulus
    assert (found.outputs["narrowing"][2][1:] < found.outputs["narrowing"][0][1:]).all()
    assert np.isclose(found.summaries["force"][0], found.force_N[0, 1])
    assert np.isclose(found.rmse_N[1], 2 * found.rmse_N[0])
    assert np.isnan(found.rmse_N[3])
    assert not list((tmp_path / "attempts").glob("attempt-*"))


PLAYS = {
    "a step short": ("text = text.rpartition('*Step')[0]", "bad_output", "force ends at"),
    "no number": ("text = text.replace('1,', '1,x', 1)", "bad_output", "something else than numbers"),
    "other nodes": ("text = text.replace('\\n', '\\n9', 4)", "bad_output", "force"),
    "nothing": ("text = ''", "bad_output", "0 steps"),
}


@pytest.mark.parametrize("name", PLAYS)
def test_output_that_is_amiss_is_a_failed_row_with_its_reason(tmp_path, name):
    play, status, told = PLAYS[name]
    program = stand_in(tmp_path)
    text = program.read_text()
    wrote = '(folder / asked.get("file")).write_text("\\n".join(lines) + "\\n")'
    assert wrote in text
    program.write_text(
        text.replace(
            wrote,
            f'text = "\\n".join(lines) + "\\n"\n        {play}\n        (folder / asked.get("file")).write_text(text)',
        )
    )
    simulator = dogbone(tmp_path, program=program)
    found = simulator.simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis])
    assert STATUSES[found.status[0]] == status
    assert told in found.messages[0]
    (kept,) = (tmp_path / "attempts").iterdir()
    assert json.loads((kept / "failure.json").read_text())["parameters"]["E_matrix"] == 20.0


FINER = """
    finer = [a + part * (b - a) for a, b in pairwise(times) for part in (0.4, 0.99)] + [times[-1]]
    at = [max(i for i in range(len(times) - 1) if times[i] <= t) for t in finer]
    slopes = [(pulled[i + 1] - pulled[i]) / (times[i + 1] - times[i]) for i in at]
    pulled = [0.0] + [pulled[i] + slope * (t - times[i]) for i, slope, t in zip(at, slopes, finer)]
    times = [0.0] + finer
"""


def test_a_solver_with_its_own_time_steps_is_interpolated(tmp_path):
    """Without step_points in the template, outputs come at the solver's own times."""
    program = stand_in(tmp_path)
    text = program.read_text()
    assert text.count("    E, nu = number") == 1
    program.write_text(text.replace("    E, nu = number", f"{FINER}\n    E, nu = number"))
    found = dogbone(tmp_path, program=program).simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis])
    exact = dogbone(tmp_path, program=stand_in(tmp_path)).simulate(OWN, BAR, RELAX, OWN.reference[np.newaxis]).force_N
    assert not found.status.any(), found.messages
    assert np.abs(found.force_N - exact).max() < 2e-3 * exact.max()


def test_the_identity_names_all_that_matters(tmp_path):
    one = dogbone(tmp_path)
    others = [
        replace(one, version="2"),
        replace(one, files={"model.feb.j2": "other"}),
        replace(one, outputs=(FORCE,)),
        replace(one, force=None),
        replace(one, ramp_s=1.0),
    ]
    assert len({json.dumps(each.identity(), sort_keys=True) for each in (one, *others)}) == 6
    assert replace(one, timeout_s=1.0, executable="x").identity() == one.identity()


def test_a_protocol_that_starts_displaced_starts_at_rest(tmp_path):
    moved = Protocol("moved", RELAX.time_s, RELAX.displacement_mm + 0.5)
    simulator = replace(dogbone(tmp_path), settle_s=400.0)
    force = simulator.simulate(OWN, BAR, moved, OWN.reference[np.newaxis]).force_N[0]
    still = Protocol("still", RELAX.time_s, np.full(RELAX.time_s.size, 0.5))
    assert np.allclose(force[0], simulator.simulate(OWN, BAR, still, OWN.reference[np.newaxis]).force_N[0], rtol=1e-9)


# ---- the real solver


def febio() -> Path:
    return Path(str(shutil.which("febio4"))).resolve()


@pytest.mark.febio
def test_one_element_by_template_equals_the_built_in_simulator(tmp_path):
    model = Model()
    text = read_template(Path(), None).replace("parameters.", "").replace("constants.beta", "2.0")
    text = text.replace("constants.lambda_0", "1.01")
    own = Model(
        tuple(own_parameter(p.name, p.unit, p.minimum, p.maximum, p.reference) for p in model.parameters),
        law="template",
    )
    force = Logged("force", "N", "max", "node_data", "Rz", (5, 6, 7, 8), None, "sum", 2.0)
    version = solver_version(febio())
    ours = Template(str(febio()), version, {"t": text}, "t", (force,), tmp_path / "a", "force")
    check_template(tmp_path, ours, own, sized=True, moved=True)
    built_in = FEBio(str(febio()), version, read_template(Path(), None), tmp_path / "b")
    rows = np.stack([model.reference, 0.7 * model.reference + 0.3 * np.array([p.maximum for p in model.parameters])])
    specimen = Specimen("bar", 10.0, 8.0, 4.0)
    found = ours.simulate(own, specimen, RELAX, rows)
    expected = built_in.simulate(model, specimen, RELAX, rows)
    assert not found.status.any(), found.messages
    assert np.array_equal(found.force_N, expected.force_N)


@pytest.mark.febio
def test_a_straight_bar_of_many_elements_is_the_analytic_bar(tmp_path):
    """Not clamped and not widened, the dog-bone is a bar in uniaxial tension, whose force is known."""
    text = DOGBONE.read_text().replace("widening = 5.0, 3.0, 1.8", "widening = 5.0, 3.0, 1.0")
    clamped = '    <bc name="clamped" type="zero displacement" node_set="grip"><x_dof>1</x_dof><y_dof>1</y_dof></bc>\n'
    assert clamped in text
    text = text.replace(clamped, "")
    rows = np.array([[20.0, 0.3, 0.8, 8.0], [45.0, 0.42, 0.2, 25.0]])
    curve, keep = Curve(RELAX, np.zeros(RELAX.time_s.size)), np.arange(RELAX.time_s.size)
    exact = dogbone(tmp_path, text).compare(OWN, BAR, curve, rows, keep)
    found = dogbone(tmp_path, text, febio()).compare(OWN, BAR, curve, rows, keep)
    assert not found.status.any(), found.messages
    for name, values in exact.outputs.items():
        assert np.abs(found.outputs[name] - values).max() < 1e-5 * np.abs(values).max(), name


@pytest.mark.febio
def test_the_dogbone_converges_as_its_mesh_is_refined(tmp_path):
    peaks = []
    short = Protocol("pull", np.linspace(0.0, 4.0, 5), np.linspace(0.0, 1.2, 5))
    for fineness in (1, 2, 3):
        text = DOGBONE.read_text().replace("fineness = 1", f"fineness = {fineness}")
        found = dogbone(tmp_path, text, febio()).simulate(OWN, BAR, short, OWN.reference[np.newaxis])
        assert not found.status.any(), found.messages
        peaks.append(found.force_N[0, -1])
    assert abs(peaks[0] - peaks[2]) < 0.02 * peaks[2]
    assert abs(peaks[1] - peaks[2]) < 0.4 * abs(peaks[0] - peaks[2])
    assert peaks[0] > peaks[1] > peaks[2], "displacement elements are too stiff"
