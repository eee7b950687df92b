"""What stands above a figure stays within it; files of figures have one layout and follow no link."""

import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.layout_engine import PlaceHolderLayoutEngine

from sinew.tasks.drawing.figures import STYLE, headline, save

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


def test_links_are_replaced_and_not_followed(tmp_path):
    outside = {kind: tmp_path / f"mine.{kind}" for kind in ("png", "pdf", "csv")}
    for kind, path in outside.items():
        path.write_text("mine")
        (tmp_path / "figures").mkdir(exist_ok=True)
        (tmp_path / "figures" / f"a.{kind}").symlink_to(path)
    figure = plt.figure(figsize=(2.0, 1.0))
    written = save(figure, tmp_path / "figures", "a", pd.DataFrame({"x": [1.0]}))
    assert [path.read_text() for path in outside.values()] == ["mine"] * 3
    assert [path.is_symlink() for path in written] == [False] * 3
    assert written[2].read_text() == "x\n1\n"


def test_both_drawings_have_one_layout(tmp_path):
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(3.0, 2.0))
        axes.set_ylabel("a label\nof two lines")
        before = axes.get_position().bounds
        save(figure, tmp_path, "a", pd.DataFrame())
        assert axes.get_position().bounds != before, "there is room for the label"
        assert isinstance(figure.get_layout_engine(), PlaceHolderLayoutEngine), "it is not looked for again"
