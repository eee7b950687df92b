"""What is held out: whole curves, and the later cycles and steps."""

import numpy as np
import pytest

from sinew.tasks.data.noise import Noise
from sinew.tasks.discover.measure.splits import LATER, PROTOCOL, gain, splits
from sinew.tasks.discover.result import Gain
from sinew.tasks.fitting.measured import Measured
from sinew.tasks.model import Curve, Specimen
from sinew.tasks.model.protocols import STANDARD, one_step


def measured(*makes):
    protocols = [make(10.0, 10.0) for make in makes]
    curves = tuple(Curve(protocol, np.zeros(protocol.time_s.size)) for protocol in protocols)
    return Measured(Specimen("s", 10.0, 4.0, 1.0, curves), Noise(1.0, 0.3))


def test_each_curve_and_the_later_cycles_are_held_out():
    found = splits(measured(*STANDARD))
    assert [split.kind for split in found] == [PROTOCOL] * 3 + [LATER]
    for split in found[:3]:
        (left_out,) = split.judged
        assert left_out not in [curve.name for curve in split.seen.curves]
        assert len(split.seen.curves) == 2
    later = found[3]
    assert set(later.judged) == {"two_step", "cyclic"}
    for curve in later.seen.curves:
        whole = next(make for make in STANDARD if make.__name__ == curve.name)(10.0, 10.0)
        assert curve.force_N.size == later.judged.get(curve.name, whole.time_s.size)
    cyclic = STANDARD[2](10.0, 10.0)
    cut = later.judged["cyclic"]
    assert cyclic.displacement_mm[cut] == pytest.approx(0.0, abs=0.05), "between two cycles"
    assert 0.4 < cyclic.time_s[cut] / cyclic.time_s[-1] < 0.6


def test_of_one_ramp_nothing_can_be_held_out():
    assert splits(measured(one_step)) == []


def test_the_error_of_a_gain_counts_blocks():
    rng = np.random.default_rng(3)
    gains, errors = [], []
    for _ in range(300):
        shared = np.repeat(rng.standard_normal(40), 50)
        found = gain({"curve": (shared[np.newaxis], np.zeros((1, 2000)))}, 50)
        gains.append(found.gain)
        errors.append(found.error)
    assert np.median(errors) == pytest.approx(np.std(gains), rel=0.15)


def test_a_single_block_says_nothing():
    assert gain({"curve": (np.ones((1, 10)), np.zeros((1, 10)))}, 50) == Gain(10.0, np.inf)


def test_a_quantity_that_says_nothing_makes_a_gain_no_less_sure():
    rng = np.random.default_rng(2)
    force = 1.0 + rng.standard_normal(1000)
    width = np.where(np.arange(1000) % 3 == 0, 0.0, np.nan)  # seen at every third point, and predicted alike by both
    alone = gain({"curve": (force[np.newaxis], np.zeros((1, 1000)))}, 50)
    both = gain({"curve": (np.stack([force, width]), np.stack([np.zeros(1000), width]))}, 50)
    assert both == alone
