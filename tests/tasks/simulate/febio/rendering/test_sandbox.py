"""What a template may do."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.simulate.febio.rendering.sandbox import rendered, used_names, variables_of
from sinew.tasks.simulate.febio.rendering.wrong import Wrong


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


def test_entities_and_broken_xml_are_refused_with_their_line():
    with pytest.raises(Wrong, match="renders to no XML"):
        render('<!DOCTYPE x [<!ENTITY a "b">]><febio_spec>&a;</febio_spec>')
    with pytest.raises(Wrong) as wrong:
        render("<febio_spec>\n<a></b>\n</febio_spec>")
    assert "<a></b>" in wrong.value.args[1]


def test_names_that_a_template_uses():
    text = "{% set a = E %}{% for i in range(2) %}{{ a * i * nu }}{% endfor %}{{ sqrt(pi) }}"
    assert used_names({"a": text}) == {"E", "nu"}


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
