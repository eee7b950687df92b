"""The blind benchmark: what a verdict is worth, each row of its table, and what it says of wrong input."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from sinew.runner.errors import BadInput
from sinew.tasks.benchmark import score
from sinew.tasks.benchmark.answers import Answer, read_answers
from sinew.tasks.benchmark.discover import result_of
from sinew.tasks.benchmark.score import (
    Case,
    Median,
    Share,
    by_word,
    class_of,
    medians,
    null_rejected,
    outcome_of,
    shares,
)
from sinew.tasks.benchmark.selectors import SELECTORS, compare, selected
from sinew.tasks.benchmark.show import markdown, tell
from sinew.tasks.discover.follow_up import Remainder
from sinew.tasks.discover.judge.confidence import RECORD, confidence, in_words
from sinew.tasks.discover.result import Gap
from tests.tasks.discover.results import candidate as option
from tests.tasks.discover.results import discovery

FLOOR = 1000.0
SLACK, SOFT, LAG = "toe-slack", "softening", "time-lag"


CLEAR = (option(SLACK, loss=1010.0), option(LAG, loss=4000.0), option(SLACK, LAG, loss=1000.0, free=4))
BLURRED = (option(SLACK, loss=1010.0), option(LAG, loss=1015.0))
NOTHING = (option(SLACK, loss=1000.0), option(LAG, loss=1005.0))
PAIRED = (option(SLACK, loss=3000.0), option(LAG, loss=3500.0), option(SLACK, LAG, loss=1005.0, free=4))


def judged(word, options, null=5000.0, effects=(), alike=(), closed=None):
    """A discovery with these candidates, whose gains are over the model without effects."""
    if effects and set(effects) not in [set(one.effects) for one in options]:
        options = (*options, option(*effects, loss=null))
    candidates = tuple(replace(one, gain=null - one.loss - 8.0 * one.free) for one in options)
    gap = Gap("protocol", 2.0, 1.0, 1.0, closed)
    return discovery(word, null, FLOOR, effects=tuple(effects), set=tuple(alike), candidates=candidates, gap=gap)


def case(truth, word, effects=(), alike=(), options=CLEAR, null=5000.0, closed=None, **more):
    truth = (truth,) if isinstance(truth, str) else tuple(truth)
    answer = Answer("folder", "case_01", truth, same_form=more.pop("same_form", {}))
    return Case(answer, judged(word, options, null, effects, alike, closed), **more)


def named(truth, *effects, **more):
    return case(truth, "NAMED", effects, **more)


FAILED = Case(Answer("folder", "case_02", (SLACK,)), None, None, "boom")
NO_MISFIT = {"null": 1010.0, "options": NOTHING}


@pytest.mark.parametrize(
    ("one", "kind"),
    [
        (named(SLACK, SLACK), "detectable"),
        (named(SLACK, LAG), "detectable"),
        (case(SLACK, "NONE"), "detectable"),
        (named(SLACK, SLACK, options=BLURRED), "indistinguishable"),
        (named(SLACK, SLACK, **NO_MISFIT), "undetectable"),
        (case("OUTSIDE", "OUTSIDE"), "outside"),
        (case("OUTSIDE", "OUTSIDE", **NO_MISFIT), "undetectable"),
        (named((SLACK, LAG), SLACK, options=PAIRED), "two effects"),
        (named((SLACK, LAG), SLACK, **NO_MISFIT), "undetectable"),
        (named((), SLACK), "null"),
        (named(SOFT, SLACK), "not a candidate"),
        (FAILED, "failed"),
    ],
)
def test_what_could_have_been_seen_is_judged_without_the_verdict(one, kind):
    assert class_of(one) == kind
    if one.result:
        for word in ("NONE", "AMBIGUOUS", "OUTSIDE"):
            assert class_of(replace(one, result=replace(one.result, verdict=word, effects=(), set=()))) == kind


def test_a_truth_of_another_form_must_be_clearly_better_than_its_rivals():
    """What it leaves itself counts: 1,000 beyond noise against 1,500 is a clear likelihood, and no clear difference."""
    worse = (option(SLACK, loss=2000.0), option(LAG, loss=2500.0))
    assert class_of(named(SLACK, SLACK, options=worse)) == "indistinguishable"
    assert class_of(named(SLACK, SLACK, options=(worse[0], option(LAG, loss=3100.0)))) == "detectable"
    assert class_of(named(LAG, SLACK, options=worse)) == "indistinguishable"


def test_a_gain_far_beyond_chance_rejects_the_model_even_where_its_misfit_is_within_noise():
    assert null_rejected(judged("NONE", (option(SLACK, loss=1000.0),), null=1100.0))
    assert not null_rejected(judged("NONE", (option(SLACK, loss=1000.0),), null=1030.0))
    assert null_rejected(judged("NONE", (option(SLACK, loss=1299.0),), null=1300.0))


@pytest.mark.parametrize(
    ("one", "outcome"),
    [
        (named(SLACK, SLACK), "right"),
        (named(SLACK, LAG), "wrong name"),
        (named(SLACK, SLACK, LAG), "wrong name"),
        (case(SLACK, "AMBIGUOUS", alike=(SLACK, LAG)), "open"),
        (case(SLACK, "AMBIGUOUS", alike=(LAG, SOFT)), "astray"),
        (case(SLACK, "OUTSIDE"), "astray"),
        (case(SLACK, "NONE"), "missed"),
        (case(SLACK, "AMBIGUOUS", alike=(SLACK, LAG), options=BLURRED), "right"),
        (case(SLACK, "NONE", **NO_MISFIT), "right"),
        (case(SLACK, "AMBIGUOUS", alike=(LAG,), **NO_MISFIT), "right"),
        (case(SLACK, "OUTSIDE", **NO_MISFIT), "astray"),
        (named(SLACK, LAG, **NO_MISFIT), "wrong name"),
        (case((), "NONE"), "right"),
        (case((), "AMBIGUOUS"), "right"),
        (case((), "AMBIGUOUS", alike=(SLACK,)), "false alarm"),
        (case((), "OUTSIDE"), "false alarm"),
        (named((), SLACK), "wrong name"),
        (case("OUTSIDE", "OUTSIDE"), "right"),
        (case("OUTSIDE", "AMBIGUOUS", alike=(SLACK,)), "missed"),
        (named("OUTSIDE", SLACK), "wrong name"),
        (named((SLACK, LAG), SLACK, LAG, options=PAIRED), "right"),
        (named((SLACK, LAG), LAG, SLACK, options=PAIRED), "right"),
        (named((SLACK, LAG), SLACK, options=PAIRED), "one of two"),
        (named((SLACK, LAG), SOFT, options=PAIRED), "wrong name"),
        (case((SLACK, LAG), "AMBIGUOUS", alike=(SLACK, LAG, SOFT), options=PAIRED), "open"),
        (case((SLACK, LAG), "AMBIGUOUS", alike=(SLACK, SOFT), options=PAIRED), "astray"),
        (case(SOFT, "OUTSIDE"), "right"),
        (FAILED, "failed"),
    ],
)
def test_what_a_verdict_is_worth(one, outcome):
    assert outcome_of(one) == outcome


def compound(truth, beside, word, effects=(), left=True, **more):
    """A case of several effects (by strength) and something ``beside``, and a verdict on it."""
    answer = Answer("folder", "case_03", tuple(truth), strength={**truth, **beside}, beside=tuple(beside))
    found = judged(word, CLEAR, effects=effects, **more)
    rest = Remainder(0.1, (0.05, 0.15), 2.0, left, (), "") if effects else None
    return Case(answer, replace(found, remainder=rest))


BOTH, ONE = {SLACK: 2.0, LAG: 1.5}, {SLACK: 2.0, LAG: 1.4}
THERMAL = {"thermal": 1.5}


@pytest.mark.parametrize(
    ("one", "outcome"),
    [
        (compound(BOTH, {}, "PARTLY", (SLACK, LAG)), "right"),
        (compound(BOTH, {}, "NAMED", (SLACK, LAG)), "right"),
        (compound(BOTH, THERMAL, "PARTLY", (SLACK,)), "some of them"),
        (compound(ONE, THERMAL, "PARTLY", (SLACK,)), "right"),
        (compound(ONE, THERMAL, "PARTLY", (LAG,)), "missed"),
        (compound(BOTH, THERMAL, "PARTLY", (SLACK, SOFT)), "wrong name"),
        (compound(BOTH, THERMAL, "OUTSIDE"), "missed"),
        (compound({LAG: 0.2}, THERMAL, "OUTSIDE"), "right"),
        (compound({}, THERMAL, "NONE"), "right"),
    ],
)
def test_what_a_verdict_on_several_effects_is_worth(one, outcome):
    assert class_of(one) == "compound"
    assert outcome_of(one) == outcome


def test_rows_of_compound_cases_count_effects_and_names():
    found = rows(
        compound(BOTH, THERMAL, "PARTLY", (SLACK,)),
        compound(BOTH, THERMAL, "NAMED", (SLACK, SOFT), left=False),
        compound(ONE, {"thermal": 1.4}, "NONE"),
        compound({}, THERMAL, "OUTSIDE"),
        compound({}, THERMAL, "NAMED", (SLACK,)),
        compound({}, THERMAL, "NONE"),
    )
    assert found["compound: effects of strength 1.5 or more that are named"] == (2, 5)
    assert found["compound: names of effects that are not there"] == (2, 4)
    assert found["compound: something else of strength 1.5 or more is said to be left"] == (3, 5)
    assert found["PARTLY: every name was true"] == (1, 1)
    assert found["named correctly, all single effects"] == (0, 0), "other rows are of other cases"


def test_a_right_name_with_a_remainder_counts_as_a_name():
    assert outcome_of(case(SLACK, "PARTLY", (SLACK,))) == "right"
    assert outcome_of(case(SLACK, "PARTLY", (LAG,))) == "wrong name"
    assert outcome_of(case((), "PARTLY", (LAG,))) == "wrong name"
    assert outcome_of(case("OUTSIDE", "PARTLY", (LAG,))) == "wrong name"
    found = rows(case(SLACK, "PARTLY", (SLACK,), closed=0.5))
    assert found["named correctly, all single effects"] == (1, 1)


def test_what_the_library_has_by_now_is_an_effect(tmp_path):
    answers = {"truth": [LAG], "outside": ["creep", "thermal"], "strength": {LAG: 1.0, "creep": 3.0, "thermal": 2.0}}
    (tmp_path / "case_01").mkdir()
    (tmp_path / "answers.json").write_text(json.dumps({"case_01": answers}))
    (found,) = read_answers(tmp_path)
    assert (found.truth, found.beside, found.compound) == ((LAG, "creep"), ("thermal",), True)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"outside": "creep"}, "outside: 'creep'; expected a list of names"),
        ({"strength": {LAG: "much"}}, "strength.time-lag: 'much'; expected a finite number"),
        ({"strength": {LAG: 1.0}, "outside": ["thermal"]}, "strength.thermal: missing"),
    ],
)
def test_compound_answers_that_cannot_be_used(tmp_path, changes, words):
    (tmp_path / "case_01").mkdir()
    (tmp_path / "answers.json").write_text(json.dumps({"case_01": {"truth": [LAG], **changes}}))
    with pytest.raises(BadInput, match=re.escape(words)):
        read_answers(tmp_path)


def rows(*cases):
    return {row.name: (row.count, row.of) for row in shares(cases)}


CASES = (
    named(SLACK, SLACK, closed=0.9, seconds=10.0),
    named(SLACK, LAG, closed=0.5, seconds=30.0),
    case(SLACK, "AMBIGUOUS", alike=(SLACK, LAG)),
    case(SLACK, "AMBIGUOUS", alike=(LAG,), options=BLURRED),
    case(SLACK, "NONE", **NO_MISFIT),
    named((), LAG, closed=None),
    case((), "NONE", seconds=20.0),
    case((), "NONE"),
    case("OUTSIDE", "OUTSIDE"),
    case("OUTSIDE", "NONE"),
    case("OUTSIDE", "NONE", **NO_MISFIT),
    named((SLACK, LAG), SLACK, LAG, options=PAIRED),
    named((SLACK, LAG), SOFT, options=PAIRED),
    case((SLACK, LAG), "AMBIGUOUS", alike=(SLACK, LAG), options=PAIRED),
    named((SLACK, LAG), SLACK, options=(option(SLACK, loss=1100.0), *PAIRED[1:])),
    FAILED,
)


def test_each_row_of_the_table_counts_what_it_says():
    assert rows(*CASES) == {
        "named correctly, clearly detectable single effects": (1, 4),  # a failed case counts against it
        "wrong confident name, all but two effects": (2, 11),
        "false alarm on nulls": (1, 3),
        "truth inside the set when AMBIGUOUS": (2, 3),
        "outside the library, called OUTSIDE": (1, 2),
        "both of two effects named": (1, 4),
        "both of two effects named, where one alone is rejected": (1, 3),
        "wrong confident name, two effects": (1, 4),
        "named correctly, all single effects": (1, 6),
        "NONE or AMBIGUOUS where nothing can be seen": (2, 2),
        "90 % interval holds the effect's parameter (same form)": (0, 0),
        "NAMED: every name was true": (3, 6),
        "PARTLY: every name was true": (0, 0),
        "AMBIGUOUS: something was there, and all of it in the set": (2, 3),
        "OUTSIDE: the library did not have what was there": (1, 1),
        "NONE: there was nothing, or nothing that could be seen": (4, 5),
    }
    closed, seconds = medians(CASES)
    assert (closed.median, closed.values) == (0.7, (0.9, 0.5))
    assert (seconds.median, seconds.range) == (20.0, (10.0, 30.0))


def test_intervals_are_those_of_clopper_and_pearson(monkeypatch):
    low, high = Share("", 0, 10).interval
    assert (low, high) == pytest.approx((0.0, 1 - 0.025 ** (1 / 10)))
    assert Share("", 3, 10).interval == pytest.approx((0.0667, 0.6525), abs=1e-4)
    assert (Share("", 0, 0).share, Share("", 0, 0).interval) == (None, None)
    values = tuple(np.random.default_rng(1).normal(5.0, 1.0, 40))
    low, high = Median("", values).interval
    assert low < np.median(values) < high
    assert high - low < 1.5
    monkeypatch.setattr(score, "AT_ONCE", 10 * len(values))
    assert Median("", values).interval == (low, high), "drawn in blocks"
    assert (Median("", ()).median, Median("", (1.0,)).interval) == (None, None)


def test_intervals_of_parameters_count_where_the_form_is_the_librarys_and_the_name_is_right():
    options = (option(SLACK, loss=1010.0, slack_stretch=(0.98, 0.99)), option(LAG, loss=4000.0, force_lag=(0.1, 0.2)))
    name = "90 % interval holds the effect's parameter (same form)"
    right = named(SLACK, SLACK, options=options, same_form={"slack_stretch": 0.985})
    assert rows(right)[name] == (2, 2)
    assert rows(replace(right, answer=replace(right.answer, same_form={"slack_stretch": 0.992})))[name] == (0, 2)
    assert rows(replace(right, answer=replace(right.answer, same_form={})))[name] == (0, 0)
    assert rows(named(SLACK, LAG, options=options, same_form={"slack_stretch": 0.985}))[name] == (0, 0)
    assert rows(case(SLACK, "NONE", options=options, same_form={"slack_stretch": 0.985}))[name] == (0, 0)


def test_selectors_take_the_smallest_number():
    options = (
        option(SLACK, loss=1010.0, held_out=50.0),
        option(LAG, loss=1005.0, free=6, held_out=90.0),
        option(SLACK, LAG, loss=1000.0, free=8),
    )
    one = judged("NONE", options)
    training, aic, bic, held_out = (number for _, number in SELECTORS)
    assert selected(one, training, singles=False) == (SLACK, LAG)
    assert selected(one, training, singles=True) == (LAG,)
    assert selected(one, aic, singles=True) == (SLACK,)
    assert selected(one, bic, singles=False) == (SLACK,)
    assert selected(one, held_out, singles=False) == (LAG,)
    assert selected(judged("NONE", options, null=1012.0), bic, singles=False) == ()
    assert selected(judged("NONE", options, null=1012.0), training, singles=True) == (LAG,)


def test_selectors_are_compared_on_the_same_cases():
    told = {row.name: row for row in compare(CASES)}
    own = told["sinew discover (names)"]
    assert [(row.count, row.of) for row in (own.right, own.wrong, own.alarms)] == [(1, 3), (2, 11), (1, 3)]
    bic = told["smallest BIC, one effect"]
    assert (bic.right.count, bic.right.of) == (3, 3)
    assert (bic.alarms.count, bic.alarms.of) == (3, 3), "the made-up nulls have candidates that fit far better"
    assert told["smallest training error, one or two effects"].right.count == 0


def test_how_often_each_word_was_true():
    said = [
        named(SLACK, SLACK),
        named((SLACK, LAG), SLACK, options=PAIRED),
        named((), SLACK),
        case(SLACK, "PARTLY", (SLACK,)),
        case("OUTSIDE", "PARTLY", (SLACK,)),
        case((), "NONE"),
        case(SLACK, "NONE"),
        case("OUTSIDE", "OUTSIDE"),
        case(SLACK, "OUTSIDE"),
        case(SOFT, "OUTSIDE"),
        case((), "AMBIGUOUS", alike=(SLACK,)),
        case(SLACK, "AMBIGUOUS", alike=(SLACK, LAG), options=BLURRED),
        FAILED,
    ]
    counted = {word: (row.count, row.of) for word, row in by_word(said).items()}
    assert counted == {"NAMED": (2, 3), "PARTLY": (1, 2), "NONE": (1, 2), "OUTSIDE": (2, 3), "AMBIGUOUS": (1, 2)}


def test_a_verdict_is_worth_what_others_of_its_word_were():
    found = confidence("OUTSIDE")
    true, of = RECORD["OUTSIDE"]
    assert found.share == true / of
    assert found.interval == Share("", true, of).interval
    assert found.interval[0] < found.share < found.interval[1]
    assert f"{true} of {of} such verdicts were true" in in_words(found)


def test_the_table_is_told_and_written(capsys):
    result = json.loads(json.dumps(result_of(CASES, mixed=1)))
    tell(result, Console(width=200, highlight=False))
    said = capsys.readouterr().out
    text = markdown(result)
    for shown in (said, text):
        assert "boom" in shown
        assert "25 %" in shown
        assert "1 of 4" in shown
        assert "3 detectable" in shown
        assert "new --out" in shown
    assert text.count("| folder/case_01 |") == len(CASES) - 1
    assert "| false alarm on nulls | 33 % | 1 to 91 % | 1 of 3 |" in text
