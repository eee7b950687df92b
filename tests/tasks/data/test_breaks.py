"""Breaks are told from softening, relaxation, unloading and spikes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sinew.tasks.data.breaks import break_of
from sinew.tasks.model import Curve, Protocol

RAMP = np.linspace(0.0, 100.0, 100)
WAY = np.linspace(0.0, 1.0, 100)
BROKEN = np.where(np.arange(100) > 90, 60.0, RAMP)
BACK = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(1.0, 0.0, 50)])
TURNED = np.concatenate([np.linspace(0.0, 1.0, 50), np.linspace(1.0, 0.0, 51)[1:]])
STEP = np.concatenate([np.linspace(0.0, 1.0, 40), np.full(30, 1.0), np.linspace(1.0, 1.03, 30)])
SPIKE = np.where(np.arange(100) == 60, 300.0, RAMP)


def pulled(force: np.ndarray, moved: np.ndarray = WAY) -> Curve:
    return Curve(Protocol("pull", np.arange(100) / 10, moved), force)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_break_in_tension_and_in_compression(sign):
    assert break_of(pulled(sign * BROKEN, sign * WAY)) == (90, 91)


def test_a_spike_where_it_breaks_is_left_out():
    force = BROKEN.copy()
    force[90] = 300.0
    assert break_of(pulled(force)) == (89, 91)


def test_a_break_ends_where_nearly_all_is_lost_and_not_in_the_noise_behind_it():
    force = np.concatenate([np.linspace(0.0, 100.0, 60), [50.0, 3.0], np.linspace(2.0, 1.0, 38)])
    assert break_of(pulled(force)) == (59, 61)


def test_a_break_after_many_cycles_is_found():
    """40 cycles of six rows to 80 % of the peak: the usual step of the force is large."""
    up = np.array([0.0, 0.4, 0.8, 0.8, 0.4, 0.0])
    way = np.concatenate([np.tile(up, 40), np.linspace(0.0, 1.0, 40), np.linspace(1.02, 1.2, 20)])
    force = 100.0 * np.where(np.arange(way.size) < 280, way, 0.0)
    found = break_of(Curve(Protocol("pull", np.arange(way.size) / 10, way), force))
    assert found is not None
    assert found[0] == 279


def test_rows_without_a_force_are_passed_over():
    force = BROKEN.copy()
    force[:50:2] = np.nan
    assert break_of(pulled(force)) == (90, 91)
    assert break_of(pulled(np.full(100, np.nan))) is None


@pytest.mark.parametrize(
    ("force", "moved"),
    [
        pytest.param(RAMP, WAY, id="no break"),
        pytest.param(np.concatenate([RAMP[::2], RAMP[:49:-1]]), WAY, id="over half of the displacement"),
        pytest.param(
            np.concatenate([RAMP[::2], 50.0 + 50.0 * np.exp(-np.arange(50.0))]),
            np.concatenate([WAY[::2], np.full(50, 1.0)]),
            id="while it is held",
        ),
        pytest.param(100.0 * BACK**9, BACK, id="while it is unloaded"),
        pytest.param(-100.0 * BACK**9, -BACK, id="while a compression is unloaded"),
        pytest.param(100.0 * TURNED**9, TURNED, id="the peak is also the first of unloading"),
        pytest.param(
            np.concatenate([np.linspace(0.0, 100.0, 40), np.linspace(100.0, 50.0, 30), np.linspace(50.0, 55.0, 30)]),
            STEP,
            id="after a hold",
        ),
        pytest.param(SPIKE, WAY, id="a spike"),
        pytest.param(0.0 * RAMP, WAY, id="no force at all"),
        *(
            pytest.param(np.random.default_rng(seed).standard_normal(100), WAY, id=f"noise without any load {seed}")
            for seed in range(20)
        ),
        pytest.param(BROKEN, 0.0 * WAY, id="no motion"),
    ],
)
def test_what_is_no_break(force, moved):
    assert break_of(pulled(force, moved)) is None


def test_a_curve_too_short_to_see_a_break_in():
    curve = pulled(BROKEN)
    few = slice(81, 100)
    protocol = Protocol("pull", curve.protocol.time_s[few], curve.protocol.displacement_mm[few])
    assert break_of(Curve(protocol, BROKEN[few])) is None


@given(arrays(float, 100, elements=st.floats(-1.0, 1.0)), st.sampled_from([WAY, BACK, STEP, np.sort(np.sin(50 * WAY))]))
def test_a_break_ends_behind_its_begin(noise, moved):
    found = break_of(pulled(np.minimum(RAMP, 5.0) + 5.0 * noise, moved))
    assert found is None or found[0] < found[1]
