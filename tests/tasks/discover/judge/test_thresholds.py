"""Each rule at its threshold, and what the verdict says of it.

Noise is 200 here, so that its standard deviation is 20 and chance leaves 60: every threshold is an exact number.
"""

from dataclasses import replace

import pytest

from sinew.tasks.discover.judge.rules import (
    Evidence,
    Verdict,
    leading,
    next_best,
    rivals,
    second_effect_possible,
    verdict,
)
from sinew.tasks.discover.judge.scores import Score, Scores
from sinew.tasks.discover.result import Gain, InPlace

NOISE = 200.0
BARE = Score((), 5180.0, 5180.0)  # leaves 5,000: a misfit of 4,980 and what noise may hide
LAG = Score(("lag",), 230.0, 220.0)
SLIP = Score(("slip",), 3000.0, 2990.0)


def candidate(effects: str, loss: float, criterion: float | None = None, **about: object) -> Score:
    return replace(Score(tuple(effects.split()), loss if criterion is None else criterion, loss), **about)


def judged(*candidates: Score, bare: Score = BARE, located: bool = True, **about: object) -> Verdict:
    return verdict(Evidence(Scores(bare, candidates, NOISE), located, **{"surely": True, **about}))


def leads(*candidates: Score, bare: Score = BARE) -> tuple[str, ...]:
    return leading(Scores(bare, candidates, NOISE)).effects


# ---- thresholds


def test_a_gain_of_20_is_enough():
    assert judged(candidate("lag", 5160.0), located=False).word == "OUTSIDE"
    assert judged(candidate("lag", 5161.0), located=False).word == "NONE"


def test_an_effect_may_leave_2_percent_of_the_misfit_beyond_chance():
    assert judged(candidate("lag", 340.0)).word == "NAMED"
    assert judged(candidate("lag", 340.1)).word == "OUTSIDE"


def test_a_rival_is_within_20_or_leaves_less_than_twice_the_misfit():
    def rival(loss: float, criterion: float) -> bool:
        other = candidate("slip", loss, criterion)
        return other in rivals(Scores(BARE, (LAG, other), NOISE), LAG)  # which leaves 40

    assert not rival(loss=260.0, criterion=250.0)
    assert rival(loss=260.0, criterion=249.9)
    assert rival(loss=259.9, criterion=250.0)


def test_a_second_effect_has_to_take_80_percent():
    one, other = candidate("lag", 280.0), candidate("slip", 3000.0)
    assert leads(one, other, candidate("lag slip", 200.0)) == ("lag", "slip")
    assert leads(one, other, candidate("lag slip", 200.1)) == ("lag",)


def test_a_pair_that_takes_80_percent_keeps_its_doubts():
    one, doubtful = candidate("lag", 280.0), candidate("lag slip", 200.0, on_bound=("slip_mm",))
    found = judged(one, doubtful)
    assert (found.word, found.judged) == ("AMBIGUOUS", ("lag", "slip"))


def test_a_pair_has_to_gain_20():
    one = candidate("lag", 580.0, 600.0)
    assert leads(one, candidate("lag slip", 200.0, 580.0)) == ("lag", "slip")
    assert leads(one, candidate("lag slip", 200.0, 580.1)) == ("lag",)


def test_half_a_percent_of_the_misfit_may_be_for_the_form():
    bare, pair = candidate("", 20_200.0), candidate("lag slip", 200.0, 100.0)
    assert leads(candidate("lag", 300.0), pair, bare=bare) == ("lag",)
    assert leads(candidate("lag", 301.0), pair, bare=bare) == ("lag", "slip")


def test_what_is_small_but_three_times_chance_may_be_a_second_effect():
    bare, pair = candidate("", 200_200.0), candidate("lag slip", 220.0, 100.0)
    assert leads(candidate("lag", 380.0), pair, bare=bare) == ("lag",)
    assert leads(candidate("lag", 381.0), pair, bare=bare) == ("lag", "slip")


