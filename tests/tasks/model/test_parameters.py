"""Values of parameters as points of the unit cube, and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sinew.tasks.model import Model
from sinew.tasks.model.parameters import bounds, from_unit, own_parameter, scaled, to_unit

MODEL = Model((own_parameter("E", "MPa", 2.0, 6.0), own_parameter("nu", "1", 0.3, 0.3), own_parameter("k", "N", -1, 1)))


def test_ends_of_ranges_are_corners_of_the_cube():
    lower, upper = bounds(MODEL.free)
    assert (scaled(MODEL.free, np.zeros((1, 2))) == lower).all()
    assert (scaled(MODEL.free, np.ones((1, 2))) == upper).all()


def test_what_is_fixed_stays_at_its_reference():
    assert from_unit(MODEL, np.array([[0.25, 0.5]])).tolist() == [[3.0, 0.3, 0.0]]


@given(arrays(float, (3, 16), elements=st.floats(0, 1)))
def test_there_and_back(points):
    np.testing.assert_allclose(to_unit(Model(), from_unit(Model(), points)), points, atol=1e-12)


def test_points_follow_the_order_of_the_free_parameters():
    assert to_unit(MODEL, np.array([[6.0, 0.3, -1.0]]))[0] == pytest.approx([1.0, 0.0])
