"""Several tests in one table: how many there are, which columns and rows each has, and what it is called."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.apart_by_columns import told_apart
from sinew.tasks.data.columns import recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.several import (
    Block,
    beside,
    blocks_of_cycles,
    blocks_of_tests,
    columns_of,
    go_on,
    going_on,
    names_beside,
    rest_of_former,
)
from sinew.tasks.data.tables import Table
from tests.tasks.data.test_sheets import write_workbook


def table_of(titles: str, *rows: str, units: str = "", header: tuple[tuple[str, ...], ...] = ()) -> Table:
    cells = [(at, tuple(row.split("|"))) for at, row in enumerate(rows, start=2)]
    below = tuple(units.split("|")) if units else ()
    return Table(Path("test.csv"), header, tuple(titles.split("|")), below, cells, "|", ".", 1)


def found_in(table: Table):
    return recognise(table, Hints(), first_of_alike=True)


@pytest.mark.parametrize(
    ("titles", "units", "count"),
    [
        ("t_s|u_mm|F_N", "", 1),
        ("t_s|u_mm|F_N|t_s|u_mm|F_N", "", 2),
        ("t_s|u_mm|F_N|u_mm|F_N|u_mm|F_N", "", 3),  # times for all
        ("t_s|u_mm|F_N|F_N", "", 1),  # two sensors
        ("Time|Stroke|Load|Time|Stroke|Load", "s|mm|N|s|mm|N", 2),
        ("Time|Stroke|Load|Stroke|Load", "s|mm|N|mm|kN", 1),  # one test in two units
        ("Time|Stroke|Load|Time|Stroke|Load", "s|mm|N|s|mm|kN", 2),
        ("t_s|u_mm|F_N|t_ms|u_um|F_mN", "", 2),
        ("t_s|u_mm|F_N|t_s.1|u_mm.1|F_N.1", "", 2),
        ("time1 (s)|u1 (mm)|F1 (N)|time2 (s)|u2 (mm)|F2 (N)", "", 2),
        ("t_s|u_mm|F_N|t_min", "", 1),
        ("t_s|A Strain|A Stress|B Strain|B Stress", "s|%|MPa|%|MPa", 2),
        ("A_Time_s|A_Strain_%|A_Stress_MPa|B_Time_s|B_Strain_%|B_Stress_kPa", "", 2),
        ("t_s|A Strain|A Stress|B Strain", "s|%|MPa|%", 1),
    ],
)
def test_how_many_tests_stand_beside_each_other(titles, units, count):
    table = table_of(titles, *["|".join("1" * len(titles.split("|")))] * 3, units=units)
    assert beside(table, found_in(table)) == count


def test_tests_beside_each_other_may_have_their_names_in_front_of_titles(tmp_path):
    path = tmp_path / "a.csv"
    titles = "Steel1_Strain (%),Steel1_Stress (MPa),CuZn_Strain (-),CuZn_Stress (kPa)"
    path.write_text("\n".join([titles, *(f"{i},{2 * i},{i / 50},{3 * i}" for i in range(5))]))
    steel, brass = read_recordings(path, Hints(rate_hz=1.0), first_of_alike=True)
    assert (steel.test, brass.test) == ("Steel1", "cu zn")  # as written, where the letters are the same
    assert steel.numbers[-1].tolist() == [4.0, 0.04, 8.0] and brass.numbers[-1] == pytest.approx([4.0, 0.08, 0.012])
    assert steel.columns[0].title == brass.columns[0].title == "--rate-hz 1"


def test_each_test_beside_others_has_its_columns_and_its_name():
    header = (("notes",), ("A1", "", "", "", "B", "", ""))
    table = table_of("t_s|u_mm|F_N||t_s|u_mm|F_N", *["0|1|2||3|4|5"] * 3, header=header)
    columns = found_in(table)
    second = columns_of(table, columns, 1)
    assert [column.place for column in second] == [4, 5, 6]
    assert names_beside(table, [columns, second]) == ["A1", "B"]
    sizes = (
        ("A", "", "", "", "B", "", ""),
        ("Dicke (mm)", "1.8", "", "", "Dicke (mm)", "1.6"),
        ("1.8", *[""] * 3, "1.6"),
    )
    assert names_beside(replace(table, header=sizes), [columns, second]) == ["A", "B"], "sizes are no names"
    widths = (("S1", *[""] * 3, "S2"), ("Width (mm)", *[""] * 3, "Width (mm)"), ("5", *[""] * 3, "4"))
    assert names_beside(replace(table, header=widths), [columns, second]) == ["S1", "S2"], "nor below a size"
    told = (("S1", *[""] * 3, "S2"), ("1.5 mm", *[""] * 3, "1.6 mm"))
    assert names_beside(replace(table, header=told), [columns, second]) == ["S1", "S2"], "nor with a unit"
    numbered = (("1.1", *[""] * 3, "1.2"),)
    assert names_beside(replace(table, header=numbered), [columns, second]) == ["1.1", "1.2"], "a donor and a sample"
    labelled = (("Test No", "1", *[""] * 2, "2"), ("Width (mm)", "7.9", *[""] * 2, "7.7"))
    assert names_beside(replace(table, header=labelled), [columns, second]) == ["1", "2"], "a label is no name"
    unnamed = table_of("t_s|u_mm|F_N|u_mm|F_N", *["0|1|2|3|4"] * 3, header=(("one line",),))
    shared = columns_of(unnamed, found_in(unnamed), 1)
    assert [column.place for column in shared] == [0, 3, 4]
    assert names_beside(unnamed, [found_in(unnamed), shared]) == ["1", "2"]
    above = replace(unnamed, header=(("", "left", "", "right", ""),))
    assert names_beside(above, [found_in(above), shared]) == ["left", "right"], "the time is of both"


def test_a_test_that_begins_where_the_table_before_ends_is_noted():
    columns = found_in(table_of("t_s|u_mm|F_N", *["0|1|2"] * 3))
    steps = [
        np.column_stack([np.arange(5.0), at + 0.1 * np.arange(5), 2.0 * at + 0.2 * np.arange(5)]) for at in (0, 0.41)
    ]
    note = rest_of_former(*steps, columns)
    assert note == "begins where the table before ends, at 0.41 mm and 0.82 N"
    assert rest_of_former(steps[0], steps[1] + [0.0, 0.2, 0.0], columns) == "", "another displacement"
    assert rest_of_former(steps[0], steps[1] + [0.0, 0.0, 0.4], columns) == "", "another force"
    assert rest_of_former(steps[1], steps[0], columns) == "", "a test of its own"
    assert rest_of_former(steps[0][::-1], steps[0], columns) == "", "both begin or end at zero"


BLOCKS = ("a|0|1", "a|1|2", "b|0|3", "b|1|4", "b|2|5")


def test_tests_by_the_value_of_a_column():
    table = table_of("id|t_s|F_N", *BLOCKS)
    expected = [Block("a", 0, 2), Block("b", 2, 5)]
    assert blocks_of_tests(table, 5, "id") == blocks_of_tests(table, 5, "1") == expected
    assert blocks_of_tests(table, 4, "id")[-1] == Block("b", 2, 4)


REPEATED = [f"{test}|{repeat}|{i}|1" for test in "ab" for repeat in (1, 2) for i in range(4)]


def test_two_columns_together_tell_tests_apart():
    table = table_of("Test|Repeat|t_s|F_N", *REPEATED)
    expected = [Block(name, 4 * i, 4 * i + 4) for i, name in enumerate(("a 1", "a 2", "b 1", "b 2"))]
    assert blocks_of_tests(table, 16, "Test, Repeat") == blocks_of_tests(table, 16, "1,2") == expected
    apart = told_apart(table, 16, [4, 8, 12], taken=[2, 3])
    assert (apart.title, apart.count, apart.tests) == ("Test, Repeat", 4, 4)
    with pytest.raises(BadInput, match="row 10, Repeat: '1' again, after another value"):
        blocks_of_tests(table, 16, "Repeat")
    with pytest.raises(BadInput, match="'Trial' is no column"):
        blocks_of_tests(table, 16, "Test, Trial")


def test_as_few_columns_as_are_needed_tell_tests_apart_together():
    tests = [(kind, batch, plate, sample) for kind in "kl" for batch in "xy" for plate in "12" for sample in "34"]
    rows = [f"{kind}|{kind}{kind}|{b}|{plate}|{s}|{i}" for kind, b, plate, s in tests for i in range(4)]
    table = table_of("Kind|Kind again|Batch|Plate|Sample|t_s", *rows)
    apart = told_apart(table, 64, list(range(4, 64, 4)), taken=[5])
    assert (apart.title, apart.count) == ("Kind, Batch, Plate, Sample", 16)
    assert len(blocks_of_tests(table, 64, apart.title)) == 16
    assert told_apart(table_of("Kind|Kind again|Batch|Plate|Sample|t_s", *rows, *rows[:4]), 68, [64], [5]) is None
    assert told_apart(table, 64, [*range(4, 64, 4), 6], taken=[5]) is None, "the time goes back within a test"


def test_a_title_with_a_comma_is_one_column():
    table = table_of("Test, no|t_s|F_N", *BLOCKS)
    assert [block.name for block in blocks_of_tests(table, 5, "Test, no")] == ["a", "b"]


def test_two_columns_that_come_again_together_tell_nothing_apart():
    table = table_of("Test|Repeat|t_s|F_N", *REPEATED, *REPEATED[:4])
    assert told_apart(table, 20, [4, 8, 12, 16], taken=[2, 3]) is None


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        ("name", "test.csv: --test-column: 'name' is no column; expected a number from 1 to 3, or one of 'id'"),
        ("4", "test.csv: --test-column: '4' is no column"),
    ],
)
def test_a_column_that_is_not_there_is_refused(wanted, words):
    with pytest.raises(BadInput) as refused:
        blocks_of_tests(table_of("id|t_s|F_N", *BLOCKS), 5, wanted)
    assert str(refused.value).startswith(words)


def test_a_test_in_two_places_is_refused_and_a_cycle_is_not():
    table = table_of("id|t_s|F_N", *BLOCKS, "a|2|2")
    with pytest.raises(BadInput, match="row 7, id: 'a' again, after another value"):
        blocks_of_tests(table, 6, "id")
    table = table_of("id|t_s|F_N", *(f"{name}|{i}|{i}" for i, name in enumerate("aaabbbaaa")))
    assert [block.name for block in blocks_of_cycles(table, 9, "id", [1, 2])] == ["a", "b", "a"]


@pytest.mark.parametrize(
    ("wanted", "problem"),
    [
        ("3", "'3': the column of time, displacement or force; expected a column with the number of the cycle"),
        ("T", "'T': changes 5 times in 6 rows; expected a column with one value for each cycle"),
    ],
)
def test_a_column_that_cannot_tell_cycles_is_refused(wanted, problem):
    table = table_of("id|t_s|F_N|T", *(f"a|{i % 3}|{i}|2{i}" for i in range(6)))
    with pytest.raises(BadInput) as refused:
        blocks_of_cycles(table, 6, wanted, [1, 2])
    assert str(refused.value).startswith(f"test.csv: --cycle-column {problem}")


@pytest.mark.parametrize(
    ("titles", "rows", "back", "found"),
    [
        ("x|t_s|F_N", BLOCKS * 1, [2], None),  # 5 rows in 2 blocks of less than 3
        ("x|t_s|F_N", ["a|0|1"] * 4 + ["b|0|1"] * 4, [4], ("x", 2, "--test-column")),
        ("x|t_s|F_N", ["a|0|1"] * 3 + ["b|0|1"] * 5, [4], None),  # changes elsewhere
        ("x|t_s|F_N", ["a|0|1"] * 4 + ["b|0|1"] * 4, [], None),  # nothing says that it is of tests
        ("Specimen ID|t_s|F_N", ["a|0|1"] * 4 + ["b|0|1"] * 4, [], ("Specimen ID", 2, "--test-column")),
        ("Specimen ID|t_s|F_N", ["a|0|1"] + ["|0|1"] * 7, [], None),
        ("id|t_s|F_N", ["a|0|1"] * 8, [], None),
        ("Cycle|t_s|F_N", ["1|0|1"] * 4 + ["2|0|1"] * 4 + ["1|0|1"] * 4, [4, 8], ("Cycle", 3, "--cycle-column")),
        ("x|t_s|F_N", ["1|0|1"] * 4 + ["2|0|1"] * 4 + ["1|0|1"] * 4, [4, 8], None),
    ],
)
def test_the_column_that_tells_tests_or_cycles_apart(titles, rows, back, found):
    apart = told_apart(table_of(titles, *rows), len(rows), back, taken=[1, 2])
    assert (apart and (apart.title, apart.count, apart.option)) == found
    if apart is not None:
        assert apart.tests == (1 if apart.option == "--cycle-column" else apart.count)


@pytest.mark.parametrize(
    ("times", "one"),
    [
        ([[0, 1, 2], [3, 4, 5], [6, 7, 8]], True),
        ([[0, 1, 2], [12, 13, 14]], True),
        ([[0, 1, 2], [12.5, 13, 14]], False),  # a pause
        ([[0, 1, 2], [2, 3, 4]], False),
        ([[0, 1, 2], [0, 1, 2]], False),
    ],
)
def test_times_of_one_test_go_on(times, one):
    assert go_on([np.array(each, dtype=float) for each in times]) is one


def test_times_that_start_again_with_a_cycle_go_on():
    times = np.array([0.0, 1.0, 2.0, 0.0, 1.0, 5.0, 6.0])
    cycles = [Block("1", 0, 3), Block("2", 3, 5), Block("3", 5, 7)]
    assert going_on(times, cycles).tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 8.0, 9.0]
    assert times[3] == 0.0, "a copy"


MTS = "Data Acquisition: {}\nRunning Time\tAxial Displacement\tAxial Force\nSec\tmm\tN\n"


def test_tables_whose_times_go_on_with_lines_between_them_are_asked_about(tmp_path):
    path = tmp_path / "test.dat"
    path.write_text(
        f"{MTS.format(1)}0\t0\t0\n1\t1\t50\n2\t0.02\t1\n\n{MTS.format(2)}3\t0.01\t0\n4\t1\t48\n5\t0.02\t1\n"
    )
    with pytest.raises(BadInput, match="a test begins soon after the end of the table before, by its times; expected"):
        read_recordings(path, Hints())
    (joined,) = read_recordings(path, Hints(tables="join"))
    assert joined.numbers[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert "2 tables that go on from each other, as --tables says: read as one test" in joined.notes
    assert len(read_recordings(path, Hints(tables="apart"))) == 2


def with_results(first):
    """A sheet with a test of 40 rows, and the peaks of its cycles under the same titles beside it."""
    rows = [
        [i / 60, (i % 10) / 10, float(i % 10), None, *([i + 1, 0.9 + i, 9.0 + i] if i < 4 else [])] for i in range(40)
    ]
    head = [["L0 (mm)", first], ["time", "displacement", "load", None, "cycle", "displacement", "load"],
            ["min", "mm", "N", None, "-", "mm", "N"]]  # fmt: skip
    return [*head, *rows]


def test_results_beside_a_test_are_no_test_of_its_times(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", A=with_results(15.2), B=with_results(15.4))
    words = (
        r"column 7 is called as column 3, and has numbers in 4 of 40 rows: results, or another test; expected "
        r"--displacement-column 2 --force-column 3 beside results, or --tables apart for tests"
    )
    with pytest.raises(BadInput, match=words):
        read_recordings(path, Hints())
    assert len(read_recordings(path, Hints(tables="apart"))) == 4
    found = read_recordings(path, Hints(displacement_column="2", force_column="3"))
    assert [(one.test, len(one.rows)) for one in found] == [("A", 40), ("B", 40)]


def test_names_of_tests_beside_each_other_are_not_those_of_another_sheet(tmp_path):
    rows = [[i, i / 10, 5 * i, i, i / 5, 6 * i] for i in range(4)]
    titles = ["Time (s)", "Extension (mm)", "Load (N)"] * 2
    first = [["left", None, None, "right"], titles, *rows]
    path = write_workbook(tmp_path / "a.xlsx", A=first, B=[titles, *rows])
    names = [one.test for one in read_recordings(path, Hints())]
    assert names == ["A_left", "A_right", "B_1", "B_2"]
