"""Verdicts on made-up candidates: each rule alone turns a name into something more modest."""

from dataclasses import replace

import numpy as np
import pytest

from sinew.tasks.discover.judge.rules import Evidence, leading, second_effect_possible, verdict
from sinew.tasks.discover.judge.scores import Score, Scores, criterion
from sinew.tasks.discover.result import Gain, InPlace
from tests.tasks.discover.judge.random_evidence import evidence

FLOOR = 1000.0
HELD = {"protocol": Gain(3000.0, 200.0), "later cycles": Gain(900.0, 100.0), "specimen": Gain(2500.0, 100.0)}
NULL = Score((), 5000.0, 5000.0)
GOOD = Score(("softening",), 1120.0, 1100.0, (2000.0, 1880.0), HELD, in_place=InPlace(0.9, 0.3))
OTHER = Score(("time-lag",), 3000.0, 2980.0, (1000.0, 1000.0))
SOME = replace(GOOD, criterion=1620.0, loss=1600.0)  # explains much, leaves something
PAIR = Score(("softening", "time-lag"), 1060.0, 1010.0, (2000.0, 1940.0), HELD, HELD, in_place=InPlace(0.9, 0.3))


def scores(*candidates, null=NULL):
    return Scores(null, candidates, FLOOR)


def judged(*candidates, null=NULL, **about):
    """The verdict on these candidates; some cell disagrees far beyond chance unless ``about`` says otherwise."""
    return verdict(Evidence(scores(*candidates, null=null), **{"located": True, "surely": True, **about}))


def answer(*candidates, null=NULL, **about):
    found = judged(*candidates, null=null, **about)
    return found.word, found.effects or found.alike


def test_a_clear_effect_is_named():
    assert answer(GOOD, OTHER) == ("NAMED", ("softening",))


def test_a_pair_is_named_only_when_it_takes_away_much_of_what_one_leaves():
    assert answer(SOME, PAIR) == ("NAMED", ("softening", "time-lag"))
    little = replace(PAIR, criterion=1350.0, loss=1300.0)
    assert leading(scores(SOME, little)) is SOME
    assert leading(scores(GOOD, replace(PAIR, criterion=1110.0))) is GOOD


def test_a_second_effect_does_not_feed_on_the_form_of_the_first():
    """Of a large misfit, what the right effect leaves may be for its form; a second one would take that away."""
    null = replace(NULL, criterion=200_000.0, loss=200_000.0)
    little = replace(SOME, criterion=1370.0, loss=1350.0)
    assert answer(little, PAIR, null=null) == ("NAMED", ("softening",))
    assert not second_effect_possible(scores(little, null=null))


def test_what_is_far_beyond_chance_and_goes_to_noise_with_a_second_effect_has_two():
    """Unless that cannot be named, for then it may still be the form of the first."""
    null = replace(NULL, criterion=200_000.0, loss=200_000.0)
    assert second_effect_possible(scores(SOME, null=null))
    assert answer(SOME, PAIR, null=null) == ("NAMED", ("softening", "time-lag"))
    unsure = replace(PAIR, beyond={"protocol": Gain(100.0, 200.0), "specimen": Gain(50.0, 100.0)})
    above_noise = replace(PAIR, criterion=1200.0, loss=1140.0)
    rival = replace(PAIR, effects=("softening", "force-drift"), criterion=1070.0, loss=1020.0)
    for pairs in ((unsure,), (above_noise,), (PAIR, rival)):
        assert answer(SOME, *pairs, null=null) == ("NAMED", ("softening",))
        assert judged(SOME, *pairs, null=null).judged == ("softening",)


