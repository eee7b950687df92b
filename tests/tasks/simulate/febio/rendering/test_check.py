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
        "long format": (f"<febio_spec><a file='f' format='{'%g' * 130}'/></febio_spec>", "260 characters"),
        "long name": (f"<febio_spec><a name='{'x' * 201}'/></febio_spec>", "201 characters"),
        "long tag": (f"<febio_spec><{'x' * 201}/></febio_spec>", "201 characters"),
        "long plot variable": (f"<febio_spec><var type='u={'x' * 60}'/></febio_spec>", "62 characters"),
        "long surface": (f"<febio_spec><var surface='{'x' * 61}'/></febio_spec>", "61 characters"),
        "long degree of freedom": ("<febio_spec><fix bc='x,xxxx xxxx'/></febio_spec>", "8 characters"),
        "long degrees of freedom": (f"<febio_spec><fix bc='{'x,' * 16}'/></febio_spec>", "32 characters"),
        "degree of freedom in a text": ("<febio_spec><dofs>x,xxxxxxxx</dofs></febio_spec>", "8 characters"),
        "long formula": (f"<febio_spec><math>{'x,' * 251}</math></febio_spec>", "502 characters"),
        "long sum": (f"<febio_spec><math>{'1,' * 251}</math></febio_spec>", "502 characters"),
        "long part of a list": (f"<febio_spec><NodeSet>1,{'1' * 256}</NodeSet></febio_spec>", "256 characters"),
        "list of names": (f"<febio_spec><NodeSet>{'x,' * 251}</NodeSet></febio_spec>", "502 characters"),
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
        "long delimiter": ("<febio_spec><a delim='0123456789abcdef'/></febio_spec>", "16 characters"),
        "long name in a list": (f"<febio_spec><a>x,{'y' * 256},z</a></febio_spec>", "256 characters"),
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
