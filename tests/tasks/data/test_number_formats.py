"""How number formats show numbers."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.tasks.data.number_formats import OTHERWISE, PERCENT, THOUSANDS, UNCLEAR, WITH, differs, shown_by
from tests.effort import at_most


@pytest.mark.parametrize(
    ("code", "unit"),
    [
        ('0.00" kN"', "kN"),
        (r"0.00\ [$kN]", "kN"),
        ("0.00 [$kN-409]", "kN"),
        ("[$kN] 0.00", "kN"),
        ('"kN "0.00', "kN"),
        (r"0.00\ \k\N", "kN"),
        ('0.00" "[$k]"N"', "kN"),
        ('0.00;-0.00" kN"', "kN"),
        ('[<1]0.00" N";0.00" kN"', "N or kN"),
        ('0.0" mm2"', "mm2"),
        ('0.0" mm^2"', "mm^2"),
        ("0.0\\°", "°"),
    ],
)
def test_units_are_found_wherever_a_format_writes_them(code, unit):
    assert shown_by(code) == WITH + unit


@pytest.mark.parametrize(
    "code",
    [
        '0.00" ×1000"',
        '0.00"000"',
        '"-"0.00',
        r"\-0.00",
        "-0.00",
        "(0.00)",
        "0.00-",
        "\u22120.00",
        '0"."000',
        r"0\.00",
        r"0\,00",
        "0:00;0.00",
        '"1"0.00',
    ],
)
def test_other_signs_digits_and_marks_are_told(code):
    assert shown_by(code) == OTHERWISE


@pytest.mark.parametrize(
    "code",
    [
        "General",
        "0.00",
        "#,##0.00",
        r"#\ ##0.00",
        "#'##0.00",
        "0.00;-0.00",
        "0.00_);(0.00)",
        "0.00;[Red](0.00)",
        '_(* #,##0.00_);_(* \\(#,##0.00\\);_(* "-"??_);_(@_)',
        "0.00E+00",
        "0.00E-00",
        "+0.00;-0.00",
        "[Red][<0]-0.00;0.00",
        '0.00" €"',
        "0.00[$-409]",
        "[$€-407] 0.00",
        "yyyy-mm-dd",
        "[h]:mm:ss",
        "@",
        "",
    ],
)
def test_usual_formats_show_numbers_as_they_are(code):
    assert shown_by(code) is None


@pytest.mark.parametrize(
    ("code", "way"),
    [
        ("0.0%", PERCENT),
        ("0%;-0%", PERCENT),
        ("0%;0.0", UNCLEAR),
        ('"-"0%', UNCLEAR),
        ("0.0,", THOUSANDS),
        ('0.0,," MN"', THOUSANDS),
        ("0.0;0.0,", THOUSANDS),
    ],
)
def test_percent_and_thousands(code, way):
    assert shown_by(code) == way


@given(st.text(alphabet='0#?.,%;"\\[]$-_*<>=()kN² @E+ GeneralRed', max_size=30))
def test_any_format_is_one_of_the_ways(code):
    shown = shown_by(code)
    assert shown in (None, PERCENT, THOUSANDS, UNCLEAR, OTHERWISE) or shown.startswith(WITH)


@pytest.mark.parametrize("code", ["[" * 3_000_000, '"' * 3_000_001, '0" kN"' * 500_000])
def test_a_format_without_end_takes_no_time(code):
    with at_most(2.0):
        assert shown_by(code) == UNCLEAR


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("28.44", 28.438),
        ("28,44", 28.438),
        ("28.438", 28438.0),  # German
        ("28,438", 28438.0),
        ("28 438", 28438.0),
        ("28'438.0", 28438.0),
        ("2.84E+01", 28.438),
        ("-28.4", -28.4),
        ("(28.4)", -28.4),
        ("28.4", -28.4),
        ("28", 28.438),
        ("0", 0.4),
        ("1.2.3", 9.0),
    ],
)
def test_what_a_cell_shows_may_be_rounded_and_in_any_language(text, value):
    assert not differs(text, value)


@pytest.mark.parametrize(
    ("text", "value"), [("28.44", 28438.0), ("-28.4", 28.4), ("29", 28.438), ("2.84E+04", 28.438), ("28.438", 28.4)]
)
def test_another_number_is_told(text, value):
    assert differs(text, value)


@given(st.floats(-1e12, 1e12), st.integers(0, 6))
def test_rounded_numbers_are_no_others(value, decimals):
    assert not differs(f"{value:.{decimals}f}", value)
    assert not differs(f"{value:,.{decimals}f}", value)
    assert not differs(f"{value:.{decimals}e}", value)
