"""Which effects are certain beside a remainder: each condition alone makes an effect doubtful."""

from dataclasses import replace

import pytest

from sinew.tasks.discover.judge.partly import Form, InPlace, Worth, doubts, outdone, partly
from sinew.tasks.discover.judge.scores import Score, Scores

SLOWER = InPlace("time-lag", 40.0, 2.5)
SURE = Worth("softening", (60.0, 70.0), 3.0, (SLOWER,))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, None),
        ({"gains": (25.0, 24.9), "rivals": ()}, "a smooth error of the model would do nearly as well"),
        ({"gains": (25.0, 25.1), "rivals": ()}, None),
        ({"gains": (130.0, -0.1)}, "it shows in 1 of 2 specimens"),
        ({"gains": (130.0,)}, None),
        ({"gains": (130.0, 5.0, -5.0)}, None),
        ({"ratio": 1.99}, "without it, the other effects leave hardly more misfit"),
        ({"ratio": 2.0}, None),
        ({"rivals": (replace(SLOWER, gain=80.1),)}, "time-lag would do nearly as well in its place"),
        ({"rivals": (replace(SLOWER, gain=79.9),)}, None),
        ({"rivals": (replace(SLOWER, gain=-500.0, ratio=1.99),)}, "time-lag would do nearly as well in its place"),
        ({"rivals": (replace(SLOWER, ratio=2.0),)}, None),
        ({"rivals": (SLOWER, InPlace("creep", 100.0, 2.2))}, "creep would do nearly as well in its place"),
        ({"form": Form("creep", 0.0201)}, None),
        ({"form": Form("creep", 0.0136)}, "creep leaves 1.4 % without it, which another form of creep may explain"),
        (
            {"pressed": ("softening_loss",)},
            "softening_loss ended on a bound, so the effect is not the one in the library",
        ),
    ],
)
def test_each_condition_alone_makes_an_effect_doubtful(changes, words):
    assert next(doubts(replace(SURE, **changes)), None) == words


FLOOR = 1000.0
BARE = Score((), 5000.0, 5000.0)


@pytest.mark.parametrize(
    ("loss", "word", "why"),
    [
        (1100.0, "NAMED", "together they explain 98 % of the misfit, and no other effect would do in the place of one"),
        (1200.0, "PARTLY", "they explain 95 % of the misfit; the rest is left"),
        (3000.0, "PARTLY", "they explain 50 % of the misfit; the rest is left"),
    ],
)
def test_a_name_with_a_remainder_is_partly(loss, word, why):
    both = Score(("softening", "time-lag"), loss + 30.0, loss)
    found = partly(Scores(BARE, (both,), FLOOR), both)
    assert (found.word, found.effects, found.judged, found.why) == (word, both.effects, both.effects, why)
    assert found.named and found.explained == pytest.approx((5000.0 - loss) / 4000.0)


def test_a_single_effect_explains_in_the_singular():
    one = Score(("time-lag",), 3000.0, 2980.0)
    assert partly(Scores(BARE, (one,), FLOOR), one).why.startswith("it explains")


def test_the_nearest_rival_is_the_one_that_leaves_least():
    assert replace(SURE, rivals=(SLOWER, InPlace("creep", 10.0, 2.2))).nearest.effect == "creep"
    assert replace(SURE, rivals=()).nearest is None


@pytest.mark.parametrize(
    ("others", "found"),
    [
        ([], {}),
        ([Score(("friction", "time-lag"), 0.0, 2500.0)], {"softening": "friction"}),
        ([Score(("time-lag", "creep"), 0.0, 2000.0), Score(("friction", "time-lag"), 0.0, 2500.0)],
         {"softening": "creep"}),
        ([Score(("friction", "time-lag"), 0.0, 2500.0, on_bound=("friction_of_peak",))], {}),
        ([Score(("friction", "time-lag"), 0.0, 2900.0)], {}),  # by chance
        ([Score(("friction", "time-lag"), 0.0, 3000.0), Score(("friction",), 0.0, 100.0)], {}),
        ([Score(("friction", "creep"), 0.0, 100.0), Score(("friction", "softening", "time-lag"), 0.0, 9.0)], {}),
        ([Score(("softening", "creep"), 0.0, 2500.0), Score(("friction", "time-lag"), 0.0, 2600.0)],
         {"time-lag": "creep", "softening": "friction"}),
    ],
)  # fmt: skip
def test_an_effect_in_whose_place_another_leaves_less_is_outdone(others, found):
    both = Score(("softening", "time-lag"), 0.0, 3000.0)
    assert outdone(("time-lag", "softening"), Scores(BARE, (both, *others), FLOOR)) == found
