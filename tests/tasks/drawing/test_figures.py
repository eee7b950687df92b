"""What stands above a figure stays within it."""

import pytest
from matplotlib import pyplot as plt

from sinew.tasks.drawing.figures import STYLE, headline

TEXT = "tendon_relax_RawData_3: PARTLY softening + grip-slip; held-out error 12.31 to 4.05 times the noise (floor 1.00)"


@pytest.mark.parametrize("width", [2.4, 3.6, 9.0])
@pytest.mark.parametrize("size", [9, 10])
def test_a_headline_is_no_wider_than_its_figure(width, size):
    with plt.rc_context(STYLE):
        figure, _ = plt.subplots(figsize=(width, 3.0))
        headline(figure, f"{TEXT}. Grey: twice the noise", size)
        figure.canvas.draw()
        box = figure._suptitle.get_window_extent()
        assert 0.0 <= box.x0 <= box.x1 <= figure.bbox.width
        assert figure._suptitle.get_text().replace("\n", " ") == f"{TEXT}. Grey: twice the noise"
        plt.close(figure)


def test_lines_stay_lines():
    figure = plt.figure(figsize=(9.0, 3.0))
    headline(figure, "Effects on the force\n40 trajectories")
    assert figure._suptitle.get_text() == "Effects on the force\n40 trajectories"
    plt.close(figure)
