"""Tests that were read and yet look wrong are named."""

from dataclasses import replace

import numpy as np

from sinew.tasks.data.oddities import odd_tests
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


def test_tests_of_one_specimen_with_opposite_signs_are_named():
    (one,), (other,) = pulled(RAMP).curves, pulled(-RAMP).curves
    relax = replace(other, protocol=replace(other.protocol, name="relax"))
    (line,) = odd_tests([replace(pulled(RAMP), curves=(one, relax))])
    assert line.startswith(
        "look at a: where the displacement is largest, the force of pull is above 0 and that of relax"
    )
    slack = replace(relax, force_N=np.where(np.arange(100) < 99, 0.0, -0.1))
    assert list(odd_tests([replace(pulled(RAMP), curves=(one, slack))])) == [], "next to no load has no sign"
    pushed = replace(relax, protocol=replace(relax.protocol, displacement_mm=-relax.protocol.displacement_mm))
    assert list(odd_tests([replace(pulled(RAMP), curves=(one, pushed))])) == [], "a compression and a tension"


def test_a_force_that_does_not_begin_at_zero_is_named():
    (line,) = odd_tests([pulled(RAMP + 10.0)])
    assert line == (
        "look at a, pull: its force begins at 10 N (9.1 % of its peak), that of the model at 0; if this is an offset, "
        "use --zero-force first"
    )
    assert list(odd_tests([pulled(RAMP + 4.0)])) == []
    assert list(odd_tests([pulled(RAMP + 10.0, np.linspace(0.2, 1.0, 100))])) == [], "a preload with its strain"