def test_a_second_effect_that_takes_less_must_have_no_rival():
    """Where what the first leaves is for its form, other second effects take away nearly as much of it."""
    null = replace(NULL, criterion=8000.0, loss=8000.0)
    most = replace(PAIR, criterion=1250.0, loss=1200.0)
    others = [
        replace(most, effects=("softening", slug), criterion=1560.0, loss=1510.0)
        for slug in ("force-drift", "fluid-flow", "grip-slip")
    ]
    assert answer(SOME, most, *others, null=null) == ("NAMED", ("softening", "time-lag"))
    assert leading(scores(SOME, most, *others[:2], null=null)) is SOME, "too few others say nothing"
    elsewhere = replace(others[2], effects=("time-lag", "grip-slip"))
    assert leading(scores(SOME, most, *others[:2], elsewhere, null=null)) is SOME, "that is no second to the first"
    alike = replace(others[2], criterion=1490.0, loss=1430.0)
    assert leading(scores(SOME, most, *others[:2], alike, null=null)) is SOME
    less = replace(most, criterion=1300.0, loss=1260.0)
    assert leading(scores(SOME, less, *others, null=null)) is SOME
    unsure = replace(most, beyond={"protocol": Gain(100.0, 200.0), "specimen": Gain(50.0, 100.0)})
    assert judged(SOME, unsure, *others, null=null).judged == ("softening",), "it may still be the form of the first"


def test_noise_that_happens_to_be_small_hides_no_effect():
    """A loss of 1,000 is to be expected; here the best candidate shows that the noise is 850 of it."""
    null = replace(NULL, criterion=1050.0, loss=1050.0)
    best, rival = replace(GOOD, criterion=870.0, loss=850.0), replace(OTHER, criterion=1000.0, loss=980.0)
    assert answer(best, rival, null=null) == ("NAMED", ("softening",))
    close = replace(rival, criterion=900.0, loss=880.0)
    assert answer(best, close, null=null) == ("AMBIGUOUS", ("softening", "time-lag"))


def test_a_misfit_that_noise_may_hide_is_named_only_where_a_cell_disagrees():
    null = replace(NULL, criterion=970.0, loss=970.0)
    best, rival = replace(GOOD, criterion=870.0, loss=850.0), replace(OTHER, criterion=970.0, loss=950.0)
    assert answer(best, rival, null=null) == ("NAMED", ("softening",))
    assert answer(best, rival, null=null, located=False) == ("AMBIGUOUS", ("softening",))


def test_a_pair_must_predict_better_than_one_of_them_alone():
    unsure = replace(PAIR, beyond={"protocol": Gain(100.0, 200.0), "specimen": Gain(50.0, 100.0)})
    assert answer(SOME, unsure) == ("AMBIGUOUS", ("softening", "time-lag"))


def test_pairs_are_looked_at_only_where_one_could_be_preferred():
    nothing_left = replace(GOOD, loss=1020.0, criterion=1040.0)
    assert second_effect_possible(scores(SOME))
    assert not second_effect_possible(scores(nothing_left))
    best_pair = replace(PAIR, loss=900.0, criterion=940.0)
    assert leading(scores(nothing_left, best_pair)) is nothing_left


def test_nothing_is_named_where_nothing_is_wrong():
    small = replace(GOOD, criterion=4990.0, loss=4970.0)
    assert answer(small, located=False) == ("NONE", ())
    assert answer(small, surely=False) == ("NONE", ())


def test_what_the_library_does_not_explain_is_outside_of_it():
    assert answer(replace(GOOD, criterion=4990.0, loss=4970.0)) == ("OUTSIDE", ())
    assert answer(replace(GOOD, criterion=3020.0, loss=3000.0), replace(OTHER, criterion=4000.0)) == ("OUTSIDE", ())


def test_each_effect_of_a_name_may_leave_a_little_for_its_form():
    null = replace(NULL, criterion=21_000.0, loss=21_000.0)  # 2 % of the misfit are 400, and chance leaves 134
    rivals = [replace(OTHER, criterion=9000.0, loss=8990.0), replace(PAIR, criterion=9000.0, loss=8990.0)]
    for loss, word in ((1450.0, "NAMED"), (1550.0, "OUTSIDE")):
        assert answer(replace(GOOD, criterion=loss, loss=loss), *rivals, null=null)[0] == word
    alone = replace(OTHER, criterion=9000.0, loss=8990.0)
    for loss, word in ((1850.0, "NAMED"), (1950.0, "OUTSIDE")):
        assert answer(replace(PAIR, criterion=loss, loss=loss), alone, null=null)[0] == word


