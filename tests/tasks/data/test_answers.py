"""Answers are read as they were written; what is given now goes before them; files with anything else are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.answers import Answers, read_answers, with_answers, write_answers
from sinew.tasks.data.hints import Hints
from sinew.tasks.study.settings_file import from_yaml

TEXTS = st.none() | st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1, max_size=8)
SIZES = st.dictionaries(st.sampled_from(["length", "width", "thickness"]), st.floats(0.01, 9999), min_size=1)


@given(TEXTS, TEXTS, st.none() | st.floats(0.1, 1e4), st.dictionaries(st.sampled_from(["T1", "a/2"]), SIZES))
def test_answers_are_read_as_they_were_written(tmp_path_factory, force_unit, test_column, rate, sizes):
    path = tmp_path_factory.mktemp("answers") / "answers.yaml"
    answers = Answers(Hints(test_column=test_column, rate_hz=rate), sizes, Hints(force_unit=force_unit))
    write_answers(path, answers)
    if answers == Answers():
        assert not path.exists()
    else:
        assert read_answers(path) == answers


def test_what_is_given_now_goes_before_answers():
    kept = Hints(force_unit="N", time_unit="s", rate_hz=10.0)
    assert with_answers(Hints(force_unit="kN"), kept) == Hints(force_unit="kN", time_unit="s", rate_hz=10.0)
    assert with_answers(Hints(speed=1.0), kept) == Hints(force_unit="N", time_unit="s", speed=1.0)
    assert with_answers(Hints(time_column="t"), kept).rate_hz is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("force: N", "line 1, force: unknown"),
        ("specimens: {T1: {length_mm: 0}}", "specimens.T1.length_mm: 0; expected at least 1e-06"),
        ("specimens: {T1: {length_mm: ten}}", "specimens.T1.length_mm: 'ten'; expected a number"),
        ("specimens: {T1: {length_mm: .nan}}", "specimens.T1.length_mm: nan; expected a number below 10000"),
        ("specimens: {T1: {length_mm: 1e300}}", "specimens.T1.length_mm: 1e+300; expected below 10000"),
        ("specimens: T1", "specimens: 'T1'; expected a mapping of names to settings"),
        ("rate_hz: -1", "--rate-hz: -1"),
        ("negate: everything", "negate"),
        ("zero_force: 3", "zero_force"),
        ("answered: {force: N}", "answered.force"),
        ("answered: kN", "answered"),
        ("confirmed: {displacement: 3}", "confirmed.displacement: 3; expected a list"),
        ("- a", "not a mapping"),
        ("a: !!python/object:os.system x", "the tag"),
    ],
)
def test_what_is_no_answer_is_refused(tmp_path, text, words):
    path = tmp_path / "answers.yaml"
    path.write_text(text)
    with pytest.raises(BadInput) as refused:
        read_answers(path)
    assert words in str(refused.value)


@pytest.mark.parametrize(("text", "mm"), [("020", 20.0), ("08", 8.0), ("0x14", 20.0), ("1_0", 10.0), ("007.5", 7.5)])
def test_a_size_that_begins_with_zero_is_decimal(tmp_path, text, mm):
    path = tmp_path / "answers.yaml"
    path.write_text(f"specimens: {{T1: {{length_mm: {text}}}}}")
    assert read_answers(path).sizes == {"T1": {"length": mm}}


@pytest.mark.parametrize(
    ("text", "number"),
    [("020", 20), ("-08", -8), ("+1_0", 10), ("0x1F", 31), ("-0b11", -3), ("0", 0), ("007.5", 7.5), ("0o17", "0o17")],
)
def test_whole_numbers_are_decimal_unless_they_say_so(text, number):
    found = from_yaml(f"a: {text}")["a"]
    assert (found, type(found)) == (number, type(number))


@pytest.mark.parametrize("text", ["0E0", "1e3", "012", "no", "4:00:00", "2026-11-24", ".5", "true", "null"])
def test_a_title_that_looks_like_a_number_stays_a_text(tmp_path, text):
    write_answers(tmp_path / "answers.yaml", Answers(Hints(test_column=text), {}))
    assert read_answers(tmp_path / "answers.yaml").hints.test_column == text
