"""What must agree within a result of an inference: a mean and its interval, and results by likelihood."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.infer.consistent import check_marginal
from sinew.tasks.infer.likelihood.result import PopulationMarginal, SpecimenMarginal


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.data())
def test_whatever_was_drawn_is_consistent(drawn, data):
    """Any interval of more than half of the draws, as far from their mean as heavy tails can be."""
    values = np.sort(drawn)
    inside = len(values) // 2 + 1
    first = data.draw(st.integers(0, len(values) - inside))
    last = data.draw(st.integers(first + inside - 1, len(values) - 1))
    check_marginal(float(values.mean()), float(values.std()), float(values[first]), float(values[last]))


@pytest.mark.parametrize(
    ("mean", "sd", "low", "high"), [(3.1, 1.0, 1.0, 2.0), (-0.1, 1.0, 1.0, 2.0), (1.0, 1.0, 2.0, 1.0)]
)
def test_what_cannot_be_of_one_sample_is_refused(mean, sd, low, high):
    with pytest.raises(ValueError, match="interval"):
        check_marginal(mean, sd, low, high)
    with pytest.raises(ValueError, match="interval"):
        SpecimenMarginal(mean, sd, low, high, determined=True)


def test_numbers_that_are_none_are_left_to_whoever_reads_the_study():
    check_marginal(math.nan, 1.0, 1.0, 2.0)


@pytest.mark.parametrize("change", [{"low": 3.0}, {"spread_low": 0.5}])
def test_intervals_of_a_population_are_in_order(change):
    one = PopulationMarginal(1.0, 0.5, 2.0, 0.2, 0.1, 0.3, 400.0, 1.0)
    with pytest.raises(ValueError, match="an interval from"):
        replace(one, **change)
