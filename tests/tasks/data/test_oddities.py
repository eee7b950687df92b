"""Tests that were read and yet look wrong are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.oddities import _hidden_percent, odd_tests
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.model import Curve, Protocol, Specimen

TIME = np.arange(5.0)


def specimen(name: str, strain: float, stress: float) -> Specimen:
    curve = Curve(Protocol("pull", TIME, strain * 10.0 * TIME / 4), stress * 32.0 * TIME / 4)
    return Specimen(name, 10.0, 8.0, 4.0, (curve,))


def test_usual_tests_are_not_odd():
    assert list(odd_tests([specimen("a", 0.05, 10.0), specimen("b", 2e-4, 20.0), specimen("c", 0.1, 0.7)])) == []
    assert list(odd_tests([])) == []


def test_a_test_in_which_nothing_moves_is_named():
    assert list(odd_tests([specimen("a", 6e-6, 10.0)])) == [
        "look at a, pull: its displacement changes by 0.0006 % of the length only; "
        "is it the right column, in the right unit?"
    ]


def test_specimens_that_differ_by_orders_of_magnitude_are_named():
    many = [specimen("a", 0.05, 10.0), specimen("b", 0.05, 11.0), specimen("c", 0.05, -0.01)]
    (line,) = odd_tests(many)
    assert line == ("look at pull: a peak of 11 MPa in b, but 0.01 MPa in c; are the units of force and size the same?")
    (curve,) = many[2].curves
    other = replace(many[2], curves=(replace(curve, protocol=replace(curve.protocol, name="another")),))
    assert list(odd_tests([*many[:2], other])) == [], "another test"


def pulled(force, moved=None):
    """One specimen of 100 points, pulled by 1 mm unless ``moved`` says otherwise."""
    moved = np.linspace(0.0, 1.0, 100) if moved is None else moved
    return Specimen("a", 10.0, 8.0, 4.0, (Curve(Protocol("pull", np.arange(100) / 10, moved), force),))


RAMP = np.linspace(0.0, 100.0, 100)


def test_a_force_that_does_not_begin_at_zero_is_named():
    (line,) = odd_tests([pulled(RAMP + 10.0)])
    assert line == (
        "look at a, pull: its force begins at 10 N (9.1 % of its peak), that of the model at 0; if this is an offset, "
        "use --zero-force first"
    )
    assert list(odd_tests([pulled(RAMP + 4.0)])) == []
    assert list(odd_tests([pulled(RAMP + 10.0, np.linspace(0.2, 1.0, 100))])) == [], "a preload with its strain"


def test_a_break_is_named():
    (line,) = odd_tests([pulled(np.where(np.arange(100) > 90, 60.0, RAMP))])
    assert line.startswith("look at a, pull: its force falls from 89.9 to 60 N from 8.9 to 9.1 s")
    assert "This may be a break, which the model does not describe" in line
    gaps = np.where(np.arange(100) > 90, 60.0, RAMP)
    gaps[:50:2] = np.nan
    assert list(odd_tests([pulled(gaps)])) == [line], "rows without a force are none of the curve's own"
    assert list(odd_tests([pulled(0.0 * RAMP)])) == [], "no force at all"


@pytest.mark.parametrize(
    ("name", "title", "largest", "told"),
    [
        ("a.xls", "Strain [%]", 0.0997, True),
        ("a.XLSB", "Strain [%]", 0.99, True),
        ("a.xls", "Strain [%]", 1.01, False),
        ("a.xlsx", "Strain [%]", 0.0997, False),  # whose formats are read
        ("a.xls", "Strain [mm/mm]", 0.0997, False),
        ("a.xls", "Extension [mm]", 0.0997, False),
    ],
)
def test_small_strains_in_percent_of_a_file_without_formats_are_named(tmp_path, name, title, largest, told):
    path = tmp_path / "a.csv"
    path.write_text(f"Time [s],{title},Force [N]\n" + "".join(f"{i},{largest * i / 4},{i}\n" for i in range(5)))
    (recording,) = read_recordings(path, Hints())
    line = _hidden_percent(replace(recording, path=Path(name)))
    assert bool(line) is told
    if told:
        assert line.startswith(f"'{title}' reaches only {largest} %. Cells of an {Path(name).suffix} file that are")


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("last", [1, 5])
def test_a_displacement_that_jumps_at_the_end_is_named(sign, last):
    moved = sign * np.linspace(0.0, 1.0, 100)
    moved[-last:] = -sign * 1.4
    (line,) = odd_tests([pulled(sign * RAMP, moved)])
    assert line.startswith("look at a, pull: its displacement jumps from ")
    assert f"to {-sign * 1.4:g} mm at {(100 - last) / 10:g} s, at its end" in line


@pytest.mark.parametrize(("step", "named"), [(0.15, False), (0.25, True)])  # 20 usual steps are 0.2 mm
def test_a_jump_at_the_end_is_of_many_usual_steps(step, named):
    moved = np.linspace(0.0, 1.0, 100)
    moved[-1] += step
    assert bool(list(odd_tests([pulled(RAMP, moved)]))) is named


def test_usual_ends_are_not_odd():
    back = np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(1.0, 0.0, 41)[1:]])
    held = np.concatenate([np.linspace(0.0, 1.0, 60), np.full(40, 1.0)])
    for moved in (np.linspace(0.0, 1.0, 100), back, held):
        assert list(odd_tests([pulled(100.0 * moved, moved)])) == []
    jump = np.linspace(0.0, 1.0, 100)
    jump[50:] += 1.0
    assert list(odd_tests([pulled(RAMP, jump)])) == [], "in the midst"
