"""The test that tells two models apart is found, and does what was promised when the truth is simulated."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.after import experiment
from sinew.tasks.discover.after.experiment import Rival, believed, next_experiment
from sinew.tasks.discover.after.menu import Leg, Test, Usual, menu, usual
from sinew.tasks.discover.fit.candidate import Candidate
from sinew.tasks.discover.fit.fit import derivatives, fit, residuals
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.effects import library
from sinew.tasks.model.protocols import cyclic, one_step
from sinew.tasks.study.result import plain
from tests.tasks.discover.measurements import BAR, measurements, model_with_free

INTERVAL_S = 0.5


def pulled(candidate, at, tests, seed):
    """A specimen pulled through tests or protocols, with noise."""
    pairs = [
        (test.specimen(BAR), test.protocol(10.0 * test.length)) if isinstance(test, Test) else (BAR, test)
        for test in tests
    ]
    return measurements(candidate, at, pairs, seed)


def fitted(candidate, measured, effects_from):
    begins = [
        np.concatenate([np.full(len(candidate.varied), 0.5), effects_from(candidate, share)]) for share in (0.1, 0.6)
    ]
    return min((fit(candidate, measured, at) for at in begins), key=lambda one: one.loss)


def part(candidate, share):
    return candidate.null() + share * (candidate.typical() - candidate.null())


def both(model, truth, values, others, tests, seed=0):
    """Measurements under ``truth`` at ``values``, and rivals fitted to them, the truth first."""
    effects = library()
    true = Candidate(model, tuple(effects[slug] for slug in truth))
    at = np.concatenate([np.full(len(true.varied), 0.45), [true.unit(name, value) for name, value in values.items()]])
    measured = pulled(true, at, tests, seed)
    rivals = []
    for slugs in (truth, *others):
        candidate = Candidate(model, tuple(effects[slug] for slug in slugs))
        rivals.append(Rival(candidate.effects, (fitted(candidate, measured, part).at,)))
    return measured, rivals


FIRST = Test("first", "", (Leg(0.04, 0.006, 60.0), Leg(0.0, 0.006)), INTERVAL_S)
BRIEF = Test("brief", "", (Leg(0.04, 0.006, 20.0),), INTERVAL_S)
CASES = {  # free parameters, the truth and its values, its rival, what was measured, what should be done
    "a slow mode or nothing": (
        ("E_f", "g_2f", "g_3f", "tau_3f"), ("relaxation-mode",), {"g_4f": 0.8, "tau_4f": 300.0}, (), BRIEF,
        ("many cycles", "rest and repetition"),  # those that last longest
    ),
    "the machine gives way or the area is wrong": (
        ("E_f", "alpha_f", "g_2f", "g_3f", "tau_3f"), ("machine-compliance",), {"compliance": 2e-5}, ("area-error",),
        FIRST, ("half the gauge length",),
    ),
    "fibres push back or not": (
        ("E_f", "E_m", "g_3f"), ("fiber-compression",), {"compressed_part": 0.3}, (), FIRST, ("compression",),
    ),
    "friction or a lag": (
        ("E_f", "E_m", "g_1f", "tau_1f"), ("rate-viscosity",), {"viscosity": 10.0}, ("time-lag",), FIRST,
        ("fast cycles", "many cycles"),  # those with reversals
    ),
}  # fmt: skip


def refitted(candidate, old, new, start):
    """The lowest loss over old and new measurements together."""

    def loss(at):
        return np.concatenate([residuals(candidate, one, at[np.newaxis], one.curves)[0] for one in (old, new)])

    def slope(at):
        return np.concatenate([derivatives(candidate, one, at, one.curves)[1] for one in (old, new)])

    start = np.clip(start, 1e-6, 1 - 1e-6)
    return 2.0 * least_squares(loss, start, jac=slope, bounds=(0, 1), ftol=1e-8, max_nfev=60).cost


@pytest.mark.parametrize("case", CASES)
def test_the_right_test_is_chosen_and_does_what_it_promised(case):
    free, truth, values, other, tested, expected = CASES[case]
    model = model_with_free(*free)
    measured, rivals = both(model, truth, values, [other], [tested])
    found = next_experiment(Candidate(model), rivals, [measured])
    assert found.best.test.name in expected
    candidates = [Candidate(model, rival.effects) for rival in rivals]
    points = [believed(c, measured, r.at[0]) for c, r in zip(candidates, rivals, strict=True)]
    before = [
        np.sum(residuals(c, measured, at[np.newaxis], measured.curves) ** 2)
        for c, at in zip(candidates, points, strict=True)
    ]
    for prospect in (found.best, next(one for one in found.table if one.test.name == "many cycles")):
        promised = next(one.gain for one in prospect.separations if one.truth == truth)
        new = pulled(candidates[0], points[0], [prospect.test], 1)
        after = [refitted(c, measured, new, at) for c, at in zip(candidates, points, strict=True)]
        gain = (after[1] - after[0]) - (before[1] - before[0])
        if promised > 20.0:
            assert 0.5 < gain / promised < 2.0
        else:
            assert abs(gain) < 40.0


def test_what_holds_are_too_short_for_longer_holds_show():
    free, truth, values, other, tested, _ = CASES["a slow mode or nothing"]
    model = model_with_free(*free)
    measured, rivals = both(model, truth, values, [other], [tested])
    gains = {one.test.name: one.hardest.gain for one in next_experiment(Candidate(model), rivals, [measured]).table}
    assert gains["longer hold"] > 3.0 * gains["the usual test again"]


def test_a_model_that_contains_the_truth_cannot_be_refuted():
    """The bare model against one with an effect: only one direction is asked, and two specimens tell more than one."""
    free, truth, values, other, tested, _ = CASES["fibres push back or not"]
    model = model_with_free(*free)
    measured, rivals = both(model, truth, values, [other], [tested])
    chosen = [test for test in menu(usual([measured.specimen])) if test.name in ("compression", "longer hold")]
    one = next_experiment(Candidate(model), rivals, [measured], chosen)
    assert [(each.truth, each.other) for each in one.best.separations] == [(truth, ())]
    two = next_experiment(Candidate(model), [Rival(r.effects, r.at * 2) for r in rivals], [measured, measured], chosen)
    assert two.best.hardest.gain == pytest.approx(2.0 * one.best.hardest.gain)
    assert two.best.hardest.newtons == one.best.hardest.newtons
    assert next_experiment(Candidate(model), rivals[:1], [measured]) is None
    told = json.loads(json.dumps(plain(two.result())))
    assert told["name"] == "compression" and "-1 % strain" in told["words"]
    assert [row["name"] for row in told["menu"]] == ["compression", "longer hold"]


def test_a_test_that_no_model_can_be_pulled_through_is_left_out():
    model = model_with_free("E_f", "E_m", "g_3f")
    measured, rivals = both(model, ("fiber-compression",), {"compressed_part": 0.3}, [()], [FIRST])
    burst = Test("burst", "", (Leg(1e140, 1e139),), INTERVAL_S)
    assert next_experiment(Candidate(model), rivals, [measured], [burst]) is None


def test_tests_of_a_compression_press_again():
    """Its loading makes the specimen shorter: rates are above 0, strains below."""
    ramp = one_step(20.0, 4.0)
    curves = (Curve(replace(ramp, displacement_mm=-ramp.displacement_mm), np.zeros(ramp.time_s.size)),)
    known = usual([Specimen("one", 20.0, 8.0, 4.0, curves)])
    assert known.strain == pytest.approx(-ramp.displacement_mm.max() / 20.0)
    assert known.rate > 0.0
    tests = {test.name: test for test in menu(known)}
    assert tests["larger compression"].protocol(20.0).displacement_mm.min() == pytest.approx(
        25.0 * known.strain, rel=1e-3
    )
    assert tests["tension"].protocol(20.0).displacement_mm.max() == pytest.approx(0.2, rel=1e-2)
    assert all(test.protocol(20.0).time_s.size > 3 for test in tests.values())
    assert tests["faster ramp"].words.startswith("compress to -4 % strain at 5.9")


def test_tests_of_a_mixed_cohort_go_on_in_the_direction_of_most():
    """As far as all of these went: a specimen that was not stretched as far as the others may break there."""
    ramp = one_step(20.0, 4.0)
    strains = []
    for sign, size in ((1.0, 0.5), (1.0, 0.5), (-1.0, 1.0), (-1.0, 1.1), (-1.0, 1.2)):
        moved = replace(ramp, displacement_mm=sign * size * ramp.displacement_mm)
        strains.append(Specimen("one", 20.0, 8.0, 4.0, (Curve(moved, np.zeros(ramp.time_s.size)),)))
    farthest = ramp.displacement_mm.max() / 20.0
    assert usual(strains).strain == pytest.approx(-farthest)
    still = replace(strains[-1].curves[0].protocol, displacement_mm=0.0 * ramp.displacement_mm)
    idle = Specimen("idle", 20.0, 8.0, 4.0, (Curve(still, np.zeros(ramp.time_s.size)),))
    assert usual([*strains[2:], idle]).strain == pytest.approx(-farthest), "it was not tested"
    assert usual(strains[:3]).strain == pytest.approx(0.5 * farthest)
    assert usual(strains[1:3]).strain == pytest.approx(0.5 * farthest), "as many of either: tension"


def test_there_is_no_test_where_nothing_moved():
    assert menu(Usual(0.0, 0.006, 200.0, 0.25)) == ()


def test_tests_are_built_from_what_was_done():
    curves = tuple(
        Curve(protocol, np.zeros(protocol.time_s.size)) for protocol in (one_step(20.0, 4.0), cyclic(20.0, 4.0))
    )
    known = usual([Specimen("one", 20.0, 8.0, 4.0, curves)])
    assert known.strain == pytest.approx(0.042, rel=1e-2)
    assert known.rate == pytest.approx(0.006, rel=1e-2)
    assert known.hold_s == pytest.approx(200.0, rel=1e-2)
    assert known.interval_s == 0.25
    known = Usual(0.04, 0.006, 200.0, 0.25)
    tests = {test.name: test for test in menu(known)}
    assert len(tests) == len(menu(known))
    longest = {name: test.protocol(20.0).time_s[-1] for name, test in tests.items()}
    assert longest["longer hold"] == pytest.approx(1000.0 + 0.04 / 0.006, abs=0.25)
    assert longest["slower ramp"] == pytest.approx(200.0 + 0.04 / 0.0006, abs=0.25)
    moved = {name: test.protocol(20.0).displacement_mm for name, test in tests.items()}
    assert moved["larger stretch"].max() == pytest.approx(1.0)
    assert moved["compression"].min() == pytest.approx(-0.2)
    half = tests["half the gauge length"].specimen(Specimen("one", 20.0, 8.0, 4.0, curves))
    assert (half.length_mm, half.width_mm, half.curves) == (10.0, 8.0, ())
    assert "hold for 1000 s" in tests["longer hold"].words
    assert "stretch to 4 % strain at 6 % per second" in tests["faster ramp"].words


def test_what_a_camera_will_see_counts_and_is_seen_as_often_as_so_far():
    """A bar whose Poisson's ratio is unknown: the force says nothing of the width, and the width of the modulus."""
    model = model_with_free("E_f", "nu_m")
    true = replace(Candidate(model, (library()["machine-compliance"],)), compared=("lateral_strain",))
    at = np.array([0.5, 0.5, 0.02])
    protocol, rng = one_step(10.0, 2.0), np.random.default_rng(1)
    courses = true.courses(BAR, protocol, at[np.newaxis])
    seen = np.where(np.arange(protocol.time_s.size) % 4, np.nan, courses["lateral_strain"][0])
    force = courses["force"][0] + rng.standard_normal(protocol.time_s.size)
    specimen = replace(BAR, curves=(Curve(protocol, force, {"lateral_strain": seen}),))
    gains = {}
    for name, others in (("force", {}), ("both", {"lateral_strain": Noise(1e-5, 0.0)})):
        measured = Measured(specimen, Noise(1.0, 0.0), others)
        bare = replace(true, effects=(), compared=tuple(others))
        effects = {"machine-compliance": true.effects, "toe-slack": (library()["toe-slack"],)}
        rivals = []
        for rival in effects.values():
            candidate = bare.having(*rival)
            starts = [np.concatenate([np.full(len(bare.varied), 0.5), part(candidate, share)]) for share in (0.1, 0.6)]
            found = min((fit(candidate, measured, one) for one in starts), key=lambda one: one.loss)
            rivals.append(Rival(rival, (found.at,)))
        found = next_experiment(bare, rivals, [measured], [BRIEF])
        gains[name] = found.best.hardest.gain
    assert gains["both"] > 1.15 * gains["force"]
    pulled_again = experiment._pulled(BRIEF, measured, bare, rivals[0].at[0])
    often = np.isfinite(pulled_again.curves[0].others["lateral_strain"]).mean()
    assert often == pytest.approx(0.25, abs=0.02)
