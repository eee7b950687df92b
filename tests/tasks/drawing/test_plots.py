"""Plots of one of several things."""

import numpy as np

from sinew.tasks.drawing import plots


def test_of_very_many_things_the_first_can_be_picked(monkeypatch):
    monkeypatch.setattr(plots, "MOST_NUMBERS", 200)
    data = {f"s{number}": {"force": {"x": np.arange(40.0)}} for number in range(9)}
    found = plots.picked("all", "Curves.", "Specimen", data, lambda sources: [])
    assert list(found.data) == ["s0", "s1", "s2", "s3"]
    assert found.caption == "Curves. The first 4 of 9 can be picked."
    assert list(plots.picked("one", "Curves.", "Specimen", {"s0": {"x": {"x": np.arange(999.0)}}}, lambda _: []).data)
