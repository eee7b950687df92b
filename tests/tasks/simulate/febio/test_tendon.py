"""The tendon's template: its numbers, its sandbox, and what is refused when it is read."""

import struct
from pathlib import Path

import defusedxml.ElementTree
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.model import Model, Protocol, Specimen
from sinew.tasks.simulate.febio import files
from sinew.tasks.simulate.febio.rendering.sandbox import Compiled, rendered
from sinew.tasks.simulate.febio.rendering.wrong import Wrong
from sinew.tasks.simulate.febio.tendon import TendonTemplate, read_template
from tests.tasks.simulate.febio.fake_solver import BAR, PULL, TEMPLATE


def bits(numbers) -> list[bytes]:
    return [struct.pack("<d", float(number)) for number in numbers]


COMPILED = Compiled()


def render(text, model, specimen, times, displacements, values) -> str:
    """The input for one parameter set, rendered in this process."""
    template = TendonTemplate(text)
    variables = template.variables(model, specimen, Protocol("any", times, displacements), values, times, displacements)
    return rendered(template.files, template.main, variables, COMPILED)[0]


finite = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(min_value=0.0, exclude_min=True, allow_nan=False, allow_infinity=False)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(finite, min_size=16, max_size=16),
    st.tuples(positive, positive, positive),
    st.lists(st.tuples(st.floats(-1e300, 1e300), finite), min_size=2, max_size=6),
    st.tuples(positive, positive),
)
def test_numbers_of_the_input_read_back_to_the_same_bits(values, sizes, history, constants):
    model = Model(beta=constants[0], lambda_0=constants[1])
    specimen = Specimen("any", *sizes)
    times, displacements = np.array(history).T
    root = defusedxml.ElementTree.fromstring(render(TEMPLATE, model, specimen, times, displacements, np.array(values)))
    matrix, fibre = root.iterfind("./Material/material/solid")
    read = {}
    for solid, letter in ((matrix, "m"), (fibre, "f")):
        read |= {f"g_{n}{letter}": solid.findtext(f"g{n}") for n in (1, 2, 3)}
        read |= {f"tau_{n}{letter}": solid.findtext(f"t{n}") for n in (1, 2, 3)}
        read[f"E_{letter}"] = solid.findtext("elastic/E")
    read |= {"nu_m": matrix.findtext("elastic/v"), "alpha_f": fibre.findtext("elastic/alpha")}
    assert bits(read[name] for name in model.names) == bits(values)
    assert bits([fibre.findtext("elastic/beta"), fibre.findtext("elastic/lam0")]) == bits(constants)
    moved, stops = ([pt.text.split(",") for pt in lc.iter("pt")] for lc in root.iterfind("./LoadData/load_controller"))
    assert bits(at for at, _ in moved) == bits(at for at, _ in stops) == bits(times)
    assert bits(moved for _, moved in moved) == bits(displacements)
    assert bits([root.findtext("Control/final_time")]) == bits(times[-1:])
    assert bits([root.findtext("Control/step_size")]) == bits([times[1] - times[0]])
    nodes = np.array([[float(word) for word in node.text.split(",")] for node in root.iterfind("Mesh/Nodes/node")])
    corner = [specimen.width_mm / 2, specimen.thickness_mm, specimen.length_mm]
    assert bits(nodes.max(axis=0)) == bits(corner)
    assert set(nodes.ravel().tolist()) == {0.0, *corner}


def test_unknown_variables_are_errors(model):
    for text in (
        "{{ parameters.nonsense }}",
        "{{ nonsense }}",
        "{% if nonsense %}{% endif %}",
        "{{ constants['no'] }}",
    ):
        with pytest.raises(Wrong, match=r"undefined|has no"):
            render(text, model, BAR, PULL.time_s, PULL.displacement_mm, model.reference)


def template(folder: Path, text: str) -> str:
    (folder / "input.feb.j2").write_text(text)
    return "input.feb.j2"


def inside(text: str) -> str:
    return f"<febio_spec>{text}</febio_spec>"


