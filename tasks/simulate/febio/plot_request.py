"""Asking the solver for a plot file: what is added to its input where the fields of a run are read."""

from xml.etree.ElementTree import Element, SubElement

from sinew.tasks.simulate.febio.input_text import as_text, parsed
from sinew.tasks.simulate.febio.rendering.outputs import part_of

PLOT = "model.xplt"  # the solver names it after its input


def with_plot_file(text: str, variables: tuple[str, ...]) -> str:
    """The input ``text`` with a plot file of ``variables`` and of those that it asks for itself.

    Where the log is written at must points only, so are the states, at the same times; else each step has one. Raises
    :class:`Failed`.
    """
    root = parsed(text)
    for control in root.iter("Control"):
        _set_levels(control)
    plot = part_of(part_of(root, "Output"), "plotfile")
    plot.attrib.clear()
    plot.set("type", "febio")  # not in the format of another program, and not in another file
    there = {variable.get("type") for variable in plot.findall("var")}
    for name in variables:
        if name not in there:
            SubElement(plot, "var", type=name)
    return as_text(root)


def _set_levels(control: Element) -> None:
    for name in ("plot_level", "plot_stride", "plot_range", "plot_zero_state"):
        for found in control.findall(name):
            control.remove(found)
    must = control.findtext("output_level", "").strip() == "OUTPUT_MUST_POINTS"
    SubElement(control, "plot_level").text = "PLOT_MUST_POINTS" if must else "PLOT_MAJOR_ITRS"