def test_then_the_pair_must_leave_what_chance_does():
    bare, one = candidate("", 200_200.0), candidate("lag", 600.0)
    assert leads(one, candidate("lag slip", 260.0, 100.0), bare=bare) == ("lag", "slip")
    assert leads(one, candidate("lag slip", 260.1, 100.0), bare=bare) == ("lag",)


def test_a_pair_without_rivals_has_to_take_60_percent():
    one = candidate("lag", 380.0)
    others = [candidate(f"lag {other}", 360.0) for other in ("slip", "drift", "flow")]
    assert leads(one, candidate("lag slack", 260.0), *others) == ("lag", "slack")
    assert leads(one, candidate("lag slack", 260.1), *others) == ("lag",)


def test_a_second_effect_is_looked_for_where_80_percent_can_be_seen():
    bare = candidate("", 1200.0)
    assert second_effect_possible(Scores(bare, (candidate("lag", 281.0),), NOISE))
    assert not second_effect_possible(Scores(bare, (candidate("lag", 279.0),), NOISE))


def test_what_a_second_effect_could_take_is_measured_from_the_expected_noise():
    """Here another candidate came below it, at the cost of more parameters."""
    bare, lag, below = candidate("", 17_200.0), candidate("lag", 285.0), candidate("flow", 150.0, 400.0)
    assert not second_effect_possible(Scores(bare, (lag, below), NOISE))


@pytest.mark.parametrize(
    ("about", "word"),
    [
        ({"held": {"protocol": Gain(20.0, 10.0), "specimen": Gain(21.0, 10.0)}}, "AMBIGUOUS"),
        ({"held": {"protocol": Gain(21.0, 10.0), "specimen": Gain(21.0, 10.0)}}, "NAMED"),
        ({"gains": (9.0, 0.0)}, "AMBIGUOUS"),
        ({"gains": (9.0, 0.5)}, "NAMED"),
        ({"in_place": InPlace(0.5, 0.4)}, "NAMED"),
        ({"in_place": InPlace(0.49, 0.4)}, "AMBIGUOUS"),
        ({"in_place": InPlace(0.2, 0.1)}, "NAMED"),
        ({"in_place": InPlace(0.19, 0.1)}, "AMBIGUOUS"),
    ],
)
def test_a_check_passes_at_its_threshold_or_just_beyond(about, word):
    assert judged(replace(LAG, **about)).word == word


# ---- what a verdict says


def test_a_name_says_how_much_it_takes_away():
    found = judged(LAG, SLIP)
    assert found.why == "it explains 100 % of the misfit"
    assert found.explained == pytest.approx(4960 / 4980)
    assert judged(candidate("lag", 340.0)).why == "it explains 97 % of the misfit"


def test_no_more_than_all_is_taken_away():
    """The pair's loss is below the noise that single effects show."""
    found = judged(candidate("lag", 1300.0), candidate("slip", 3000.0), candidate("lag slip", 20.0, 40.0))
    assert found.why == "it explains 100 % of the misfit"
    assert found.explained > 1.02


def test_a_misfit_that_chance_may_leave_is_taken_away_in_whole():
    assert judged(candidate("lag", 205.0), bare=candidate("", 250.0)).why == "it explains all of the misfit"


def test_outside_says_what_the_best_takes_and_what_a_name_would():
    found = judged(candidate("lag", 1196.0), SLIP)
    assert found.word == "OUTSIDE"
    alone = "the best single effect (lag) explains 80 % of the misfit; 98 % is needed to name it"
    assert found.why == alone
    assert found.explained == pytest.approx(0.8)
    nearly = judged(candidate("lag", 1290.0), bare=candidate("", 50180.0))
    assert "(lag) explains 97.8 % of the misfit; 98 % is needed" in nearly.why
    weak = candidate("lag slip", 1000.0)
    assert judged(candidate("lag", 1196.0), SLIP, weak).why == (
        f"{alone}, and no second effect clearly takes away 80 % of what it leaves"
    )
    strong = judged(candidate("lag", 2000.0), SLIP, candidate("lag slip", 500.0))
    assert strong.why == "the best pair (lag + slip) explains 94 % of the misfit; 96 % is needed to name it"


