"""Reading FEBio inputs: where each element stands, and what is refused."""

import re
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.simulate.febio.model_file import source as source_module
from sinew.tasks.simulate.febio.model_file.source import read_source
from tests.effort import at_most
from tests.tasks.simulate.febio.model_file.cube import CUBE


def read(folder, text: str, encoding: str = "latin-1"):
    path = folder / "cube.feb"
    path.write_bytes(text.encode(encoding))
    return read_source(path)


def elements(one):
    yield one
    for child in one.children:
        yield from elements(child)


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (CUBE, "latin-1"),
        (CUBE.replace("ISO-8859-1", "UTF-8"), "utf-8"),
        (CUBE.partition("\n")[2], "utf-8"),
        (CUBE.replace("ISO-8859-1", "UTF-8"), "utf-8-sig"),
        (CUBE.replace("ISO-8859-1", "UTF-16"), "utf-16"),
        (CUBE.replace("\n", "\r\n"), "latin-1"),
    ],
)
def test_each_element_is_where_it_is_said_to_be(tmp_path, text, encoding):
    source = read(tmp_path, text, encoding)
    assert source.version == "4.0"
    for one in elements(source.root):
        whole = source.text[one.start : one.end].decode()
        assert re.match(rf"<{one.tag}\b", whole)
        assert whole.endswith("/>" if one.inside is None else f"</{one.tag}>")
        if one.inside is not None and not one.children and one.tag not in ("Nodes", "Elements", "Surface"):
            inside = source.text[slice(*one.inside)].decode()
            assert inside.strip() == one.text or one.tag == "NodeSet"
    assert source.section("Material").find("material").name == "gel ä"
    assert source.section("Mesh").find("Nodes").children == []


@given(
    st.lists(
        st.sampled_from(["<a/>", "<a></a>", "<b c='>'>", "</b>", "x", "<!-- <b> -->", "<![CDATA[<a>]]>", '<a d="/>"/>'])
    )
)
def test_odd_tags_are_placed_too(tmp_path_factory, parts):
    folder = tmp_path_factory.mktemp("odd")
    text = f'<febio_spec version="4.0"><Material>{"".join(parts)}</Material></febio_spec>'
    try:
        source = read(folder, text, "utf-8")
    except BadInput as error:
        assert "is no XML" in str(error)
        return
    for one in elements(source.root):
        whole = source.text[one.start : one.end].decode()
        assert whole.startswith(f"<{one.tag}")
        assert whole.endswith(("/>", f"</{one.tag}>"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            CUBE.replace('version="4.0"', 'version="2.5"'),
            "is of FEBio's format 2.5; expected format 3.0 or 4.0: open the",
        ),
        (CUBE.replace(' version="4.0"', ""), "does not tell its format; expected format 3.0 or 4.0"),
        ("<febio_optimize/>", "holds <febio_optimize>; expected a FEBio model"),
        (CUBE.replace("<Module", "<!-- -- --><Module"), "line 4 is no XML"),
        (CUBE.replace("<febio_spec", '<!DOCTYPE a [<!ENTITY b "c">]><febio_spec'), "has a document type; expected XML"),
        (CUBE.replace("<Mesh>", '<Mesh from="mesh.feb">'), "<Mesh> reads another file; expected a model in one file"),
        (CUBE.replace("<Boundary>", "<Include>/etc/passwd</Include><Boundary>"), "<Include> reads another file"),
        (CUBE.replace("ISO-8859-1", "rot13"), "is in an unknown encoding (rot13); expected UTF-8"),
        (CUBE.replace("ISO-8859-1", "ascii"), "is not text in ascii"),
        (CUBE.replace("<Globals>", "<Globals>" + 200 * "<a>"), "is nested too deeply"),
    ],
)
def test_what_cannot_be_imported_is_refused_in_one_line(tmp_path, text, words):
    with pytest.raises(BadInput, match=re.escape(words)) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(str(tmp_path / "cube.feb"))


def model(inside: str, declared: str = "") -> str:
    return f'{declared}<febio_spec version="4.0"><Material>{inside}</Material></febio_spec>'


@pytest.mark.parametrize("encoding", ["unicode_escape", "raw_unicode_escape", "utf-7", "punycode", "idna", "zlib"])
def test_encodings_that_no_model_has_are_refused_unread(tmp_path, encoding):
    """Some take time with the square of the text; others give half characters, which no file can hold."""
    declared = f"<?xml version='1.0' encoding='{encoding}'?>"
    text = model("\\ud800+2AA-", declared) + "-" + "a" * 4_000_000
    with at_most(5), pytest.raises(BadInput, match=f"is in an unknown encoding \\({encoding}\\); expected UTF-8"):
        read(tmp_path, text)


@pytest.mark.parametrize("encoding", ["GBK", "Shift_JIS", "windows-1252", "US-ASCII", "ISO-8859-15", "latin1", "UTF8"])
def test_usual_encodings_are_read(tmp_path, encoding):
    assert (
        read(tmp_path, model("<m>1</m>", f"<?xml version='1.0' encoding='{encoding}'?>")).section("Material").children
    )


