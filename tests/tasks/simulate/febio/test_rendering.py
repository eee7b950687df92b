"""What a template may do, and what the rendering program adds and refuses."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.simulate.febio.rendering import Wrong, add_outputs, answer, check, rendered, used_names, variables_of


def render(text: str, **variables):
    return rendered({"a": text}, "a", variables)[1]


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
        "include of a namespace": ('<febio_spec><a xmlns="u"><Include>a.feb</Include></a></febio_spec>', "<Include>"),
        "path behind an element": ("<febio_spec><image><a/>/etc/x</image></febio_spec>", "names a path"),
        "from": ('<febio_spec><Mesh from="a.feb"/></febio_spec>', "Mesh from"),
        "file above": ('<febio_spec><x file="../x"/></febio_spec>', "x file"),
        "file elsewhere": ('<febio_spec><x file="/etc/x"/></febio_spec>', "x file"),
        "path in a text": ("<febio_spec><image> /etc/x</image></febio_spec>", "names a path"),
        "path above in a text": ("<febio_spec><image>a/../../x</image></febio_spec>", "names a path"),
        "another model": ("<febio_spec><RVE>inner.feb</RVE></febio_spec>", "<RVE>"),
        "skipped character": ("<febio_spec><image>.&#13;./x</image></febio_spec>", "holds '\\r'"),
        "skipped in an attribute": ('<febio_spec><x name="a&#13;b"/></febio_spec>', "holds '\\r'"),
        "tag for FEBio": ("<febio_spec><a>&lt;/a&gt;</a></febio_spec>", "holds '<'"),
        "tag behind an element": ("<febio_spec><a/>&lt;b/&gt;</febio_spec>", "holds '<'"),
        "attribute for FEBio": ("<febio_spec><a x='1\" file=\"/etc/x'/></febio_spec>", "holds '\"'"),
        "long format": (f"<febio_spec><a format='{'%g' * 130}'/></febio_spec>", "260 characters"),
        "long delimiter": ("<febio_spec><a delim='0123456789abcdef'/></febio_spec>", "16 characters"),
        "long name in a list": (f"<febio_spec><a>x,{'y' * 256},z</a></febio_spec>", "256 characters"),
        "drive": ("<febio_spec><image>C:\\x</image></febio_spec>", "names a path"),
    }.values(),
)
def test_what_could_name_a_file_is_refused(body, told):
    with pytest.raises(Wrong) as wrong:
        check("a", render(body))
    assert told in " ".join(wrong.value.args)


@pytest.mark.parametrize("outputs", [None, []])
def test_nothing_is_passed_on_that_was_not_looked_at(outputs):
    """FEBio ends an instruction behind ``?`` and ``&gt;``, which XML does not: the rest would be read by FEBio only."""
    hidden = "<x file='/etc/x'/>"
    body = f"<?x ?&gt;{hidden}<?y ?><!-- &gt;{hidden} --><a>1 &amp; 2</a>"
    job = {"main": "a", "renders": [{}], "outputs": outputs, "texts": True}
    (text,) = answer(job, {"a": f"<febio_spec>{body}</febio_spec>"})["texts"]
    start, _, rest = text.partition("\n")
    assert start == '<?xml version="1.0" encoding="UTF-8"?>'
    assert (
        rest.startswith("<febio_spec><a>1 &amp; 2</a>") and "etc" not in rest and "<?" not in rest and "<!" not in rest
    )


def test_long_texts_of_numbers_are_no_names():
    check("a", render(f"<febio_spec><a>{'1 2 ' * 1000}</a><b>{'1.25,' * 1000}</b><c>{'x' * 300}</c></febio_spec>"))


def test_entities_and_broken_xml_are_refused_with_their_line():
    with pytest.raises(Wrong, match="renders to no XML"):
        render('<!DOCTYPE x [<!ENTITY a "b">]><febio_spec>&a;</febio_spec>')
    with pytest.raises(Wrong) as wrong:
        render("<febio_spec>\n<a></b>\n</febio_spec>")
    assert "<a></b>" in wrong.value.args[1]


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
        answer({"main": "a", "known": ["E"], "renders": []}, {"a": text})


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("{{ p }} {{ E }}", ["E", "p"]),
        ("{{ p }}{{ p }}", ["p"]),
        ("{{ p | replace('a', 'b') }}{{ E }}", ["E"]),
        ("{{ p }}{{ p | length }}", []),
        ("{% if p %}{% endif %}{{ p }}", []),
        ("{% for i in [1, 2] %}{{ p }}{% endfor %}", []),
        ("{% set q %}{{ p }}{% endset %}{{ q | trim }}", []),
        ("{% set q = p %}{{ p }}", []),
        ("{% macro m() %}{{ p }}{% endmacro %}{{ m() }}", []),
        ("{% filter replace('1', '2') %}{{ p }}{% endfilter %}", []),
        ("{{ p }}{% include 'b' %}", []),
        ("{{ p ~ 'a' }}", []),
        ("{{ p[0] }}", []),
    ],
)
def test_variables_that_are_only_printed_are_known(text, printed):
    found = variables_of("a", {"a": text, "b": "{{ p }}" if "'b'" in text else ""})
    assert found["printed"] == printed
    assert set(printed) <= set(found["used"])
    assert "p" in found["used"]