def test_rivals_are_named():
    found = judged(LAG, candidate("slip", 225.0, 240.0), candidate("drift", 228.0, 245.0))
    assert found.why == "lag, slip and drift fit about as well as each other"
    assert found.alike == ("lag", "slip", "drift")
    assert found.explained == pytest.approx(4960 / 4980)


@pytest.mark.parametrize(
    ("about", "doubt"),
    [
        (
            {"held": {"protocol": Gain(0.0, 10.0)}},
            "it does not predict what it has not seen better than the model as it is by 2 standard errors "
            "(other tests: 0.0)",
        ),
        (
            {"beyond": {"protocol": Gain(9.0, 1.0), "later cycles": Gain(3.0, 2.0), "specimen": Gain(0.0, 0.0)}},
            "it does not predict what it has not seen better than one of them alone by 2 standard errors "
            "(later cycles: 1.5; another specimen: 0)",
        ),
        (
            {"on_bound": ("lag_s", "slip_mm")},
            "lag_s, slip_mm ended on a bound, so the effect is not the one in the library",
        ),
        ({"gains": (9.0, -1.0, -2.0)}, "it shows in 1 of 3 specimens"),
        ({"in_place": InPlace(0.1, 0.5)}, "most of its improvement lies where model and data do not disagree"),
    ],
)
def test_a_failed_check_is_said(about, doubt):
    found = judged(replace(LAG, **about))
    assert found.why == f"lag fits best, but {doubt}"
    assert found.explained == pytest.approx(4960 / 4980)


def test_a_small_misfit_that_no_cell_shows_is_doubted():
    found = judged(candidate("lag", 205.0), bare=candidate("", 250.0), located=False)
    assert found.why == "lag fits best, but no cell disagrees beyond chance without it"


@pytest.mark.parametrize(
    ("about", "word", "why"),
    [
        ({"located": False}, "NONE", "no cell disagrees beyond chance, and no effect clearly improves the fit"),
        (
            {"surely": False},
            "NONE",
            "some cell disagrees beyond chance, but not far beyond it, and no effect clearly improves the fit",
        ),
        ({"trusted": False}, "AMBIGUOUS", "no two fits of the model as it is agree: more starts are needed"),
        ({}, "OUTSIDE", "model and data disagree, and no effect of the library helps"),
    ],
)
def test_where_no_effect_helps_the_reason_is_said(about, word, why):
    found = judged(candidate("lag", 5170.0), **about)
    assert (found.word, found.why) == (word, why)


def test_a_model_in_the_corner_of_its_ranges_is_not_said_to_be_complete():
    weak = candidate("lag", 5170.0)
    assert judged(weak, located=False, surely=False).word == "NONE"
    found = judged(weak, located=False, surely=False, cornered=("E_f", "E_m"))
    assert (found.word, found.alike) == ("AMBIGUOUS", ())
    assert (
        found.why == "in the model without effects, the data push E_f and E_m to the ends of their ranges: widen these"
    )
    assert judged(weak, located=True, surely=True, cornered=("E_f",)).word == "OUTSIDE"
    assert judged(LAG, cornered=("E_f",)).word == "NAMED", "an effect may be what presses them"


def test_the_next_best_has_as_many_effects():
    pair = candidate("lag slip", 100.0)
    assert next_best(Scores(BARE, (LAG, SLIP, candidate("drift", 4000.0), pair), NOISE), LAG) == SLIP
    assert next_best(Scores(BARE, (LAG, pair), NOISE), LAG) == BARE
