"""How numbers, units and names are written for a person."""

import math

import pytest

from sinew.tasks.drawing.blocks import behind, duration, largest, number, percent, span, times, with_its_unit


def test_a_unit_stands_behind_a_number_and_in_brackets_behind_a_name():
    assert [f"3{behind(unit)}" for unit in ("mm", "1")] == ["3 mm", "3"]
    assert [with_its_unit("width change", unit) for unit in ("mm", "1")] == ["width change (mm)", "width change"]


def test_a_span_of_numbers_that_are_written_alike_is_one_number():
    assert span([3.3, 3.1, 3.2]) == "3.1 to 3.3"
    assert span([3.2001, 3.2002]) == span([3.2]) == "3.2"
    assert span([3.2001, 3.2002], digits=5) == "3.2001 to 3.2002"


def test_the_largest_come_first_and_what_is_unknown_last():
    assert largest(["a", "b", "c", "d"], [0.1, math.nan, 0.5, -2.0]) == "c 0.5, a 0.1, d -2"
    assert largest(["a"], [1.0]) == "a 1"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(None, "–"), (0.25, "0.25 s"), (119, "119 s"), (150, "2.5 min"), (7200, "2.0 h"), (200_000, "2.3 d")],
)
def test_a_duration_has_the_unit_that_suits_it(seconds, words):
    assert duration(seconds) == words


@pytest.mark.parametrize(("above", "words"), [(0.0034, "1.003"), (0.0, "1"), (30.25, "31.25"), (None, "–")])
def test_so_many_times_a_reference(above, words):
    assert times(above) == words


@pytest.mark.parametrize(
    ("part", "words"),
    [(0.876, "88 %"), (-0.2, "-20 %"), (-9.5, "-950 %"), (-3.2e95, "below -1000 %"), (None, "–"), (math.nan, "–")],
)
def test_a_part_far_below_zero_is_only_that(part, words):
    assert percent(part) == words


@pytest.mark.parametrize(("value", "words"), [(-2.83e128, "-2.83e+128"), (2e15, "2e+15"), (12_345_678, "12,345,678")])
def test_huge_numbers_have_a_power_of_ten(value, words):
    assert number(value) == words
