"""What is added to a solver's input so that it writes a plot file."""

from xml.etree import ElementTree

import pytest

from sinew.tasks.simulate.febio.plot_request import with_plot_file

START = "<febio_spec version='4.0'><Control><output_level>{}</output_level><plot_level>PLOT_NEVER</plot_level>"
END = "</Control>{}</febio_spec>"


def asked(text: str) -> tuple[list[str], list[str]]:
    """Variables, and the levels of all steps."""
    root = ElementTree.fromstring(with_plot_file(text, ("displacement", "stress")))
    (plot,) = root.iter("plotfile")
    assert plot.attrib == {"type": "febio"}
    return [one.get("type") for one in plot.findall("var")], [one.text for one in root.iter("plot_level")]


@pytest.mark.parametrize(
    ("log", "plot"),
    [("OUTPUT_MUST_POINTS", "PLOT_MUST_POINTS"), ("OUTPUT_MAJOR_ITRS", "PLOT_MAJOR_ITRS"), ("", "PLOT_MAJOR_ITRS")],
)
def test_states_are_written_when_the_log_is(log, plot):
    variables, levels = asked(START.format(log) + END.format(""))
    assert variables == ["displacement", "stress"]
    assert levels == [plot]


def test_variables_of_the_users_own_plot_file_stay_and_every_step_is_asked():
    own = "<plotfile type='vtk' file='x.vtk'><var type='stress'/><var type='contact gap'/></plotfile>"
    steps = "<Step><step id='1'><Control><plot_stride>5</plot_stride></Control></step></Step>"
    text = START.format("OUTPUT_MUST_POINTS") + END.format(f"{steps}<Output>{own}</Output>")
    variables, levels = asked(text)
    assert variables == ["stress", "contact gap", "displacement"]
    assert levels == ["PLOT_MUST_POINTS", "PLOT_MAJOR_ITRS"]
    assert "plot_stride" not in with_plot_file(text, ())