def test_a_bare_model_that_no_two_starts_agree_on_says_nothing():
    weak = replace(GOOD, criterion=4990.0, loss=4970.0)
    assert answer(weak, trusted=False) == ("AMBIGUOUS", ())


def test_what_fits_alike_is_ambiguous():
    alike = replace(OTHER, criterion=1130.0, loss=1110.0)
    assert answer(GOOD, alike) == ("AMBIGUOUS", ("softening", "time-lag"))
    left_behind = replace(OTHER, criterion=1250.0, loss=1230.0)
    assert answer(GOOD, left_behind) == ("AMBIGUOUS", ("softening", "time-lag")), "nature's form may be another"


@pytest.mark.parametrize(
    "change",
    [
        {"held": {"protocol": Gain(300.0, 200.0), "later cycles": Gain(900.0, 100.0)}},
        {"on_bound": ("softening_loss",)},
        {"gains": (3900.0, -20.0)},
        {"in_place": InPlace(0.2, 0.3)},
    ],
)
def test_what_fails_a_check_is_not_named(change):
    assert answer(replace(GOOD, **change), OTHER) == ("AMBIGUOUS", ("softening",))


def test_a_small_misfit_shows_in_few_cells():
    assert answer(replace(GOOD, in_place=InPlace(0.2, 0.05)), OTHER) == ("NAMED", ("softening",))


def test_two_kinds_of_splits_are_enough_and_one_where_there_is_one():
    two = {"protocol": Gain(3000.0, 200.0), "later cycles": Gain(900.0, 100.0), "specimen": Gain(0.0, 100.0)}
    for held in (two, {"specimen": Gain(2500.0, 100.0)}, {}):
        assert answer(replace(GOOD, held=held), OTHER) == ("NAMED", ("softening",))


def test_more_parameters_cost_more_with_more_points():
    assert criterion(10.0, 2, [100, 1000]) == pytest.approx(10.0 + 2 * np.log(100 * 1000))


GIVEN = (
    "o?1-11?12oo1o1???-?12?-1?oo?o1?o1oo1??-?1??oo?-o?2??1111o1?1oo11o1?o1?11o?1o??11oo1o1?-2112oooo???1?"
    "1ooo12oo11?-oo?11?2?o-oo1?oo1oo12???-?1o??o?oo???o???112o1o?12o-?oo2oo????2o??o111o11111oo?1?o1??1??"
    "?11?1o??o?1?11o??11??oo?o111??o111?-1?1?-?1?1??1?1???1?1????12?o1-1???21-1?1?o-?1???-?????-1??1o?o??"
    "?oo????1??1o1?1?-1?2?11?111-??1?o?o1?o21?11???o1?o11ooo1?o1?211o1o?o2?1???11?1-1o??o11???1121-?1o11?"
    "??12?oo-o11o??11?122???11oo?1o??111??2???o2?o-?o?o-o??o111??2?1-oo?11oo-?1?2o??11?-o111--111?1???o1?"
    "1??oo???o1??oo1o?12o??22?oo1o?o?o12o?121?1??o1121???o11?-1?1ooo1o1?11o-??21??-o?o--1??1o1?o?o11o?11?"
)
"""Verdicts on random evidence, as the rules gave them when they were benchmarked.

1, 2: NAMED with one effect or two; -: NONE; ?: AMBIGUOUS; o: OUTSIDE.
"""


def test_no_rule_changes_its_outcome():
    letters = {"NONE": "-", "AMBIGUOUS": "?", "OUTSIDE": "o"}
    found = [verdict(evidence(seed)) for seed in range(len(GIVEN))]
    assert "".join(letters.get(one.word, str(len(one.effects))) for one in found) == GIVEN
