"""What is said of named effects and of what is left."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest

from sinew.runner.console import Console
from sinew.tasks.discover.follow_up import NextExperiment, Part, Remainder, RivalPair
from sinew.tasks.discover.misfit_map import NoiseLevel
from sinew.tasks.discover.page import section
from sinew.tasks.discover.prose import methods
from sinew.tasks.discover.result import Gap, Law, SplitGap
from sinew.tasks.discover.show import in_one_sentence, of_the_law, stack_of, standing, summary
from sinew.tasks.drawing.blocks import Facts
from tests.tasks.discover.results import candidate, discovery

LEFT = Remainder(0.171, (0.12, 0.22), 3.456, True, ("cyclic: unload 1", "cyclic: toe 2"), "")
SOFT = Part("softening", "softening/simo", 0.6, (0.5, 0.7), 900.0, 4.0, "time-lag", 30.0, 3.5, None)
SLACK = Part("toe-slack", "toe-slack", 0.1, (0.05, 0.15), 200.0, 2.5, None, None, None, None)
LAG = Part("time-lag", "time-lag", 0.01, (0.0, 0.02), 20.0, 1.1, None, None, None, "it shows in 1 of 2 specimens")


def partly(*effects, left=LEFT):
    return discovery(
        "PARTLY", effects=effects, shown=effects, parts=(SOFT, SLACK, LAG), remainder=left, explained=0.829
    )


def test_one_sentence_says_what_is_explained_and_what_is_left():
    assert in_one_sentence(partly("softening", "toe-slack")) == (
        "Softening and toe slack explain 83 % of the misfit (78 to 88 %); 17.1 % is left (3.5 N, mostly in "
        "cyclic: unload 1 and cyclic: toe 2)."
    )


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (partly("softening", left=replace(LEFT, cells=())),
         "Softening explains 83 % of the misfit (78 to 88 %); 17.1 % is left (3.5 N)."),
        (partly("a", "b", "c", left=replace(LEFT, share=-0.001, interval=(-0.01, 0.008), beyond_noise=False)),
         "A, b and c explain 100 % of the misfit (99 to 100 %); nothing is left beyond noise."),
        (discovery("OUTSIDE", parts=(LAG,)), ""),
    ],
)  # fmt: skip
def test_numbers_and_sentences_without_what_is_not_there(result, words):
    assert in_one_sentence(result) == words


def test_effects_that_cannot_be_told_apart_are_in_the_sentence():
    doubtful = replace(SLACK, rival="creep", rival_evidence=190.0, doubt="creep would do nearly as well in its place")
    pressed = replace(SOFT, doubt="softening_loss ended on a bound")
    said = in_one_sentence(replace(partly("softening"), parts=(pressed, doubtful, LAG)))
    assert said.endswith("N, mostly in cyclic: unload 1 and cyclic: toe 2). "
                         "Toe slack or creep, which cannot be told apart, would explain 10 %.")  # fmt: skip


def of_largest_strain(*beside):
    gap = Gap("protocol", 5.9, 1.22, 1.05, 0.96)
    return Law(
        ("law/fibres/largest-strain:0.1/power",), ("S_f -> S_f (1 + a x^b)",), beside, 0.612, (0.55, 0.66), {}, gap,
        "discover/law.yaml", "+ effects", ("law/series/force:1000/power",), None,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("loss", "told"), [(24_900.0, ""), (144_000.0, "That is 12 times the noise: the names describe")]
)
def test_names_that_leave_far_more_than_noise_are_told_with_a_caution(loss, told):
    found = discovery("PARTLY", effects=("a",), shown=("a",), remainder=LEFT, candidates=(candidate("a", loss=loss),))
    said = in_one_sentence(found)
    assert ("times the noise" in said) == bool(told) and told in said


def test_a_law_is_told_as_a_description():
    assert of_the_law(discovery("OUTSIDE", law=of_largest_strain())) == (
        "A law describes the misfit: S_f -> S_f (1 + a x^b). It takes away 61 % of the misfit (55 to 66 %); the error "
        "on data that were not fitted falls from 5.90 to 1.22 times the noise. That is a description with predictive "
        "value, not a mechanism."
    )
    beside = replace(partly("softening"), law=of_largest_strain("softening"))
    assert of_the_law(beside).startswith("A law describes what the named effects leave: S_f")
    assert "A law describes what the named effects leave" in methods(beside)
    assert of_the_law(partly("softening")) == ""


def test_the_methods_section_has_the_sentence():
    assert "Softening explains 83 % of the misfit (78 to 88 %)" in methods(partly("softening"))


def test_the_stack_is_all_of_the_misfit():
    both = stack_of(partly("softening", "toe-slack")).set_index("part")["share"]
    assert both.sum() == pytest.approx(1.0)
    assert both["softening"] == 0.6
    assert both["any of these"] == pytest.approx(0.129)
    one = stack_of(partly("softening")).set_index("part")["share"]
    assert one.to_dict() == {"softening": pytest.approx(0.829), "left": pytest.approx(0.171)}


class Folder:
    """A result folder without a store."""

    store = None

    def __init__(self, result):
        self.found = result

    def result(self, _):
        return self.found


def test_names_of_a_model_that_leaves_far_more_than_noise_are_of_these_curves_only():
    far = replace(partly("softening"), candidates=(candidate("softening", loss=144_000.0),))
    assert standing(SOFT, far) == "certain for these curves"
    assert standing(SOFT, partly("softening")) == "certain"
    blocks = section(Folder(far)).blocks
    (facts,) = (each for each in blocks if isinstance(each, Facts))
    assert "other curves may give other names" in dict(facts.rows)["that means"]
    (table,) = (each for each in blocks if getattr(each, "caption", "").startswith("Parameters of softening"))
    assert table.header[-1] == "unit"


def test_the_summary_tells_the_bounds_of_the_candidate_that_the_verdict_is_about():
    first = replace(candidate("friction", loss=1100.0), on_bound=("friction_of_peak",))
    second = replace(candidate("softening", loss=1200.0), on_bound=("softening_rest",))
    assert section(Folder(replace(partly("softening"), candidates=(first, second)))).failed == (
        "on a bound: softening_rest"
    )
    second = replace(second, on_bound=())
    assert section(Folder(replace(partly("softening"), candidates=(first, second)))).failed == ""


def test_the_page_begins_with_the_sentence():
    shown = section(Folder(partly("softening", "toe-slack")))
    assert shown.blocks[0].text.startswith("Softening and toe slack explain")
    assert shown.found.startswith("PARTLY: softening + toe-slack; Softening and toe slack explain 83 %")
    table = next(one for one in shown.blocks if getattr(one, "caption", "").startswith("Effects fitted together"))
    assert [row[-1] for row in table.rows] == [
        "certain",
        "certain",
        "not certain: it shows in 1 of 2 specimens",
    ]
    assert [row[5] for row in table.rows] == ["time-lag (evidence 30, misfit 3.5 times)", "–", "–"]
    (stack,) = (one for one in shown.blocks if getattr(one, "name", "") == "discovery-stack")
    assert len(stack.plots) == 1


def facts_of(result):
    (facts,) = (each for each in section(Folder(result)).blocks if isinstance(each, Facts))
    return dict(facts.rows)


def told(result):
    said = StringIO()
    summary(result, Path("out"), Console(file=said, width=200))
    return said.getvalue()


def test_the_candidate_of_the_verdict_is_in_the_table_of_the_console():
    pairs = [candidate(f"a{i}", "creep", loss=1000.0 + i) for i in range(9)]
    last = candidate("permanent-set", loss=2000.0)
    alike = discovery("AMBIGUOUS", set=("permanent-set",), shown=("permanent-set",), candidates=(*pairs, last))
    assert alike.judged is last
    rows = [line for line in told(alike).splitlines() if line.startswith("│")]
    assert len(rows) == 6, "as many as ever"
    assert "permanent-set" in rows[-1]


@pytest.mark.parametrize(
    ("other", "words"), [(("creep",), "then the wrong one is off by"), ((), "then the model without it is off by")]
)
def test_a_test_to_come_says_which_model_is_off(other, words):
    test = NextExperiment("faster ramp", "stretch", 30.0, 12.0, 4.0, "a/1", RivalPair(("lag",), other), ())
    alike = discovery("AMBIGUOUS", set=("lag",), shown=("lag",), next_experiment=test)
    assert words in " ".join(told(alike).split())
    notes = [each.text for each in section(Folder(alike)).blocks if getattr(each, "tone", "") == "note"]
    assert any(words.replace("then", "Then") in each for each in notes)


def test_noise_that_cannot_be_told_from_a_shape_is_remarked_on():
    assert "mind the noise" not in facts_of(discovery())
    slow = discovery(noise={"a/1": NoiseLevel(1.0, 0.995, 0.0)})
    assert facts_of(slow)["mind the noise"].startswith("that of a/1 changes so slowly")


def test_a_verdict_without_a_set_is_no_verdict_yet():
    assert facts_of(discovery("AMBIGUOUS"))["that means"] == (
        "The fit of the model as it is does not allow a verdict yet."
    )
    one = facts_of(discovery("AMBIGUOUS", set=("lag",)))["that means"]
    assert one == "This effect fits best, but it fails a check; the reason says which."
    several = facts_of(discovery("AMBIGUOUS", set=("lag", "slip")))["that means"]
    assert several == "The data cannot tell the effects of the set apart."


def test_specimens_in_which_an_effect_shows_are_named():
    gains = {"a/1": 780.0, "a/2": -3.0, "b/1": -1.0}
    seen = discovery(
        "AMBIGUOUS", set=("lag",), shown=("lag",), candidates=(replace(candidate("lag", loss=90.0), gains=gains),)
    )
    assert facts_of(seen)["it improves the fit of"] == "a/1, of 3 specimens"
    everywhere = replace(seen, candidates=(replace(seen.candidates[0], gains=dict.fromkeys(gains, 5.0)),))
    assert "it improves the fit of" not in facts_of(everywhere)


@pytest.mark.parametrize(
    ("splits", "told"),
    [
        ({"specimen": (1.006, 0.983, 1.0, 3.76), "protocol": (3.12, 1.5, 1.85, 1.27)},
         "3.12 as it is, 1.50 with a on other tests (a true model: 1.85); gap closed: 1.00"),
        ({"specimen": (1.006, 0.983, 1.0, 3.76)}, "1.01 as it is, a true model 1.00: no gap to close"),
        ({"later cycles": (5.9, 1.22, 1.05, 0.96)},
         "5.90 as it is, 1.22 with a on later cycles (a true model: 1.05); gap closed: 0.96"),
        ({}, None),
    ],
)  # fmt: skip
def test_a_gap_is_told_where_there_is_one(splits, told):
    """An error next to that of a true model leaves no gap, whatever part of it an effect seems to close."""
    every = {kind: SplitGap(*numbers) for kind, numbers in splits.items()}
    found = discovery("NAMED", effects=("a",), shown=("a",), gap=Gap(splits=every))
    assert facts_of(found).get("held-out error, in units of noise") == told


@pytest.mark.parametrize(("loss", "given"), [(4_000.0, True), (144_000.0, False)])
def test_intervals_are_given_only_where_little_but_noise_is_left(loss, given):
    one = candidate("lag", loss=loss, lag_s=(0.1, 0.2))
    alike = discovery("AMBIGUOUS", set=("lag",), shown=("lag",), candidates=(one,))
    blocks = section(Folder(alike)).blocks
    (table,) = (each for each in blocks if getattr(each, "caption", "").startswith("Parameters of lag"))
    assert (table.header[-1] == "to") is given
