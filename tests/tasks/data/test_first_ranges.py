"""The ranges of a new study, for curves of known tissues."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.data.first_ranges import first_ranges
from sinew.tasks.data.virtual import virtual_cohort
from sinew.tasks.model import TENDON, Curve, Model, Protocol, Specimen
from sinew.tasks.model.effects import effect_named
from sinew.tasks.simulate.reach import reach
from sinew.tasks.simulate.uniaxial import Uniaxial

SPECIMENS, _ = virtual_cohort(seed=1, per_site=1, rate_hz=2.0)


def tissue(strain, *, noise=0.0, lambda_0=1.01, slower=1.0, hold_s=40.0, **parameters) -> Specimen:
    """A specimen of 10 x 5 x 2 mm, ramped to a strain in 20 s and held for ``hold_s``, all ``slower`` by a factor."""
    time = slower * np.linspace(0.0, 20.0 + hold_s, 601)
    rng = np.random.default_rng(4)
    moved = 10.0 * strain * np.minimum(time / (20.0 * slower), 1.0) + noise * rng.standard_normal(time.size)
    protocol = Protocol("relax", time, moved)
    bare = Specimen("a", 10.0, 5.0, 2.0)
    model = Model(lambda_0=lambda_0)
    row = [[parameters.get(one.name, one.reference) for one in model.parameters]]
    smooth = Protocol("relax", time, 10.0 * strain * np.minimum(time / (20.0 * slower), 1.0))
    force = Uniaxial().simulate(model, bare, smooth, np.array(row)).force_N[0]
    return replace(bare, curves=(Curve(protocol, force),))


def range_of(model, name):
    parameter = model.parameters[model.names.index(name)]
    return parameter.minimum, parameter.maximum


def test_human_tendon_keeps_the_published_ranges():
    found = first_ranges(SPECIMENS)
    assert not found.scaled
    assert found.lines == (
        "ranges: those of human tendon (Pekedis 2025), which reach the measured forces",
        "ranges: no force of these tests depends on nu_m; fixed",
    )
    assert found.model.parameters[:-1] == TENDON[:-1]
    assert found.model.lambda_0 == 1.01


@pytest.mark.parametrize("factor", [1e-5, 1e-3, 20.0])
def test_tissue_of_another_stiffness_gets_ranges_that_hold_its_moduli(factor):
    truth = {"E_f": 200 * factor, "E_m": 40 * factor, "g_1f": 0.9, "g_2f": 1.0, "g_3f": 1.0, "alpha_f": 2000.0}
    specimen = tissue(0.04, **truth)
    found = first_ranges([specimen])
    assert found.scaled
    assert "as those of human tendon do not fit (strain 0 to 4 %; a relax has " in found.lines[0]
    low, high = range_of(found.model, "E_f")
    assert low < truth["E_f"] < high
    assert range_of(found.model, "E_m")[1] > truth["E_m"]
    assert high / max(low, 1e-12) < 1000
    assert all(one.reached for one in reach(Uniaxial(), found.model, specimen))


@pytest.mark.parametrize("beyond", [False, True])
def test_ranges_that_end_a_little_below_the_peak_do_not_reach_it(beyond):
    """A run allows a factor of two; a study begins with ranges that hold what was measured."""
    specimen = tissue(0.04)
    (seen,) = reach(Uniaxial(), Model(), specimen)
    (curve,) = specimen.curves
    to = (1.1 if beyond else 0.9) * seen.most_N / seen.measured_N
    found = first_ranges([replace(specimen, curves=(replace(curve, force_N=to * curve.force_N),))])
    assert found.scaled is beyond
    assert ("which reach the measured forces" in found.lines[0]) is not beyond
    assert found.only_times is not beyond


@pytest.mark.parametrize(("factor", "said"), [(10.0, False), (300.0, True)])
def test_specimens_that_cannot_be_of_one_tissue_are_named(factor, said):
    soft = replace(tissue(0.04), name="skin")
    curve = soft.curves[0]
    stiff = replace(soft, name="tendon", curves=(replace(curve, force_N=factor * curve.force_N),))
    lines = [line for line in first_ranges([soft, stiff]).lines if "one tissue" in line]
    assert len(lines) == said
    if said:
        assert "the peak stress of tendon is 300 times that of skin" in lines[0]


def test_the_same_tissue_pulled_farther_is_no_other_tissue():
    """A toe: forty times the stress at four times the strain is but ten times the stiffness."""
    near, far = replace(tissue(0.01), name="a"), replace(tissue(0.04), name="b")
    curve = far.curves[0]
    peak = np.abs(near.curves[0].force_N).max() / np.abs(curve.force_N).max()
    far = replace(far, curves=(replace(curve, force_N=40.0 * peak * curve.force_N),))
    assert not any("one tissue" in line for line in first_ranges([near, far]).lines)


def test_extensible_tissue_gets_a_longer_toe():
    specimen = tissue(0.4, lambda_0=1.3, E_f=3.0, alpha_f=8.0, E_m=0.05)
    found = first_ranges([specimen])
    assert found.scaled
    assert 1.2 <= found.model.lambda_0 <= 1.4
    low, high = range_of(found.model, "alpha_f")
    assert low <= 8.0 <= high < 100
    assert f"({found.model.lambda_0:g})" not in found.lines[1]
    assert f"a stretch of {found.model.lambda_0:g} (lambda_0)" in found.lines[1]


def test_tendon_that_stiffens_up_to_larger_strains_gets_a_longer_toe_and_says_so():
    """Only the shape of the loading tells, as most of the curve is a relaxation unlike that of human tendon."""
    relaxing = {"g_1f": 3.0, "g_2f": 0.0, "g_3f": 0.0, "tau_1f": 1.0}
    specimen = tissue(0.06, hold_s=400.0, lambda_0=1.06, E_f=900.0, alpha_f=300.0, E_m=20.0, **relaxing)
    found = first_ranges([specimen])
    assert found.scaled
    assert 1.04 <= found.model.lambda_0 <= 1.06
    assert "as those of human tendon do not fit (strain 0 to 6 %; the curves stiffen beyond 1 %" in found.lines[0]
    assert f"a stretch of {found.model.lambda_0:g} (lambda_0)" in found.lines[1]
    assert first_ranges([tissue(0.06)]).model.lambda_0 == 1.01
    (curve,) = specimen.curves
    late = np.where(np.arange(curve.force_N.size) < 100, 0.0, curve.force_N)
    first_ranges([replace(specimen, curves=(replace(curve, force_N=late),))])  # no loading that has a shape


def test_slack_fibres_are_no_longer_toe():
    """They are an effect, which a discovery can find."""
    found = first_ranges(
        list(virtual_cohort(seed=2503, per_site=1, rate_hz=10.0, effects=(effect_named("toe-slack"),))[0])
    )
    assert found.model.lambda_0 == 1.01
    (line,) = [line for line in found.lines if "taut" in line]
    assert "as if fibres became taut at 1" in line


def test_a_toe_ends_where_the_whole_curves_say_so():
    """First loadings up to 5 or 7 % are alike; what relaxes is not."""
    relaxing = {"g_1f": 0.9, "g_2f": 1.2, "g_3f": 0.8}
    specimen = tissue(0.07, lambda_0=1.07, E_f=800.0, alpha_f=100.0, E_m=5.0, **relaxing)
    found = first_ranges([specimen])
    assert found.model.lambda_0 == 1.07
    low, high = range_of(found.model, "E_f")
    assert low < 800.0 < high


@pytest.mark.parametrize("noise", [0.0, 2e-3])
def test_compression_leaves_the_matrix_alone(noise):
    found = first_ranges([tissue(-0.3, noise=noise, E_m=0.005)])
    assert found.lines[1] == "ranges: every test is a compression, in which fibres carry nothing: E_f is fixed at 0"
    fixed = [one.name for one in found.model.parameters if one.fixed]
    assert fixed == ["E_f", "alpha_f", "g_1f", "g_2f", "g_3f", "tau_1f", "tau_2f", "tau_3f", "nu_m"]
    assert range_of(found.model, "E_f") == (0.0, 0.0)
    low, high = range_of(found.model, "E_m")
    assert low < 0.005 < high


@pytest.mark.parametrize("factor", [0.05, 100.0])
@pytest.mark.parametrize("modulus", [200.0, 0.2])
def test_tests_of_seconds_or_hours_get_relaxation_times_of_their_own(factor, modulus):
    times = {f"tau_{i}{part}": factor * each for i, each in ((1, 1.0), (2, 10.0), (3, 50.0)) for part in "fm"}
    specimen = tissue(0.04, slower=factor, E_f=modulus, E_m=modulus / 5.0, **times)
    found = first_ranges([specimen])
    assert found.scaled
    (line,) = [line for line in found.lines if "relaxation times" in line]
    assert f"lasts {60 * factor:.3g} s" in line
    for name, value in times.items():
        low, high = range_of(found.model, name)
        assert low <= value * 2.0, "the published first time is shorter than a band of these tests"
        assert high >= value / 2.0
    assert range_of(found.model, "tau_1f")[0] >= 2 * 0.0999 * factor, "two samples"
    assert range_of(found.model, "tau_1f")[1] == range_of(found.model, "tau_2f")[0]
    assert range_of(found.model, "tau_3f")[1] == 60 * factor
    assert all(one.reached for one in reach(Uniaxial(), found.model, specimen))


def test_few_samples_still_make_three_bands():
    time = np.array([0.0, 3.0, 6.0, 9.0])
    curve = Curve(Protocol("relax", time, 0.04 * time), 10.0 * np.minimum(time, 3.0))
    found = first_ranges([Specimen("a", 10.0, 5.0, 2.0, curves=(curve,))])
    ends = [range_of(found.model, f"tau_{i}f") for i in (1, 2, 3)]
    assert ends == [(0.9, 1.9), (1.9, 4.2), (4.2, 9.0)]


def test_tests_of_specimens_without_sizes_count_for_the_times_and_are_named():
    long = replace(SPECIMENS[0], name="long", curves=(lasting(SPECIMENS[0], 900.0),))
    short = replace(SPECIMENS[0], name="short", curves=(lasting(SPECIMENS[0], 16.0),))
    alone, both = first_ranges([short]), first_ranges([short], [long])
    assert "the longest test lasts 16 s" in "".join(alone.lines)
    assert "lasts 16 s" not in "".join(both.lines)
    assert both.lines[-1].startswith("ranges: not compared with long; once all sizes are filled in, `sinew init`")


@pytest.mark.parametrize("sign", [0.0, -1.0])
def test_scaled_times_are_told_where_the_moduli_stay_as_published(sign):
    curve = lasting(SPECIMENS[0], 9.0)
    specimen = replace(SPECIMENS[0], curves=(replace(curve, force_N=sign * curve.force_N),))
    found = first_ranges([specimen])
    assert found.lines[0].startswith("ranges: those of human tendon")
    assert [range_of(found.model, "tau_3f")[1] == 9.0, found.scaled] == [bool(sign), bool(sign)]
    assert ("the longest test lasts 9 s" in "".join(found.lines)) == bool(sign)


def test_without_a_force_the_times_of_others_are_told():
    found = first_ranges([], [replace(SPECIMENS[0], curves=(lasting(SPECIMENS[0], 9.0),))])
    assert range_of(found.model, "tau_3f")[1] == 9.0
    assert "the longest test lasts 9 s" in "".join(found.lines)
    assert found.scaled


def lasting(specimen: Specimen, seconds: float) -> Curve:
    """A ramp of the specimen that lasts so long."""
    time = np.linspace(0.0, seconds, 200)
    protocol = Protocol("ramp", time, 0.03 * specimen.length_mm * time / seconds)
    return Curve(protocol, 20000.0 * protocol.displacement_mm / specimen.length_mm)


def test_without_a_force_or_sizes_the_published_ranges_stand():
    specimen = tissue(0.04)
    for specimens in ([], [replace(specimen, curves=(Curve(specimen.curves[0].protocol, np.zeros(601)),))]):
        found = first_ranges(specimens)
        assert found.model == Model()
        assert len(found.lines) == 1


@pytest.mark.parametrize("strain", [0.04, -0.3])
def test_forces_of_the_other_sign_leave_the_published_ranges_and_are_told(strain):
    specimen = tissue(strain)
    turned = replace(specimen, curves=tuple(Curve(one.protocol, -one.force_N) for one in specimen.curves))
    found = first_ranges([turned])
    assert found.model == Model()
    (line,) = found.lines
    assert line.endswith("tension is positive, so check the sign convention of the machine")


def test_a_toe_never_ends_where_no_study_lets_it():
    specimen = tissue(1.5, lambda_0=1.9, E_f=3.0, alpha_f=0.5, E_m=0.01)
    found = first_ranges([specimen])
    assert 1.0 < found.model.lambda_0 < 2.0
    assert found.scaled


def test_tissue_without_fibres_or_without_matrix_can_have_both():
    for absent, present in (("E_m", "E_f"), ("E_f", "E_m")):
        found = first_ranges([tissue(0.04, **{absent: 0.0, present: 0.01})])
        for name in (absent, present):
            low, high = range_of(found.model, name)
            assert low < high


def test_compression_that_begins_a_little_stretched_is_one():
    specimen = tissue(-0.3, E_m=0.005)
    (curve,) = specimen.curves
    shifted = Curve(Protocol("relax", curve.protocol.time_s, curve.protocol.displacement_mm + 0.1), curve.force_N)
    assert "every test is a compression" in first_ranges([replace(specimen, curves=(shifted,))]).lines[1]
