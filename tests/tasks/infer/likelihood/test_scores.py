"""Scores and places: there and back, at the ends, and the derivatives that compiled code uses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import kstest

from sinew.tasks.infer.likelihood.compiled import FARTHEST, place
from sinew.tasks.infer.likelihood.scores import density, inside, places, scores_of

WITHIN = st.floats(-2.99, 2.99)


@given(WITHIN)
def test_there_and_back(score):
    assert scores_of(places(np.array(score))) == pytest.approx(score, abs=1e-9)


@given(WITHIN)
def test_compiled_code_agrees(score):
    at, first, second = place(score)
    assert at == pytest.approx(places(np.array(score)), abs=1e-14)
    assert first == pytest.approx(density(np.array(score)))
    assert second == pytest.approx((place(score + 1e-6)[1] - place(score - 1e-6)[1]) / 2e-6, abs=1e-6)


@pytest.mark.parametrize("end", [-FARTHEST, FARTHEST])
def test_ends_are_reached_and_stay_beyond(end):
    assert places(np.array([end, 2 * end])) == pytest.approx([(np.sign(end) + 1) / 2] * 2, abs=1e-15)
    at, first, second = place(1.5 * end)
    assert (at, second) == (pytest.approx(place(end)[0] + 0.5 * end * first), 0.0)


def test_standard_normal_scores_are_uniform():
    scores = np.random.default_rng(0).standard_normal((20_000, 1))
    assert kstest(places(scores[inside(scores)]), "uniform", args=(0, 1)).pvalue > 0.001