def test_a_text_between_many_elements_is_read_once(tmp_path):
    with at_most(60):  # with its square, it took many minutes
        source = read(tmp_path, model("x<a/>" * 200_000))
        assert source.section("Material").text == "x" * 200_000


def test_a_tag_of_blanks_takes_no_memory(tmp_path):
    path = tmp_path / "cube.feb"
    path.write_text(model(f"<m{' ' * 2**24}>1</m>"))
    read_source(path)
    tracemalloc.start()
    assert read_source(path).section("Material").find("m").text == "1"
    assert tracemalloc.get_traced_memory()[1] < 2**27, "a place to return to for each blank: 2 GB"
    tracemalloc.stop()


def test_elements_beside_the_mesh_and_their_names_have_limits(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "MOST_ELEMENTS", 10)
    assert len(read(tmp_path, model("<a/>" * 8)).section("Material").children) == 8
    with pytest.raises(BadInput, match="has more than 10 elements beside its mesh"):
        read(tmp_path, model("<a/>" * 9))
    for long in (f"<{'a' * 201}/>", f'<a name="{"a" * 201}"/>'):
        with pytest.raises(BadInput, match="has a name of 201 characters; expected at most 200"):
            read(tmp_path, model(long))


def test_attributes_and_braces_have_limits(tmp_path, monkeypatch):
    many = " ".join(f'a{n}="1=2"' for n in range(5001))
    usual = " ".join(f'a{n}=">"' for n in range(5001))
    comment = f"<!-- {'=' * 20_000} -->"
    assert read(tmp_path, model(f"<a {usual}/>{comment}")).section("Material").children
    for one in (model(f"<a {many}/>"), CUBE.replace("</Nodes>", f"<node {many}/></Nodes>")):
        with pytest.raises(BadInput, match="has an element of 10,000 attributes"):
            read(tmp_path, one)
    monkeypatch.setattr(source_module, "MOST_ATTRIBUTES", 100)
    read(tmp_path, model('<a b="1" c="1"/>' * 49))
    with pytest.raises(BadInput, match="has more than 100 attributes beside its mesh"):
        read(tmp_path, model('<a b="1" c="1"/>' * 51))
    monkeypatch.setattr(source_module, "MOST_BRACES", 10)
    read(tmp_path, model("<!-- {{{{{{{{{{ -->"))
    with pytest.raises(BadInput, match="has 11 braces; expected at most 10"):
        read(tmp_path, model("<!-- {{{{{{{{{{{ -->"))


def test_names_that_the_parser_keeps_have_a_limit_in_a_mesh_too(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "MOST_NAMES", 200)
    read(tmp_path, CUBE)
    nodes = "".join(f'<node id="{n}" a{n}="1">0,0,0</node>' for n in range(200))
    with pytest.raises(BadInput, match="has more than 200 names of tags and attributes"):
        read(tmp_path, CUBE.replace("</Nodes>", f"{nodes}</Nodes>"))


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ("<a>" * 200 + "</a>" * 200, "is nested too deeply"),
        ('<q:quad4 id="1">1,2,3,4</q:quad4>', "<q:quad4> has a name with a prefix"),
        ('<quad4 id="1" q:a="1">1,2,3,4</quad4>', "<quad4> has a name with a prefix"),
    ],
)
def test_what_other_readers_of_xml_refuse_is_refused_in_a_mesh_too(tmp_path, mesh, words):
    assert CUBE.count("</Nodes>") == 1
    with pytest.raises(BadInput, match=words):
        read(tmp_path, CUBE.replace("</Nodes>", f"{mesh}</Nodes>"))


def test_text_beside_the_mesh_has_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(source_module, "MOST_TEXT", 5000)
    inside = CUBE.replace("<Material>", f"<Material>{'long ' * 1000}", 1)
    with pytest.raises(BadInput, match=r"has more than 5,000 characters beside its mesh"):
        read(tmp_path, inside)
    nodes = CUBE.replace("<Nodes", f"<Nodes><!-- -->{'long ' * 1000}</Nodes><Nodes", 1)
    assert nodes != CUBE
    assert read(tmp_path, nodes).version


def test_a_large_model_takes_little_more_memory_than_its_text(tmp_path):
    """One letter that is rare makes Python keep four bytes of each."""
    letters = ("a" * 8000 + "\N{GRINNING FACE}\n") * 250
    text = CUBE.replace("ISO-8859-1", "UTF-8").replace("<Material>", f"<Material><!--{letters}-->", 1)
    tracemalloc.start()
    try:
        read(tmp_path, text, "utf-8")
        used = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    size = (tmp_path / "cube.feb").stat().st_size
    assert size > 2_000_000
    assert used < 9.5 * size  # its bytes, and four times as many while it is decoded, and while it is encoded again
