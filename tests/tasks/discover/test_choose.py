"""Verdicts on made-up candidates: each rule alone turns a name into something more modest."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.discover.choose import Evidence, Scored, criterion, leading, room_for_two, verdict

FLOOR = 1000.0
ABOUT = Evidence(FLOOR, located=True, surely=True)
HELD = {"protocol": (3000.0, 200.0), "later cycles": (900.0, 100.0), "specimen": (2500.0, 100.0)}
NULL = Scored((), 5000.0, 5000.0)
GOOD = Scored(("softening",), 1120.0, 1100.0, (2000.0, 1880.0), HELD, in_place=(0.9, 0.3))
OTHER = Scored(("time-lag",), 3000.0, 2980.0, (1000.0, 1000.0))
SOME = replace(GOOD, criterion=1620.0, loss=1600.0)  # explains much, leaves something
PAIR = Scored(("softening", "time-lag"), 1060.0, 1010.0, (2000.0, 1940.0), HELD, HELD, in_place=(0.9, 0.3))


def told(*candidates, about=ABOUT, null=NULL):
    found = verdict(null, candidates, about)
    return found.word, found.effects or found.alike


def test_a_clear_effect_is_named():
    assert told(GOOD, OTHER) == ("NAMED", ("softening",))


def test_a_pair_is_named_only_when_it_takes_away_much_of_what_one_leaves():
    assert told(SOME, PAIR) == ("NAMED", ("softening", "time-lag"))
    little = replace(PAIR, criterion=1350.0, loss=1300.0)
    assert leading(NULL, (SOME, little), FLOOR) is SOME
    assert leading(NULL, (GOOD, replace(PAIR, criterion=1110.0)), FLOOR) is GOOD


def test_a_second_effect_does_not_feed_on_the_form_of_the_first():
    """Of a large misfit, what the right effect leaves may be for its form; a second one would take that away."""
    null = replace(NULL, criterion=200_000.0, loss=200_000.0)
    little = replace(SOME, criterion=1370.0, loss=1350.0)
    assert told(little, PAIR, null=null) == ("NAMED", ("softening",))
    assert not room_for_two(null, (little,), FLOOR)


def test_what_is_far_beyond_chance_and_goes_to_noise_with_a_second_effect_has_two():
    """Unless that cannot be named, for then it may still be the form of the first."""
    null = replace(NULL, criterion=200_000.0, loss=200_000.0)
    assert room_for_two(null, (SOME,), FLOOR)
    assert told(SOME, PAIR, null=null) == ("NAMED", ("softening", "time-lag"))
    unsure = replace(PAIR, beyond={"protocol": (100.0, 200.0), "specimen": (50.0, 100.0)})
    above_noise = replace(PAIR, criterion=1200.0, loss=1140.0)
    rival = replace(PAIR, effects=("softening", "force-drift"), criterion=1070.0, loss=1020.0)
    for pairs in ((unsure,), (above_noise,), (PAIR, rival)):
        assert told(SOME, *pairs, null=null) == ("NAMED", ("softening",))
        assert verdict(null, (SOME, *pairs), ABOUT).judged == ("softening",)


def test_a_second_effect_that_takes_less_must_have_no_rival():
    """Where what the first leaves is for its form, other second effects take away nearly as much of it."""
    null = replace(NULL, criterion=8000.0, loss=8000.0)
    most = replace(PAIR, criterion=1250.0, loss=1200.0)
    others = [
        replace(most, effects=("softening", slug), criterion=1560.0, loss=1510.0)
        for slug in ("force-drift", "fluid-flow", "grip-slip")
    ]
    assert told(SOME, most, *others, null=null) == ("NAMED", ("softening", "time-lag"))
    assert leading(null, (SOME, most, *others[:2]), FLOOR) is SOME, "too few others say nothing"
    elsewhere = replace(others[2], effects=("time-lag", "grip-slip"))
    assert leading(null, (SOME, most, *others[:2], elsewhere), FLOOR) is SOME, "that is no second to the first"
    alike = replace(others[2], criterion=1490.0, loss=1430.0)
    assert leading(null, (SOME, most, *others[:2], alike), FLOOR) is SOME
    less = replace(most, criterion=1300.0, loss=1260.0)
    assert leading(null, (SOME, less, *others), FLOOR) is SOME
    unsure = replace(most, beyond={"protocol": (100.0, 200.0), "specimen": (50.0, 100.0)})
    assert verdict(null, (SOME, unsure, *others), ABOUT).judged == ("softening",), (
        "it may still be the form of the first"
    )


def test_noise_that_happens_to_be_small_hides_no_effect():
    """A loss of 1,000 is to be expected; here the best candidate shows that the noise is 850 of it."""
    null = replace(NULL, criterion=1050.0, loss=1050.0)
    best, rival = replace(GOOD, criterion=870.0, loss=850.0), replace(OTHER, criterion=1000.0, loss=980.0)
    assert told(best, rival, null=null) == ("NAMED", ("softening",))
    close = replace(rival, criterion=900.0, loss=880.0)
    assert told(best, close, null=null) == ("AMBIGUOUS", ("softening", "time-lag"))


def test_a_misfit_that_noise_may_hide_is_named_only_where_a_cell_disagrees():
    null = replace(NULL, criterion=970.0, loss=970.0)
    best, rival = replace(GOOD, criterion=870.0, loss=850.0), replace(OTHER, criterion=970.0, loss=950.0)
    assert told(best, rival, null=null) == ("NAMED", ("softening",))
    assert told(best, rival, null=null, about=replace(ABOUT, located=False)) == ("AMBIGUOUS", ("softening",))


def test_a_pair_must_predict_better_than_one_of_them_alone():
    unsure = replace(PAIR, beyond={"protocol": (100.0, 200.0), "specimen": (50.0, 100.0)})
    assert told(SOME, unsure) == ("AMBIGUOUS", ("softening", "time-lag"))


def test_pairs_are_looked_at_only_where_one_could_be_preferred():
    nothing_left = replace(GOOD, loss=1020.0, criterion=1040.0)
    assert room_for_two(NULL, (SOME,), FLOOR)
    assert not room_for_two(NULL, (nothing_left,), FLOOR)
    best_pair = replace(PAIR, loss=900.0, criterion=940.0)
    assert leading(NULL, (nothing_left, best_pair), FLOOR) is nothing_left


def test_nothing_is_named_where_nothing_is_wrong():
    small = replace(GOOD, criterion=4990.0, loss=4970.0)
    assert told(small, about=replace(ABOUT, located=False)) == ("NONE", ())
    assert told(small, about=replace(ABOUT, surely=False)) == ("NONE", ())


def test_what_the_library_does_not_explain_is_outside_of_it():
    assert told(replace(GOOD, criterion=4990.0, loss=4970.0)) == ("OUTSIDE", ())
    assert told(replace(GOOD, criterion=3020.0, loss=3000.0), replace(OTHER, criterion=4000.0)) == ("OUTSIDE", ())


def test_each_effect_of_a_name_may_leave_a_little_for_its_form():
    null = replace(NULL, criterion=21_000.0, loss=21_000.0)  # 2 % of the misfit are 400, and chance leaves 134
    rivals = [replace(OTHER, criterion=9000.0, loss=8990.0), replace(PAIR, criterion=9000.0, loss=8990.0)]
    for loss, word in ((1450.0, "NAMED"), (1550.0, "OUTSIDE")):
        assert told(replace(GOOD, criterion=loss, loss=loss), *rivals, null=null)[0] == word
    alone = replace(OTHER, criterion=9000.0, loss=8990.0)
    for loss, word in ((1850.0, "NAMED"), (1950.0, "OUTSIDE")):
        assert told(replace(PAIR, criterion=loss, loss=loss), alone, null=null)[0] == word


def test_a_bare_model_that_no_two_starts_agree_on_says_nothing():
    weak = replace(GOOD, criterion=4990.0, loss=4970.0)
    assert told(weak, about=replace(ABOUT, trusted=False)) == ("AMBIGUOUS", ())


def test_what_fits_alike_is_ambiguous():
    alike = replace(OTHER, criterion=1130.0, loss=1110.0)
    assert told(GOOD, alike) == ("AMBIGUOUS", ("softening", "time-lag"))
    left_behind = replace(OTHER, criterion=1250.0, loss=1230.0)
    assert told(GOOD, left_behind) == ("AMBIGUOUS", ("softening", "time-lag")), "nature's form may be another"


@pytest.mark.parametrize(
    "change",
    [
        {"held": {"protocol": (300.0, 200.0), "later cycles": (900.0, 100.0)}},
        {"on_bound": ("softening_loss",)},
        {"gains": (3900.0, -20.0)},
        {"in_place": (0.2, 0.3)},
    ],
)
def test_what_fails_a_check_is_not_named(change):
    assert told(replace(GOOD, **change), OTHER) == ("AMBIGUOUS", ("softening",))


def test_a_small_misfit_shows_in_few_cells():
    assert told(replace(GOOD, in_place=(0.2, 0.05)), OTHER) == ("NAMED", ("softening",))


def test_two_kinds_of_splits_are_enough_and_one_where_there_is_one():
    two = {"protocol": (3000.0, 200.0), "later cycles": (900.0, 100.0), "specimen": (0.0, 100.0)}
    for held in (two, {"specimen": (2500.0, 100.0)}, {}):
        assert told(replace(GOOD, held=held), OTHER) == ("NAMED", ("softening",))


def test_more_parameters_cost_more_with_more_points():
    assert criterion(10.0, 2, [100, 1000]) == pytest.approx(10.0 + 2 * np.log(100 * 1000))
