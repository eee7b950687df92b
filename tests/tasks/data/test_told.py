"""Displacements that a machine has set to zero again, as a person says that they count."""

import numpy as np
import pytest

from sinew.tasks.data.curves import Bar, curve_of
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.told import as_told


def test_after_a_preload_the_gauge_length_is_that_at_the_new_zero(tmp_path):
    before = [f"{i},{12.5 + 0.1 * i:g},{0.1 * i:g},{i}" for i in range(50)]
    after = [f"{50 + i},{17.5 + 0.1 * i:g},{0.1 * i:g},{50 + i}" for i in range(50)]
    path = tmp_path / "lengths.csv"
    path.write_text("\n".join(["Time_S,Size_mm,Displacement_mm,Force_N", *before, *after, ""]))
    (one,) = read_recordings(path, Hints())
    assert "length" not in one.sizes
    (doubt,) = as_told(one, Hints()).doubts
    assert doubt.text.endswith("; the gauge length is 17.5 mm without these rows, 12.5 mm with them")
    assert as_told(one, Hints(preload="leave-out")).sizes["length"].mm == pytest.approx(17.5)


@pytest.mark.parametrize(("title", "further_mm"), [("Size_mm", 5.0), ("Note", 4.9)])
def test_a_preload_that_is_kept_is_followed_by_what_comes_on_top_of_it(tmp_path, title, further_mm):
    """By the lengths at both zeros, where a column tells them, else from the row before."""
    before = [f"{i},{12.5 + 0.1 * i:g},{0.1 * i:g},{i}" for i in range(50)]
    after = [f"{50 + i},{17.5 + 0.1 * i:g},{0.1 * i:g},{50 + i}" for i in range(50)]
    path = tmp_path / "lengths.csv"
    path.write_text("\n".join([f"Time_S,{title},Displacement_mm,Force_N", *before, *after, ""]))
    (one,) = read_recordings(path, Hints())
    found = as_told(one, Hints(preload="keep"))
    assert found.numbers[[49, 50, 99], 1] == pytest.approx([4.9, further_mm, 4.9 + further_mm])
    note = f"displacement counted on by {further_mm:g} mm after the first 50 rows, where it was set to zero again"
    assert (found.notes, found.doubts) == ((note,), ())
    assert ("length" in found.sizes) == (title == "Size_mm")
    if title == "Size_mm":
        assert found.sizes["length"].mm == pytest.approx(12.5)


def test_a_jump_that_is_not_to_zero_stays_as_it_is(tmp_path):
    """A slack specimen is pulled taut in one row: the displacement jumps, and the force stays."""
    moved = [0.001 * i for i in range(10)] + [3.0 + 0.01 * i for i in range(300)]
    force = [0.0] * 11 + [0.1 * i for i in range(299)]
    path = tmp_path / "slack.csv"
    rows = "".join(f"{i},{u:g},{f:g}\n" for i, (u, f) in enumerate(zip(moved, force, strict=True)))
    path.write_text(f"Time (s),Extension (mm),Load (N)\n{rows}")
    (one,) = read_recordings(path, Hints())
    assert [doubt.option for doubt in as_told(one, Hints()).doubts] == ["--preload"]
    found = as_told(one, Hints(preload="keep"))
    assert found.numbers[:, 1] == pytest.approx(moved)
    assert found.notes == ("the displacement jumps after 10 rows, but not to zero, and stays as it is",)


def test_a_strain_that_is_kept_with_its_preload_stays_as_it_is(tmp_path):
    path = tmp_path / "strains.csv"
    path.write_text("Time (s),Strain (%),Load (N)\n" + "".join(f"{i},{i % 50},{i}\n" for i in range(100)))
    (one,) = read_recordings(path, Hints())
    found = as_told(one, Hints(preload="keep"))
    assert np.array_equal(found.numbers, one.numbers)
    assert found.notes == ("the strain is set to zero again after 50 rows, and stays as it is",)


def test_positions_are_displacements_if_a_person_says_so(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Position (mm),Force (N)\n" + "".join(f"{i},{5 + i},{i}\n" for i in range(9)))
    bar = Bar(50.0, 1.0, 1.0)
    for said, first in ((None, 0.0), ("first", 0.0), ("none", 5.0)):
        hints = Hints(zero_displacement=said)
        told = as_told(read_recordings(path, hints)[0], hints)
        assert curve_of(told, bar, "test").protocol.displacement_mm[0] == first
        assert any("positions, likely to count from the first one, 5 mm" in one for one in remarks(told)) == (
            first == 0
        )
