"""A rough error: white errors and their determinant are those of the covariance it stands for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.fitting.roughness import Roughness


def covariance(rough):
    """Of noise of unit variance and the process, which begins anew with each curve."""
    found = np.eye(sum(rough.lengths))
    at = 0
    for length in rough.lengths:
        apart = np.abs(np.subtract.outer(np.arange(length), np.arange(length)))
        found[at : at + length, at : at + length] += rough.size**2 * rough.memory**apart
        at += length
    return found


@given(st.floats(0.0, 100.0), st.floats(0.0, 0.999), st.lists(st.integers(1, 9), min_size=1, max_size=3))
def test_errors_are_made_white(size, memory, lengths):
    rough = Roughness(size, memory, tuple(lengths))
    spread = covariance(rough)
    white = rough.white(np.eye(len(spread))).T
    np.testing.assert_allclose(white @ spread @ white.T, np.eye(len(spread)), atol=1e-7)
    assert rough.log_determinant == pytest.approx(np.linalg.slogdet(spread)[1], abs=1e-6)


def test_a_row_that_is_no_number_leaves_the_others_alone():
    rough = Roughness(2.0, 0.9, (4, 3))
    errors = np.random.default_rng(1).standard_normal((3, 7))
    broken = errors.copy()
    broken[1] = np.nan
    white = rough.white(broken)
    assert np.isnan(white[1]).all()
    np.testing.assert_array_equal(white[[0, 2]], rough.white(errors)[[0, 2]])
