"""What steps have shown is known along them, and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sinew.tasks.simulate.secants import LAST, Secants


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(1, LAST), size=st.floats(1e-6, 1e6))
def test_along_what_was_seen_the_map_is_exact(seed, count, size):
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(30, 2, 5))
    known = Secants.none(30, 2, 5)
    steps = size * rng.normal(size=(count, 30))
    for step in steps:
        known = known.after(step, np.tensordot(step, slopes, 1))
    asked = rng.normal(size=(3, count)) @ steps
    change, rest = known.split(asked)
    np.testing.assert_allclose(change, np.tensordot(asked, slopes, 1), rtol=1e-6, atol=1e-6 * np.abs(change).max())
    assert np.abs(rest).max() < 1e-6 * np.abs(asked).max()


def test_what_was_not_seen_is_left():
    known = Secants.none(4, 1)
    step = np.array([[1.0, 2.0, 0.0, 0.0]])
    change, rest = known.split(step)
    assert not change.any()
    np.testing.assert_array_equal(rest, step)
    known = known.after(np.array([2.0, 0.0, 0.0, 0.0]), np.array([6.0]))
    change, rest = known.split(step)
    np.testing.assert_allclose(change, [[3.0]])
    np.testing.assert_allclose(rest, [[0.0, 2.0, 0.0, 0.0]])
    assert not known.forgotten().split(step)[0].any()
    assert known.after(np.zeros(4), np.ones(1)) is known, "no step tells nothing"


def test_the_last_steps_count():
    known = Secants.none(2, 1)
    for value in range(LAST + 5):
        known = known.after(np.array([1.0, 0.0]), np.array([float(value)]))
    assert len(known.steps) == LAST
    for slope in (1.0, 3.0):
        known = known.after(np.array([0.0, 1.0]), np.array([slope]))
    change, _ = known.split(np.array([[0.0, 1.0]]))
    assert change[0, 0] == pytest.approx(2.0), "of the same step seen twice, the mean"
