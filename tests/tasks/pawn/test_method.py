"""PAWN indices against SALib, a parameter without influence, and what resampling shows of their scatter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from SALib.analyze import pawn as salib_pawn

from sinew.runner.errors import BadInput
from sinew.tasks.pawn.method import median_distances, pawn_indices
from sinew.tasks.study.study import read_study

HOW = {"slides": 5, "resamples": 40, "confidence": 0.95}


def sample(seed: int, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Three parameters, the first strong, the second weak, the third without influence."""
    features = np.random.default_rng(seed).random((count, 3))
    return features, np.exp(3 * features[:, 0]) + 2 * features[:, 1]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(40, 300), st.sampled_from([5, 8, 10]), st.booleans())
def test_distances_of_all_parameters_at_once_equal_salibs(seed, count, slides, ties):
    features, outcomes = sample(seed, count)
    outcomes = np.round(outcomes) if ties else outcomes
    problem = {"num_vars": 3, "names": list("abc"), "bounds": [[0, 1]] * 3}
    expected = salib_pawn.analyze(problem, features, outcomes, S=slides)["median"]
    assert np.allclose(median_distances(features, outcomes, slides), expected, rtol=0, atol=1e-12)


def test_influence_is_seen_where_it_is_and_not_where_it_is_not():
    found = [pawn_indices(*sample(seed, 1500), seed=seed, **HOW) for seed in range(12)]
    assert all(one.median[0] > one.median[1] > one.no_influence for one in found)
    seen = [one.median[2] > one.no_influence for one in found]
    assert sum(seen) <= 3  # 5 % each: more than three of twelve happen once in 500 times


@pytest.mark.thorough
def test_intervals_hold_the_scatter_of_the_estimate():
    found = [pawn_indices(*sample(100 + seed), seed=seed, **HOW) for seed in range(40)]
    middle = np.mean([one.median for one in found], axis=0)
    held = np.mean([(one.median_low <= middle) & (middle <= one.median_high) for one in found])
    assert 0.85 <= held <= 1.0


def test_the_same_seed_gives_the_same_numbers():
    one, again, other = (pawn_indices(*sample(1), seed=seed, **HOW) for seed in (3, 3, 4))
    assert vars(one).keys() == vars(again).keys()
    assert all(np.array_equal(vars(one)[name], vars(again)[name]) for name in vars(one))
    assert not np.array_equal(one.median_low, other.median_low)


def test_an_outcome_that_is_no_number_is_refused():
    features, outcomes = sample(0, 100)
    outcomes[7] = np.nan
    with pytest.raises(ValueError, match="must be numbers"):
        pawn_indices(features, outcomes, seed=0, **HOW)


def test_slides_that_salib_cannot_cut_are_refused(tmp_path):
    (tmp_path / "study.yaml").write_text("name: a\ncohort: c\npawn: {slides: 9}\n")
    with pytest.raises(BadInput, match=r"pawn\.slides.*9 slides, which SALib cannot cut"):
        read_study(tmp_path / "study.yaml")
