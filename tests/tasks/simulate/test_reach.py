"""What the ranges of a model can reach, and which parameters tests see, on curves whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.model import Curve, Model, Protocol, Specimen
from sinew.tasks.simulate.reach import POINTS, Reach, reach, spread, thinned, unseen
from sinew.tasks.simulate.uniaxial import Uniaxial

FIBRES = ("E_f", "alpha_f", "g_1f", "g_2f", "g_3f", "tau_1f", "tau_2f", "tau_3f")


def specimen_of(strain=0.04, force_times=1.0, points=400, *, name="a", hold=60.0) -> Specimen:
    """A ramp and a hold of a bar with the reference parameters, its forces times a factor."""
    time = np.linspace(0.0, 10.0 + hold, points)
    protocol = Protocol("relax", time, 10.0 * strain * np.minimum(time / 10.0, 1.0))
    bare = Specimen(name, 10.0, 5.0, 2.0)
    force = Uniaxial().simulate(Model(), bare, protocol, Model().reference[np.newaxis]).force_N[0]
    return replace(bare, curves=(Curve(protocol, force_times * force),))


def one_reach(specimen):
    (found,) = reach(Uniaxial(), Model(), specimen)
    return found


@settings(max_examples=60, deadline=None)
@given(power=st.floats(-6, 6))
def test_forces_within_a_factor_of_two_are_reached_and_others_are_not(power):
    low, high = one_reach(specimen_of()).ratios
    assert 0 < low < 1 < high
    factor = 10.0**power
    found = one_reach(specimen_of(force_times=factor))
    assert found.ratios == pytest.approx((low / factor, high / factor))
    if not 0.99 < factor / (2 * high) < 1.01 and not 0.99 < factor / (low / 2) < 1.01:
        assert found.reached == (low / 2 < factor < 2 * high)
    low, high = (ratio * found.scale for ratio in found.ratios)  # moduli times the scale
    assert low < 1 < high


def test_forces_of_the_other_sign_are_not_reached():
    found = one_reach(specimen_of(force_times=-1.0))
    assert found.other_sign
    assert not found.reached
    assert not one_reach(specimen_of(strain=-0.2)).other_sign


def test_a_single_point_that_stands_out_is_no_force():
    specimen = specimen_of()
    force = specimen.curves[0].force_N.copy()
    force[200] = 1e6
    spiked = replace(specimen, curves=(Curve(specimen.curves[0].protocol, force),))
    assert one_reach(spiked).measured_N == pytest.approx(one_reach(specimen).measured_N, rel=0.02)


def test_a_curve_without_force_tells_nothing():
    specimen = specimen_of(force_times=0.0)
    assert reach(Uniaxial(), Model(), specimen) == ()
    nothing = Curve(specimen.curves[0].protocol, np.full(400, np.nan))
    assert reach(Uniaxial(), Model(), replace(specimen, curves=(nothing,))) == ()


@pytest.mark.parametrize(
    ("strain", "expected"), [(0.04, ("nu_m",)), (-0.2, (*FIBRES, "nu_m"))], ids=["tension", "compression"]
)
def test_parameters_that_no_force_depends_on(strain, expected):
    assert unseen(Uniaxial(), Model(), [specimen_of(strain)]) == expected


def test_one_test_that_sees_a_parameter_is_enough():
    assert unseen(Uniaxial(), Model(), [specimen_of(-0.2), specimen_of(0.04, name="b")]) == ("nu_m",)
    fixed = Model().with_parameter(replace(Model().parameters[-1], minimum=0.2, maximum=0.2))
    assert unseen(Uniaxial(), fixed, [specimen_of()]) == ()


def test_rows_spread_over_the_ranges_and_are_possible():
    model = Model()
    rows = spread(model)
    low = [parameter.minimum for parameter in model.parameters]
    high = [parameter.maximum for parameter in model.parameters]
    assert (rows >= low).all()
    assert (rows <= high).all()
    middle = rows.mean(axis=0) - (np.array(low) + high) / 2
    assert np.abs(middle / (np.array(high) - low)).max() < 0.05
    assert not Uniaxial().simulate(model, specimen_of(), specimen_of().curves[0].protocol, rows).status.any()
    assert (rows == spread(model)).all()


def test_long_curves_are_thinned_and_keep_their_peak():
    specimen = specimen_of(points=50_001)
    thin = thinned(specimen.curves[0])
    assert POINTS <= thin.force_N.size <= POINTS + 3
    assert thin.force_N.max() == pytest.approx(specimen.curves[0].force_N.max(), rel=1e-4)
    assert one_reach(specimen).ratios == pytest.approx(one_reach(specimen_of(points=2_000)).ratios, rel=0.02)


@pytest.mark.parametrize("value", [0.0, 1e6, -50.0])
def test_one_odd_sample_at_the_peak_changes_nothing(value):
    specimen = specimen_of()
    force = specimen.curves[0].force_N.copy()
    force[int(force.argmax())] = value
    odd = replace(specimen, curves=(Curve(specimen.curves[0].protocol, force),))
    assert one_reach(odd).ratios == pytest.approx(one_reach(specimen).ratios, rel=0.05)


def test_a_single_force_is_none():
    force = np.zeros(400)
    force[100] = 3.0
    specimen = specimen_of()
    assert reach(Uniaxial(), Model(), replace(specimen, curves=(Curve(specimen.curves[0].protocol, force),))) == ()


def test_a_test_at_rest_beside_others_tells_nothing():
    specimen = specimen_of()
    time = np.linspace(0.0, 50.0, 500)
    rng = np.random.default_rng(2)
    rest = Curve(Protocol("rest", time, np.zeros(500)), 0.01 * rng.standard_normal(500))
    shaken = Curve(Protocol("shaken", time, 1e-5 * rng.standard_normal(500)), 0.01 * rng.standard_normal(500))
    found = reach(Uniaxial(), Model(), replace(specimen, curves=(*specimen.curves, rest, shaken)))
    assert [one.protocol for one in found] == ["relax"]
    (alone,) = reach(Uniaxial(), Model(), replace(specimen, curves=(rest,)))
    assert (alone.at_rest, alone.reached, alone.other_sign, alone.scale) == (True, False, False, 1.0)
    assert not found[0].at_rest


def test_many_fast_cycles_are_reached_by_the_ranges_that_made_them():
    time = np.linspace(0.0, 1000.0, 50_001)
    protocol = Protocol("cyclic", time, 0.2 * (1.0 - np.cos(2.0 * np.pi * time)))
    bare = Specimen("a", 10.0, 5.0, 2.0)
    model = Model()
    force = Uniaxial().simulate(model, bare, protocol, model.reference[np.newaxis]).force_N[0]
    low, high = one_reach(replace(bare, curves=(Curve(protocol, force),))).ratios
    assert low < 0.8
    assert high > 1.2


@pytest.mark.parametrize(
    ("numbers", "possible"),
    [
        ((1.0, 0.5, 2.0, 10.0), True),
        ((0.0, 0.5, 2.0, 10.0), False),
        ((1.0, np.nan, 2.0, 10.0), False),
        ((1.0, 0.5, np.inf, 10.0), False),
        ((1.0, 0.0, 0.0, 10.0), True),
        ((1.0, 0.5, 2.0, 0.0), False),
    ],
)
def test_numbers_that_no_look_gives(numbers, possible):
    assert Reach("a", "relax", *numbers).possible == possible
