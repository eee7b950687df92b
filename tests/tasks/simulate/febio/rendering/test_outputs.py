"""Outputs in a rendered input."""

from xml.etree.ElementTree import fromstring

import pytest

from sinew.tasks.simulate.febio.rendering.outputs import add_outputs
from sinew.tasks.simulate.febio.rendering.wrong import Wrong

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
    root = fromstring(MESH.format(section))
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
        add_outputs("a", fromstring(MESH.format("")), [output])
    assert wrong.value.args[0] == "simulator.outputs.q"
    assert told in wrong.value.args[1]
