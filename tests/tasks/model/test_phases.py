"""Phases are read off the displacement, whatever a protocol is called, at any rate, with noise of the displacement."""

from itertools import pairwise

import numpy as np
import pytest

from sinew.tasks.model import Protocol
from sinew.tasks.model.phases import phases
from sinew.tasks.model.protocols import cyclic, one_step, two_step


def kinds(protocol):
    return [(phase.kind, phase.number) for phase in phases(protocol)]


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 100.0])
@pytest.mark.parametrize("noise_mm", [0.0, 0.0005])
def test_the_standard_protocols(rate_hz, noise_mm):
    rng = np.random.default_rng(1)
    expected = {
        one_step: [("load", 1), ("hold", 1)],
        two_step: [("load", 1), ("hold", 1), ("load", 2), ("hold", 2)],
        cyclic: [(kind, number) for number in range(1, 13) for kind in ("load", "unload")],
    }
    for make, known in expected.items():
        clean = make(10.0, rate_hz)
        moved = clean.displacement_mm + noise_mm / rate_hz * rng.standard_normal(clean.time_s.size)
        assert kinds(Protocol("any", clean.time_s, moved)) == known


@pytest.mark.parametrize("noise_mm", [0.0, 0.0005])
def test_in_compression_getting_shorter_is_loading(noise_mm):
    rng = np.random.default_rng(1)
    for make in (one_step, two_step, cyclic):
        pulled = make(10.0, 10.0)
        moved = -pulled.displacement_mm + noise_mm * rng.standard_normal(pulled.time_s.size) / 10.0
        assert kinds(Protocol("any", pulled.time_s, moved)) == kinds(pulled)


def test_a_test_that_pulls_farther_than_it_pushes_is_one_in_tension():
    time = np.arange(0, 40, 0.5)
    for corners in (
        [0, 1, -0.9, 0.5, 0],
        [0, 1, -1.1, 0.5, 0],
        [-2.0, 0.3, -0.9, 0.4, 0],
    ):  # the last: slack at first
        moved = np.interp(time, [0, 10, 20, 30, 40], corners)
        assert kinds(Protocol("both", time, moved)) == [("load", 1), ("unload", 1), ("load", 2), ("unload", 2)]


def test_phases_join_and_cover_everything():
    protocol = two_step(10.0, 10.0)
    found = phases(protocol)
    assert (found[0].start, found[-1].stop) == (0, protocol.time_s.size)
    assert all(a.stop == b.start + 1 for a, b in pairwise(found))


def test_a_slow_ramp_among_fast_ones_is_no_hold():
    time = np.arange(0, 400, 0.5)
    moved = np.interp(time, [0, 10, 60, 70, 370, 400], [0, 1, 1, 0, 1, 1])
    assert kinds(Protocol("rates", time, moved)) == [
        ("load", 1), ("hold", 1), ("unload", 1), ("load", 2), ("hold", 2),
    ]  # fmt: skip


def test_what_never_moves_is_one_hold():
    assert kinds(Protocol("still", np.arange(9.0), np.ones(9))) == [("hold", 1)]


def test_a_displacement_in_coarse_steps_is_one_of_the_direction_in_which_it_leads():
    """A crosshead that counts 0.1 mm, read 50 times for each: most steps are none."""
    t = np.arange(2000) / 50
    moved = np.interp(t, [0, 30, 40], [0, 4, 4])
    assert kinds(Protocol("pull", t, np.round(moved, 1)))[0] == ("load", 1)


@pytest.mark.parametrize("rows", [2, 7, 30])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_displacement_that_is_recorded_less_often_than_the_force_has_its_own_phases(rows, sign):
    """A rheometer that reads its gap every seventh row: two bites, with rests between them."""
    t = np.arange(6000) / 250.0
    moved = sign * np.interp(t, [0, 5, 7, 12, 14, 19, 21], [0, 8, 8, 0, 0, 8, 8])
    assert kinds(Protocol("bites", t, moved[np.arange(t.size) // rows * rows])) == [
        ("load", 1), ("hold", 1), ("unload", 1), ("hold", 2), ("load", 2), ("hold", 3),
    ]  # fmt: skip


@pytest.mark.parametrize("steps", [7, 20, 100])
def test_a_displacement_in_few_large_steps_rests_where_it_stays_for_longer(steps):
    """Ten steps up, of 10 % each, a rest that is no slow ramp to the next step, and ten steps down."""
    up = np.repeat(np.arange(1, 11) / 10.0, 10)
    moved = np.concatenate([np.zeros(10), up, np.ones(10 * steps), up[::-1][:-9] - 0.1])
    assert kinds(Protocol("steps", np.arange(moved.size) / 50.0, moved)) == [("load", 1), ("hold", 1), ("unload", 1)]


@pytest.mark.parametrize("unit", [1e-300, 1e-200, 1e200])
def test_times_in_any_unit_have_the_same_phases(unit):
    protocol = one_step(10.0, 10.0)
    other = Protocol("one", protocol.time_s * unit, protocol.displacement_mm)
    assert phases(other) == phases(protocol)