@pytest.mark.parametrize(
    "trick",
    [
        "{{ ''.__class__.__mro__ }}",
        "{{ parameters.__class__.__base__.__subclasses__() }}",
        "{{ ''['__class__'] }}",
        "{{ '' | attr('__class__') }}",
        "{{ '{0.__class__}'.format(1) }}",
        "{{ '{0.__class__}' | format }}{{ ''.format.__self__ }}",
        "{{ self.__init__.__globals__ }}",
        "{{ cycler.__init__.__globals__.os.popen('id').read() }}",
        "{{ lipsum.__globals__['os'].popen('id').read() }}",
        "{{ namespace.__init__.__globals__ }}",
        "{% include '/etc/passwd' %}",
        "{% import '/etc/passwd' as x %}",
        "{% extends '/etc/passwd' %}",
        "{% for n in range(10**9) %}x{% endfor %}",
    ],
)
def test_templates_cannot_leave_their_sandbox(tmp_path, trick):
    with pytest.raises(BadInput, match=r"cannot be rendered|No filter named"):
        read_template(tmp_path, template(tmp_path, inside(trick)))


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (inside("{{ parameters.nonsense | full }}"), "nonsense"),
        (inside("{{ nonsense }}"), "nonsense"),
        (inside("\n\n{{ 1 + }}"), "line 3"),
        (inside("{% if %}"), "line 1"),
        (inside("{{ 1 | nonsense }}"), "nonsense"),
        (inside("{{ 'word' | full }}"), "'word'"),
        (inside("{{ true | full }}"), "True"),
        (inside("{{ 1 / 0 }}"), "cannot be rendered"),
        (inside("{{ [].pop() }}"), "cannot be rendered"),
        (inside("{% macro again() %}{{ again() }}{% endmacro %}{{ again() }}"), "cannot be rendered"),
        ("", "no XML"),
        ("no XML", "no XML"),
        ("<febio_spec>", "no XML"),
        ("<febio_spec/><febio_spec/>", "no XML"),
        (inside("\x0c"), "no XML"),
        ("<other/>", "<other>"),
        ('<!DOCTYPE x [<!ENTITY a "aaaa">]>' + inside("&a;"), "no XML"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>' + inside("&a;"), "no XML"),
    ],
)
def test_templates_are_checked_before_they_are_used(tmp_path, text, problem):
    with pytest.raises(BadInput) as caught:
        read_template(tmp_path, template(tmp_path, text))
    message = str(caught.value)
    assert "input.feb.j2" in message
    assert problem in message
    assert "\n" not in message


@pytest.mark.parametrize("name", ["/etc/passwd", "../reaction.txt", "folder/reaction.txt", "..", ".", "", "folder/"])
@pytest.mark.parametrize("attribute", ["file", "from"])
def test_files_outside_the_attempt_are_refused(tmp_path, name, attribute):
    text = TEMPLATE.replace('file="reaction.txt"', f'{attribute}="{name}"')
    with pytest.raises(BadInput, match="a file name without a folder"):
        read_template(tmp_path, template(tmp_path, text))


@pytest.mark.parametrize("element", ["<Include>/tmp/other.feb</Include>", "<Include> ../../other.feb </Include>"])
def test_including_files_outside_the_attempt_is_refused(tmp_path, element):
    """febio4 reads an included file wherever it is, and writes what that file's own file= attributes name."""
    with pytest.raises(BadInput):
        read_template(tmp_path, template(tmp_path, TEMPLATE.replace("<Output>", f"{element}<Output>")))


def test_a_template_stays_inside_the_studys_folder(tmp_path):
    folder = tmp_path / "study"
    folder.mkdir()
    (tmp_path / "outside.j2").write_text(TEMPLATE)
    (folder / "link.j2").symlink_to(tmp_path / "outside.j2")
    for name in ("../outside.j2", str(tmp_path / "outside.j2"), "link.j2"):
        with pytest.raises(BadInput, match="outside"):
            read_template(folder, name)


def test_a_template_that_cannot_be_read(tmp_path, monkeypatch):
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    (tmp_path / "folder").mkdir()
    for name, problem in (("nothing", "is not there"), ("folder", "is a folder"), ("binary", "not a text file")):
        with pytest.raises(BadInput, match=f"{name}: {problem}"):
            read_template(tmp_path, name)
    monkeypatch.setattr(files, "MAX_TEMPLATE_BYTES", 2**20)
    with pytest.raises(BadInput, match="5 MB"):
        read_template(tmp_path, template(tmp_path, " " * 5 * 2**20))


def test_a_template_of_ones_own(tmp_path):
    text = TEMPLATE.replace("tendon", "tissue")
    assert read_template(tmp_path, template(tmp_path, text)).text == text
