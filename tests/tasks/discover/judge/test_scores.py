"""What a score says: the noise, the best candidates, and how much of the misfit a candidate takes away."""

import pytest

from sinew.tasks.discover.judge.scores import Score, Scores, explained, misfit_by_chance, misfit_left

BARE = Score((), 1000.0, 1000.0)
NOISE = 200.0  # its standard deviation is 20: chance leaves up to 60


def test_without_candidates_the_bare_model_is_the_best():
    nothing = Scores(BARE, (), NOISE)
    assert nothing.best is BARE
    assert nothing.best_single is BARE
    only_pairs = Scores(BARE, (Score(("lag", "slip"), 300.0, 290.0),), NOISE)
    assert only_pairs.best.effects == ("lag", "slip")
    assert only_pairs.best_single is BARE


def test_a_single_effect_below_the_floor_shows_the_noise_and_a_pair_does_not():
    lag, pair = Score(("lag",), 190.0, 180.0), Score(("lag", "slip"), 170.0, 150.0)
    assert Scores(BARE, (lag, pair), NOISE).noise == 180.0
    assert Scores(BARE, (pair,), NOISE).noise == NOISE


def test_a_pair_is_called_by_both_names():
    assert Score(("lag", "slip"), 0.0, 0.0).name == "lag + slip"


def test_three_standard_deviations_are_left_to_chance_and_one_is_what_noise_may_hide():
    assert misfit_by_chance(NOISE) == 60.0
    assert misfit_left(Score((), 0.0, 250.0), NOISE) == 70.0
    assert misfit_left(Score((), 0.0, 150.0), NOISE) == 20.0


def test_the_part_explained_is_of_the_misfit_beyond_noise():
    assert explained(BARE, Score(("lag",), 0.0, 400.0), NOISE) == pytest.approx(0.75)


def test_a_misfit_that_chance_may_leave_has_no_parts():
    best = Score(("lag",), 0.0, 210.0)
    assert explained(Score((), 0.0, 260.0), best, NOISE) is None
    assert explained(Score((), 0.0, 261.0), best, NOISE) == pytest.approx(51 / 61)
