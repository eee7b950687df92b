"""What is said of columns that cannot be told, word for word, with what would tell them."""

import pytest

from sinew.runner.errors import BadInput
from tests.tasks.data.test_columns import columns

TIMES = "s, ms, min, us, h"
TIMELESS = "--time-column NAME or NUMBER, --rate-hz, --speed or --speed-column"
NONE = "no column of time, nor of displacement, length or strain, nor of force or stress among"
ALL = f"{TIMELESS}; --displacement-column NAME or NUMBER; --force-column NAME or NUMBER"
FORCES = "N, kN, mN, cN, daN, uN, nN, pN, lbf, kgf, tf, kip, gf, ozf, dyn"
LOADS = f"{FORCES}, Pa, kPa, MPa, GPa, N/cm2, kgf/mm2, kgf/cm2, bar, mbar, psi, ksi"


@pytest.mark.parametrize(
    ("titles", "hints", "words"),
    [
        ("a|b|", {}, f": row 1: {NONE} 'a, b, (no name)'; expected {ALL}"),
        (
            "", {},
            f": {NONE} '(no name), (no name), (no name)'; expected --time-column NUMBER and --time-unit, --rate-hz, "
            "--speed or --speed-column; --displacement-column NUMBER and --displacement-unit; --force-column NUMBER "
            "and --force-unit",
        ),
        (
            "b|u_mm|force_N", {},  # the motion of the test's rows rests, so no speed tells their times
            ": row 1: no column of time among 'b, u_mm, force_N'; expected --time-column NAME or NUMBER or --rate-hz",
        ),
        (
            "time_s|force_N|force_kN", {"force_column": "2", "time_column": "1"},
            ": row 1: no column of displacement, length or strain among 'time_s, force_N, force_kN'; expected "
            "--displacement-column NAME or NUMBER",
        ),
        (
            "time_s|b|force_N", {},
            ": row 1: no column of displacement, length or strain among 'time_s, b, force_N'; expected "
            "--displacement-column NAME or NUMBER",
        ),
        (
            "time_s|u_mm|c", {},
            ": row 1: no column of force or stress among 'time_s, u_mm, c'; expected --force-column NAME or NUMBER",
        ),
        (
            "time_s|u_mm|F_N|F (N)", {},
            ": 'F_N' and 'F (N)' may both be the force; expected --force-column, one of 'F_N', 'F (N)'",
        ),
        (
            "time_s|u_mm|F_N", {"time_column": "4"},
            ": --time-column: '4' is no column; expected a number from 1 to 3, or one of 'time_s', 'u_mm', 'F_N'",
        ),
        (
            "t_s|u_mm|F_N|F_N", {"force_column": "F_N"},
            ": --force-column: 'F_N' names 2 columns; expected a number from 1 to 4, or one of 't_s', 'u_mm', 'F_N', "
            "'F_N'",
        ),
        (
            "time_s|u_mm|F_N", {"time_column": "2"},
            f": column '2': no unit of the time can be found; expected --time-unit, one of {TIMES}",
        ),
        (
            "time_s|u_mm|c", {"force_column": "c"},
            f": column 'c': no unit of the force or stress can be found; expected --force-unit, one of {LOADS}",
        ),
        (
            "time_s|u|F", {"displacement_column": "2", "force_column": "2", "displacement_unit": "mm",
                           "force_unit": "N"},
            ": one column is taken for two things; expected a column for each; name them by --time-column and the like",
        ),
        ("time|u_mm|F_N", {}, f": 'time': no unit of the time can be found; expected --time-unit, one of {TIMES}"),
        (
            "|u_mm|F_N", {"time_column": "1"},
            f": column '1': no unit of the time can be found; expected --time-unit, one of {TIMES}",
        ),
        (
            "time (h:m)|u_mm|F_N", {},
            f": 'time (h:m)': unit 'h:m' of the time is not known; expected --time-unit, one of {TIMES}",
        ),
        (
            "time_s|u_mm|F_N", {"time_unit": "min"},
            ": 'time_s': unit 's', but --time-unit says min; expected one and the same unit",
        ),
        (
            "time|u_mm|F_N", {"time_unit": "mm"},
            f": 'time': a time, but --time-unit says 'mm'; expected one of {TIMES}",
        ),
        (
            "time_s|u_mm|force (MN)", {},
            ": 'force (MN)': unit 'MN' may stand for milli or for mega; expected --force-unit, one of mN",
        ),
        (
            "time_s|u_mm|force (mn)", {"force_unit": "N"},
            ": 'force (mn)': unit 'mn' may stand for milli or for mega; expected --force-unit, one of mN",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_told_is_said_with_what_would_tell_it(titles, hints, words):
    with pytest.raises(BadInput) as refused:
        columns(titles, numbers=None if titles else 3, **hints)
    assert str(refused.value) == f"test.csv{words}"


def test_titles_that_do_not_fit_are_said_with_the_usual_reason():
    with pytest.raises(BadInput) as refused:
        columns("time_s|u_mm|F_N", numbers=6)
    assert str(refused.value) == (
        "test.csv: row 2: 3 names above 6 columns of numbers; expected as many; commas cannot separate columns and be "
        "decimal marks at the same time"
    )


def test_a_file_without_a_motion_is_not_sent_for_another_column():
    with pytest.raises(BadInput) as refused:
        columns("time_s|force_N")
    assert str(refused.value).endswith(
        ": row 1: no column of displacement, length or strain among 'time_s, force_N'; expected a file with "
        "displacement, which this one does not hold"
    )
    with pytest.raises(BadInput) as refused:
        columns("index|force_N")
    assert str(refused.value).endswith(f"expected {TIMELESS}; --displacement-column NAME or NUMBER")


def test_titles_that_hold_a_name_and_a_unit_are_told():
    """Other words in them may make another quantity: only a person can tell."""
    told = (
        r"by a word in its title, 'Fore-Aft Load \[N\]' or 'Cross-Car Load \[N\]' may be one; expected --force-column"
    )
    with pytest.raises(BadInput, match=told):
        columns("Time (s)|Disp (mm)|Fore-Aft Load [N]|Cross-Car Load [N]|Load time [s]")


def test_titles_with_an_axis_in_front_are_told():
    told = "by a word in its title, 'XDisplacement_um' or 'YDisplacement_um' or 'XForce_mN' or 'YForce_mN' may be one"
    for sizes in ("", "|XSize_um|YSize_um"):
        with pytest.raises(BadInput, match=told):
            columns(f"Time (s){sizes}|XDisplacement_um|YDisplacement_um|XForce_mN|YForce_mN")
    with pytest.raises(BadInput, match="by a word in its title, 'XSize_um' or 'YSize_um' may be one"):
        columns("Time (s)|XSize_um|YSize_um|Force_mN")


def test_columns_are_told_by_their_units_where_no_word_tells_them():
    told = r"no column of displacement.*; by its unit, 'h in mm' may be one; expected --displacement"
    with pytest.raises(BadInput, match=told):
        columns("t in s|Fn in N|h in mm|eta in Pas")
    with pytest.raises(BadInput, match=r"among .t in s, Fn in N, ratio in %.; expected "):
        columns("t in s|Fn in N|ratio in %")
