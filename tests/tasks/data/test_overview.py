"""The figure of a new study's tests: as many as fit, whatever they hold."""

import numpy as np
import pytest
from matplotlib import image

from sinew.tasks.data import overview
from sinew.tasks.data.overview import draw_overview
from sinew.tasks.model import Curve, Protocol, Specimen


def specimen(name: str, curves: int) -> Specimen:
    time_s = np.linspace(0.0, 20.0, 81)
    displacement = np.interp(time_s, [0, 5, 10, 15, 20], [0, 1, 1, 0.5, 1.5])
    return Specimen(
        name, 10.0, 8.0, 4.0,
        tuple(Curve(Protocol(f"p{i}", time_s, displacement * (i + 1)), displacement * 3.0) for i in range(curves)),
    )  # fmt: skip


@pytest.mark.parametrize(("curves", "drawn"), [(1, 1), (4, 4), (6, 4)])
def test_the_first_tests_are_drawn(tmp_path, monkeypatch, curves, drawn):
    monkeypatch.setattr(overview, "MOST_TESTS", 4)
    path = tmp_path / "tests.png"
    assert draw_overview(path, [specimen("$T_1", curves)]) == drawn
    pixels = image.imread(path)
    pixels = np.round(pixels[..., :3] * 255).astype(int).reshape(-1, 3)
    colours = {tuple(pixel) for pixel in np.unique(pixels, axis=0).tolist()}
    assert {(0, 114, 178), (213, 94, 0), (0, 158, 115)} <= colours, "load, unload and hold"


def test_equal_tests_give_equal_bytes(tmp_path):
    for name in "ab":
        draw_overview(tmp_path / f"{name}.png", [specimen("T1", 2)])
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
