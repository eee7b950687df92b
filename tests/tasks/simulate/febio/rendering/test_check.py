"""What a rendered input may hold."""

from xml.etree.ElementTree import fromstring

import pytest

from sinew.tasks.simulate.febio.rendering.check import check
from sinew.tasks.simulate.febio.rendering.wrong import Wrong


@pytest.mark.parametrize(
    ("body", "told"),
    {
        "no FEBio": ("<html/>", "<html>"),
        "include": ("<febio_spec><Include>a.feb</Include></febio_spec>", "<Include>"),
        "namespace": ('<febio_spec><a xmlns="u"><Include>a.feb</Include></a></febio_spec>', "<{u}a> has a namespace"),
        "namespace of an attribute": ("<febio_spec xmlns:x='u' x:a='1'/>", "<{u}a> has a namespace"),
        "bytes of a name": (f"<febio_spec><a name='{'é' * 101}'/></febio_spec>", "202 bytes"),
        "bytes of a tag": (f"<febio_spec><{'é' * 101}/></febio_spec>", "202 bytes"),
        "bytes of a delimiter": ("<febio_spec><a delim='éééééééé'/></febio_spec>", "16 bytes"),
        "bytes of a degree of freedom": ("<febio_spec><dofs>éééé</dofs></febio_spec>", "8 bytes"),
        "bytes of a part": (f"<febio_spec><a>x,{'é' * 128},x</a></febio_spec>", "256 bytes"),
        "bytes of a formula": (f"<febio_spec><a>{'é,' * 167}</a></febio_spec>", "501 bytes"),
        "blanks of a part": (f"<febio_spec><a>x,{' ' * 256},x</a></febio_spec>", "256 bytes"),
        "blanks behind a formula": (f"<febio_spec><a>x{' ' * 255}</a></febio_spec>", "256 bytes"),
        "other blanks alone": (f"<febio_spec><a>{chr(0x3000) * 100}</a></febio_spec>", "300 bytes"),
        "other blanks in a degree of freedom": (
            "<febio_spec><a bc='x\u00a0\u00a0\u00a0\u00a0'/></febio_spec>",
            "9 bytes",
        ),
        "replacements": ("<febio_spec><E type='math'>a=bb;a+a</E></febio_spec>", "holds ';'"),
        "replacements in a name": ("<febio_spec><E name='a=bb;a+a'/></febio_spec>", "holds ';'"),
        "replacements in an attribute": ("<febio_spec><E value='a=bb;a+a'/></febio_spec>", "holds ';'"),
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
        "long format": (f"<febio_spec><a file='f' format='{'%g' * 130}'/></febio_spec>", "260 bytes"),
        "long name": (f"<febio_spec><a name='{'x' * 201}'/></febio_spec>", "201 bytes"),
        "long tag": (f"<febio_spec><{'x' * 201}/></febio_spec>", "201 bytes"),
        "long plot variable": (f"<febio_spec><var type='u={'x' * 60}'/></febio_spec>", "62 bytes"),
        "long surface": (f"<febio_spec><var surface='{'x' * 61}'/></febio_spec>", "61 bytes"),
        "long degree of freedom": ("<febio_spec><fix bc='x,xxxx xxxx'/></febio_spec>", "8 bytes"),
        "long degrees of freedom": (f"<febio_spec><fix bc='{'x,' * 16}'/></febio_spec>", "32 bytes"),
        "degree of freedom in a text": ("<febio_spec><dofs>x,xxxxxxxx</dofs></febio_spec>", "8 bytes"),
        "long formula": (f"<febio_spec><math>{'x,' * 251}</math></febio_spec>", "502 bytes"),
        "long sum": (f"<febio_spec><math>{'1,' * 251}</math></febio_spec>", "502 bytes"),
        "long part of a list": (f"<febio_spec><NodeSet>1,{'1' * 256}</NodeSet></febio_spec>", "256 bytes"),
        "list of names": (f"<febio_spec><NodeSet>{'x,' * 251}</NodeSet></febio_spec>", "502 bytes"),
        "instruction": ("<febio_spec><a name='%n'/></febio_spec>", "a name> holds '%'"),
        "instruction in a text": ("<febio_spec><a>%</a></febio_spec>", "<a> holds '%'"),
        "instruction behind an element": ("<febio_spec><a/>%s</febio_spec>", "holds '%'"),
        "format of the log": ("<febio_spec><a format='%g'/></febio_spec>", "a format> holds '%'"),
        "format of a file": ("<febio_spec><a file='f' format='%g %n'/></febio_spec>", "%i, %g, %l or %t"),
        "half a format": ("<febio_spec><a file='f' format='%g%'/></febio_spec>", "%i, %g, %l or %t"),
        "doubled percent": ("<febio_spec><a file='f' format='%%g'/></febio_spec>", "%i, %g, %l or %t"),
        "endless range": ("<febio_spec><a>1,1:2:0</a></febio_spec>", "has 1:2:0"),
        "range backwards": ("<febio_spec><a>1 : 2 : -1</a></febio_spec>", "has 1 : 2 : -1"),
        "long range": ("<febio_spec><a>1:5000001,1:5000001</a></febio_spec>", "at most 10,000,000 ids"),
        "range to the largest number": ("<febio_spec><a>2147483640:2147483647</a></febio_spec>", "ranges of at most"),
        "file of a run": ("<febio_spec><a file='sinew-0.txt'/></febio_spec>", "a run's own files"),
        "input of a run": ("<febio_spec><a file='model.feb'/></febio_spec>", "a run's own files"),
        "long delimiter": ("<febio_spec><a delim='0123456789abcdef'/></febio_spec>", "16 bytes"),
        "long name in a list": (f"<febio_spec><a>x,{'y' * 256},z</a></febio_spec>", "256 bytes"),
        "drive": ("<febio_spec><image>C:\\x</image></febio_spec>", "names a path"),
    }.values(),
)
def test_what_a_solver_must_not_read_is_refused(body, told):
    with pytest.raises(Wrong) as wrong:
        check("a", fromstring(body))
    assert told in " ".join(wrong.value.args)


def test_what_models_have_is_read():
    parts = (
        f"<NodeSet name='{'n' * 200}'>{'12,' * 10_000}1:9000000:2</NodeSet><meta>{'x' * 255}</meta>",
        f"<node_data data='x;y;z' name='a' file='out.txt' format='%i%t%g %l'>{'5,' * 999}1</node_data>",
        f"<math>{'t+' * 127}t</math><bc type='prescribed'><dof>x</dof></bc><fix bc='x, y,z,u,v,w'/>",
        f"<var type='displacement={'u' * 40}'/>\n{' ' * 999}<c_dofs>x, y</c_dofs><a>12:30</a>",
    )
    for part in parts:
        check("a", fromstring(f"<febio_spec>{part}</febio_spec>"))


def test_blanks_between_elements_are_shortened():
    root = fromstring(f"<febio_spec>{' ' * 101}<E> 1 </E>{chr(10) * 101}<a>{' ' * 100}</a></febio_spec>")
    check("a", root)
    assert (root.text, root[0].text, root[0].tail, root[1].text) == ("\n", " 1 ", "\n", " " * 100)
