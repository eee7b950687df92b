"""The figure of PAWN indices."""

from dataclasses import replace

from matplotlib import pyplot as plt

from sinew.tasks.drawing.figures import PANELS
from sinew.tasks.pawn.figures import medians
from tests.tasks.pawn.test_result import result


def test_of_very_many_protocols_the_first_ones_are_drawn():
    one = result()
    figure = medians(replace(one, protocols={f"p{n}": one.protocols["relax"] for n in range(300)}))
    assert len(figure.axes) == PANELS
    plt.close(figure)
