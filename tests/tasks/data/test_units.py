"""Units have one factor, whatever their case, and ambiguous ones have none."""

import pytest

from sinew.tasks.data import units


@pytest.mark.parametrize(
    ("table", "unit", "factor"),
    [
        (units.TIME, "min", 60.0),
        (units.TIME, "S", 1.0),
        (units.TIME, "MS", 1e-3),
        (units.LENGTH, "µm", 1e-3),
        (units.LENGTH, "μm", 1e-3),  # the Greek letter in place of the sign for micro
        (units.FORCE, "mN", 1e-3),
        (units.FORCE, "KN", 1e3),
        (units.FORCE, "lbf", 4.4482216152605),
        (units.STRESS, "mpa", 1.0),
        (units.STRESS, "KPa", 1e-3),
        (units.STRESS, "N/mm²", 1.0),
        (units.FRACTION, "%", 0.01),
        (units.FRACTION, "l/l0", 1.0),
        (units.FRACTION, "％", 0.01),
        (units.LENGTH, "ｍｍ", 1.0),
        (units.LENGTH, "mils", 0.0254),
        (units.TIME, "分钟", 60.0),
        (units.FORCE, "lbs", 4.4482216152605),
        (units.FORCE, "OZF", 0.27801385095378125),
        (units.STRESS, "kgf/cm²", 0.0980665),
        (units.STRESS, "N/m^2", 1e-6),
        (units.STRESS, "ksi", 6.894757293168),
        (units.AREA, "µm²", 1e-6),
    ],
)
def test_a_unit_has_its_factor(table, unit, factor):
    assert units.factor(table, unit) == factor
    assert units.is_unit(unit)


@pytest.mark.parametrize(
    ("table", "unit"),
    [
        (units.FORCE, "mn"),
        (units.FORCE, "MN"),
        (units.FORCE, "Mn"),
        (units.STRESS, "mPa"),
        (units.STRESS, "ｍＰａ"),
        (units.STRESS, "Mbar"),
        (units.FORCE, "stone"),
        (units.TIME, "mm"),
    ],
)
def test_a_unit_that_is_ambiguous_or_of_another_quantity_has_none(table, unit):
    assert units.factor(table, unit) is None


def test_which_units_belong_to_another_quantity():
    assert units.belongs_elsewhere(units.LENGTH, "N")
    assert not units.belongs_elsewhere(units.FORCE, "N")
    assert not units.belongs_elsewhere(units.FORCE, "cats")
    assert not units.belongs_elsewhere(units.FORCE, "1"), "a bare number belongs to no quantity"


def test_choices_name_each_unit_once():
    names = units.merged([units.FRACTION, units.NUMBER, units.LENGTH])
    assert len(set(names)) == len(names)
    assert {"%", "1", "mm"} <= set(names)


@pytest.mark.parametrize("unit", ["mn", "MN", "mPa"])
def test_spellings_that_may_be_milli_or_mega(unit):
    assert units.ambiguous(unit)
    assert units.is_unit(unit)


@pytest.mark.parametrize("unit", ["mN", "MPa", "N", "Mn"])
def test_spellings_that_are_clear(unit):
    assert not units.ambiguous(unit)


def test_what_is_no_unit():
    assert not units.is_unit("cats")
    assert not units.is_unit("")


def test_a_bare_number_and_a_ratio_belong_to_no_other_quantity():
    assert not units.belongs_elsewhere(units.FORCE, "mm/mm")
    assert units.belongs_elsewhere(units.FORCE, "%")
    assert not units.belongs_elsewhere(units.FRACTION, "%")


def test_units_are_listed_in_the_order_of_their_tables():
    assert units.merged([{"a": 1.0, "b": 2.0}, {"c": 1.0, "a": 3.0}]) == ("a", "b", "c")


@pytest.mark.parametrize(
    ("unit", "rate"),
    [("mm/s", True), ("%/min", True), ("N / sec", True), ("mm/mm", False), ("N/mm2", False), ("s", False), ("", False)],
)
def test_a_rate_is_a_unit_over_one_of_time(unit, rate):
    assert units.is_rate(unit) == rate


def test_a_long_text_is_no_unit():
    assert units.factor(units.LENGTH, "mm".ljust(41)) is None
    assert not units.is_unit("m" * 100_000)


@pytest.mark.parametrize(
    ("table", "unit", "factor"),
    [
        (units.STRESS, "MN/m2", 1.0), (units.STRESS, "MN/m²", 1.0), (units.STRESS, "mN/m2", None),
        (units.STRESS, "kN/m^2", 1e-3), (units.STRESS, "lbf/in2", 6.894757293168e-3),
        (units.FORCE, "kip", 4448.2216152605), (units.FRACTION, "microstrain", 1e-6), (units.FRACTION, "µε", 1e-6),
        (units.FRACTION, "mm/m", 1e-3), (units.TIME, "sn", 1.0),
    ],
)  # fmt: skip
def test_units_that_are_seldom_used(table, unit, factor):
    assert units.factor(table, unit) == factor
