"""A model as FEBio Studio would save it: a cube of one element, pulled at its top face."""

import re

CUBE = """<?xml version="1.0" encoding="ISO-8859-1"?>
<!-- {{ no variable }} -->
<febio_spec version="4.0">
\t<Module type="solid"/>
\t<Control>
\t\t<analysis>STATIC</analysis>
\t\t<time_steps>10</time_steps>
\t\t<step_size>0.1</step_size>
\t\t<plot_level>PLOT_NEVER</plot_level>
\t\t<solver type="solid">
\t\t\t<symmetric_stiffness>symmetric</symmetric_stiffness>
\t\t</solver>
\t</Control>
\t<Globals><Constants><T>298</T></Constants></Globals>
\t<Material>
\t\t<material id="1" name="gel \u00e4" type="viscoelastic">
\t\t\t<t1>2.50</t1>
\t\t\t<g1>.5</g1>
\t\t\t<elastic type="neo-Hookean">
\t\t\t\t<density>1</density>
\t\t\t\t<E lc="1">1e1</E>
\t\t\t\t<v>0.3</v>
\t\t\t\t<mat_axis type="vector"><a>1,0,0</a><d>0, 1, 0</d></mat_axis>
\t\t\t\t<map type="math">{X}*2</map>
\t\t\t</elastic>
\t\t</material>
\t</Material>
\t<Mesh>
\t\t<Nodes name="cube">
\t\t\t<node id="1">0,0,0</node><node id="2">2,0,0</node><node id="3">2,2,0</node><node id="4">0,2,0</node>
\t\t\t<node id="5">0,0,2</node><node id="6">2,0,2</node><node id="7">2,2,2</node><node id="8">0,2,2</node>
\t\t</Nodes>
\t\t<Elements type="hex8" name="part"><elem id="1">1,2,3,4,5,6,7,8</elem></Elements>
\t\t<NodeSet name="bottom">
\t\t\t1,2,
\t\t\t3,4
\t\t</NodeSet>
\t\t<Surface name="top"><quad4 id="1">5,6,7,8</quad4></Surface>
\t</Mesh>
\t<MeshDomains><SolidDomain name="part" mat="gel \u00e4"/></MeshDomains>
\t<Boundary>
\t\t<bc name="base" type="zero displacement" node_set="bottom">
\t\t\t<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof>
\t\t</bc>
\t\t<bc name="pull" type="prescribed displacement" node_set="@surface:top">
\t\t\t<dof>z</dof>
\t\t\t<value lc="2">0.4</value>
\t\t\t<relative>0</relative>
\t\t</bc>
\t</Boundary>
\t<LoadData>
\t\t<load_controller id="1" type="loadcurve">
\t\t\t<interpolate>LINEAR</interpolate><points><pt>0,1</pt><pt>1,1</pt></points>
\t\t</load_controller>
\t\t<load_controller id="2" type="loadcurve">
\t\t\t<interpolate>LINEAR</interpolate><extend>CONSTANT</extend><points><pt>0,0</pt><pt>0.5,1</pt></points>
\t\t</load_controller>
\t</LoadData>
</febio_spec>
"""
SOLVABLE = re.sub(r"\t*<(map|mat_axis).*?</\1>\n", "", CUBE)
"""The cube without what FEBio would not read in a neo-Hookean material."""


def in_format_3(text: str) -> str:
    """The same in format 3.0."""
    text = text.replace('version="4.0"', 'version="3.0"').replace(
        "\n\t\t\t1,2,\n\t\t\t3,4\n\t\t", '<n id="1"/><n id="2"/>'
    )
    text = text.replace('type="prescribed displacement"', 'type="prescribe"')
    text = text.replace('<solver type="solid">', "<solver>")
    return text.replace('<value lc="2">0.4</value>', '<scale lc="2">0.4</scale>')
