"""How far a verdict can be trusted is said with the record's numbers and their interval."""

import pytest

from sinew.tasks.discover.judge.confidence import MEANING, RECORD, clopper_pearson, confidence, in_words


def test_an_interval_is_that_of_the_tables():
    """Five of six, and all of 55: Clopper and Pearson's exact 95 % intervals."""
    assert clopper_pearson(5, 6) == pytest.approx((0.3588, 0.9958), abs=1e-4)
    assert clopper_pearson(55, 55) == pytest.approx((0.9351, 1.0), abs=1e-4)


TRUE = "such verdicts were true in the blind benchmark of virtual specimens, when the library had 16 effects"


@pytest.mark.parametrize("word", RECORD)
def test_a_confidence_is_what_the_record_says_of_the_word(word):
    true, of = RECORD[word]
    found = confidence(word)
    assert (found.means, found.true, found.of) == (MEANING[word], true, of)
    assert found.share == true / of
    assert found.interval == clopper_pearson(true, of)


@pytest.mark.parametrize(
    ("word", "words"),
    [
        (
            "AMBIGUOUS",
            f"5 of 6 {TRUE} (95 %: 36 to 100 %); true means: ",
        ),
        (
            "OUTSIDE",
            f"6 of 9 {TRUE} (95 %: 30 to 93 %); true means: ",
        ),
        (
            "NONE",
            f"30 of 31 {TRUE} (95 %: 83 to 100 %); true means: ",
        ),
    ],
)
def test_it_is_said_in_one_line(word, words):
    assert in_words(confidence(word)) == words + MEANING[word]


def test_the_record_of_a_partial_verdict_is_that_of_the_larger_library():
    true, of = RECORD["PARTLY"]
    said = in_words(confidence("PARTLY"))
    assert said.startswith(
        f"{true} of {of} such verdicts were true in virtual specimens with one or several effects, with 21 "
    )
