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


def test_words_take_room_by_their_length(monkeypatch):
    monkeypatch.setattr(plots, "MOST_NUMBERS", 200)
    for length, expected in ((1, 9), (100, 6), (500, 1)):
        data = {f"s{number}": {"names": {"x": ["n" * length]}} for number in range(9)}
        assert len(plots.picked("all", "Names.", "Specimen", data, lambda sources: []).data) == expected


def test_a_name_is_neither_html_nor_a_column_where_it_is_shown_at_the_pointer():
    assert plots.words("<b>@x{0} $y</b> & co") == "&lt;b&gt;&#64;x&#123;0} &#36;y&lt;/b&gt; &amp; co"
    assert plots.words("E_f") == "E_f"


def test_of_very_many_things_the_first_are_drawn():
    assert plots.first(range(40), "pairs") == (list(range(40)), "")
    shown, words = plots.first({f"s{i}": i for i in range(1_041)}, "sites")
    assert (len(shown), shown[-1], words) == (40, "s39", " Drawn are the first 40 of 1,041 sites.")
