"""Tables in files: where they begin, and the titles, units and header lines above them."""

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.layout import numeric_places, runs
from sinew.tasks.data.sheets import Hidden
from sinew.tasks.data.tables import Table, read_source, read_tables, tables_of
from tests.effort import at_most


def tables(folder: Path, *lines: str) -> list[Table]:
    path = folder / "test.csv"
    path.write_text("\n".join(lines), "utf-8")
    return list(read_tables(path))


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ","), ("|", ","), (" ", ".")]
)
def test_separator_and_decimal_mark(tmp_path, separator, decimal):
    rows = [["0.5", "1.5", "2.5"], ["1.5", "2", "3.25"], ["2.5", "3", "4"]]
    lines = [separator.join(cell.replace(".", decimal) for cell in row) for row in rows]
    (table,) = tables(tmp_path, separator.join("abc"), *lines)
    assert (table.separator, table.decimal, table.titles) == (separator, decimal, ("a", "b", "c"))
    assert [[table.number(row, column) for column in range(3)] for row in range(3)] == [
        [float(cell) for cell in row] for row in rows
    ]


def test_header_titles_and_units(tmp_path):
    (table,) = tables(tmp_path, "Operator:,me", "", "Time,u,F", "(s),(mm),", "", "0,0,0", "1,1,1", "2,2,2", ",,")
    assert table.header == (("Operator:", "me"), ())
    assert (table.titles, table.units, table.title_row, table.first) == (("Time", "u", "F"), ("(s)", "(mm)", ""), 3, 6)
    assert [at for at, _ in table.rows] == [6, 7, 8]


def test_titles_over_several_lines_and_titles_between_spaces(tmp_path):
    (table,) = tables(tmp_path, '"Time\n(s)",u,F', "0,0,0", "1,1,1", "2,2,2")
    assert (table.titles[0], table.title_row, table.first) == ("Time\n(s)", 1, 3)
    (table,) = tables(tmp_path, "# time (s) strain (mm / mm)  force(N)", "0 0 0", "1 1 1", "2 2 2")
    assert table.titles == ("time (s)", "strain (mm / mm)", "force(N)")
    (table,) = tables(tmp_path, "time (s);strain;force in N", "0 0 0", "1 1 1", "2 2 2")
    assert table.titles == ("time (s)", "strain", "force in N")


def test_columns_of_text_and_empty_ones_are_allowed(tmp_path):
    (table,) = tables(tmp_path, "1,t,u,F,note", ",0,0,0,a", ",1,1,1,", ",2,2,2,7", ",3,3,3,b")
    assert table.first == 2
    assert table.number(0, 0) is None
    assert table.number(0, 3) == 0
    assert table.number(0, 9) is None


def test_every_table_of_a_file(tmp_path):
    lines = ["Results", "n,mean,sd", "1,2,3", "2,2,3", "3,2,3", "", "t,u,F", "0,0,0", "1,1,1", "2,2,2", "3,3,3"]
    found = tables(tmp_path, *lines)
    assert [(table.titles, table.first) for table in found] == [(("n", "mean", "sd"), 3), (("t", "u", "F"), 8)]
    assert len(found[0].rows) == 9, "a table goes on to the end of the file: what follows it may be a broken row"


def test_broken_rows_belong_to_the_table(tmp_path):
    rows = ["0,0,0", "1,-,1", "2,2,2", "", "3,3,3", "4,4,4", "5,x,5", "6,6,6", "7,7,7"]
    (table,) = tables(tmp_path, "t,u,F", "(s),(mm),(N)", *rows)
    assert (table.titles, table.units, table.first) == (("t", "u", "F"), ("(s)", "(mm)", "(N)"), 3)
    assert table.number(1, 1) is None
    (table,) = tables(tmp_path, "t,u,F", "0,0,0", "1,1,1", "2,2,2", "3,-,3", "4,4,4", "5,5,5", "6,6,6")
    assert table.first == 2, "what follows a broken row is no table of its own"
    (table,) = tables(tmp_path, "0,-,0", "1,1,1", "2,2,2", "3,3,3")
    assert (table.titles, table.title_row, table.first) == ((), 0, 1)
    (table,) = tables(tmp_path, "t,u,F,1,2", "1,1,1,1,1", "2,2,2,1,1", "3,3,3,1,1")
    assert table.first == 2, "titles may be numbers"


def test_a_table_below_many_lines(tmp_path):
    (table,) = tables(tmp_path, *["a note"] * 700, "t,u,F", "0,0,0", "1,1,1", "2,2,2")
    assert table.first == 702


@pytest.mark.parametrize(
    "lines", [["u_mm,force_N", "0,1", "1,2"], ["12-00-00,1,x"] * 3, ["1 2", "text"], [",".join("1" * 1001)] * 3]
)
def test_a_file_without_a_table(tmp_path, lines):
    with pytest.raises(BadInput, match="no table of numbers can be found"):
        tables(tmp_path, *lines)


def test_two_columns_are_a_table_where_none_has_three(tmp_path):
    (table,) = tables(tmp_path, "u_mm,force_N", "0,1", "1,2", "2,3", "maxima", "2,3")
    assert table.titles == ("u_mm", "force_N"), "two numbers in a line of text are no table"
    (table,) = tables(tmp_path, "note,1,2", "u_mm,force_N", "0,1", "1,2", "2,3")
    assert (table.titles, len(table.rows)) == (("u_mm", "force_N"), 3)
    (table,) = tables(tmp_path, "u_mm,force_N", "0,1", "1,2", "2,3", "t,u,F", "0,0,0", "1,1,1", "2,2,2")
    assert table.titles == ("t", "u", "F")


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(st.lists(st.lists(st.sampled_from(["1", "2,5", "2.5", "a", "", "(s)", '"', " "]), max_size=5), max_size=8),
       st.sampled_from(",;\t |"))  # fmt: skip
def test_a_table_has_a_row_with_two_numbers(tmp_path, rows, separator):
    try:
        found = tables(tmp_path, *(separator.join(row) for row in rows))
    except BadInput as refused:
        assert "test.csv" in str(refused)
        return
    for table in found:
        numbers = [[table.number(row, column) for column in range(60)] for row in range(len(table.rows))]
        assert max(sum(value is not None for value in row) for row in numbers) >= 2
        assert all(value is None or math.isfinite(value) for row in numbers for value in row)


def test_a_table_may_have_a_thousand_columns_and_no_more(tmp_path):
    row = ",".join("1" * 1000)
    (table,) = tables(tmp_path, row, row, row)
    assert len(table.rows[0][1]) == 1000
    with pytest.raises(BadInput) as refused:
        tables(tmp_path, *[row + ",1"] * 3)
    assert str(refused.value) == (
        f"{tmp_path / 'test.csv'}: no table of numbers can be found; expected three columns or more: "
        "time, displacement (or strain) and force (or stress)"
    )


def test_a_table_of_one_row_or_two(tmp_path):
    (table,) = tables(tmp_path, "t,u,F", "1,2,3")
    assert [row for _, row in table.rows] == [("1", "2", "3")]
    (table,) = tables(tmp_path, "t,u,F", "1,2,3", "4,5,6", "")
    assert [at for at, _ in table.rows] == [2, 3]


def test_whole_numbers_have_a_decimal_point_and_commas_separate(tmp_path):
    (table,) = tables(tmp_path, "1;2;3", "2;3;4", "3;4;5")
    assert (table.separator, table.decimal) == (";", ".")
    (table,) = tables(tmp_path, "1,2,3", "2,3,4", "3,4,5")
    assert (table.separator, table.decimal) == (",", ".")


def test_the_longest_table_tells_separator_and_decimal_mark(tmp_path):
    (table,) = tables(tmp_path, "1,2,3", "2,3,4", "a;b;c", *["1,5;2,5;3,5"] * 5)
    assert (table.separator, table.decimal, table.first) == (";", ",", 4)


@pytest.mark.parametrize(
    ("line", "titles"),
    [
        ("time (s) force (N)", ("time (s)", "force (N)")),
        ("time [s] u[mm] F", ("time [s]", "u[mm]", "F")),
        ("% t u F", ("t", "u", "F")),
        ("t X F", ("t", "X", "F")),
        ("# X u F", ("X", "u", "F")),
        ("// t u F", ("t", "u", "F")),
        ("#t u (a b c) F", ("t", "u (a b c)", "F")),
        ("t [a (b c) d] F", ("t [a (b c) d]", "F")),
        ("# time in s, u in mm, F in N", ("time in s", "u in mm", "F in N")),
        ("# t\tu\tF", ("t", "u", "F")),
    ],
)
def test_titles_between_spaces_keep_their_units(tmp_path, line, titles):
    (table,) = tables(tmp_path, line, "0 0 0", "1 1 1", "2 2 2")
    assert table.titles == titles


@pytest.mark.parametrize(
    ("below", "is_row_of_units"),
    [
        ("s,mm,N", True),
        ("s),mm,[N", True),
        ("(s),,[N]", True),
        ("(a),(b),(c)", True),
        ("s,mm,cats", True),
        ("s,mm,two cats", False),
        ("s,cats,dogs", False),
        ("s,mm,(", True),
        (",,", False),
    ],
)
def test_a_row_of_units_is_below_the_titles(tmp_path, below, is_row_of_units):
    (table,) = tables(tmp_path, "header", "t,u,F", below, "0,0,0", "1,1,1", "2,2,2")
    if is_row_of_units:
        assert (table.titles, table.units, table.title_row) == (("t", "u", "F"), tuple(below.split(",")), 2)
        assert table.header == (("header",),)
    else:
        assert (table.titles, table.units, table.title_row) == (("t", "u", "F"), (), 2), "it is passed over"
        assert table.header == (("header",),)


def test_units_alone_are_titles(tmp_path):
    (table,) = tables(tmp_path, "s,mm,N", "0,0,0", "1,1,1", "2,2,2")
    assert (table.titles, table.units, table.title_row, table.header) == (("s", "mm", "N"), (), 1, ())
    (table,) = tables(tmp_path, ",,", "s,mm,N", "0,0,0", "1,1,1", "2,2,2")
    assert (table.titles, table.units) == (("s", "mm", "N"), ()), "what is above is blank"


@pytest.mark.parametrize(
    ("above", "first"), [("1,-,-,4", 1), ("1,-,-,-", 2), ("-,2,-,4", 1), ("x,y,z,4", 2), ("1,2,3", 1)]
)
def test_a_row_with_half_of_the_numbers_is_a_broken_row(tmp_path, above, first):
    (table,) = tables(tmp_path, above, *["1,2,3,4"] * 3)
    assert table.first == first


def test_a_row_that_begins_with_a_label_is_no_broken_row(tmp_path):
    above = ("ChannelTitle=,Force,Length", "UnitName=,mN,mm", "TopValue=,100,10")
    (table,) = tables(tmp_path, *above, *["1,2,3"] * 3)
    assert (table.titles, table.units, table.first) == (("", "Force", "Length"), ("", "mN", "mm"), 4)


def test_a_row_of_numbers_alone_begins_no_table(tmp_path):
    (table,) = tables(tmp_path, "1,2,3", "a,b,c", "t,u,F", "0,0,0", "1,1,1", "2,2,2")
    assert (table.titles, table.first) == (("t", "u", "F"), 4)
    (table,) = tables(tmp_path, "1,2,3", "2,3,4", "a,b,c", "t,u,F", "0,0,0", "1,1,1", "2,2,2")
    assert table.first == 5, "two rows neither"
    (table,) = tables(tmp_path, "1,2,3", "a,b,c", "2,3,4", "t,u,F", "0,0,0", "1,1,1", "2,2,2")
    assert table.first == 5, "nor two with a text between them"


def test_a_short_table_at_the_end_does_not_tell_the_separator(tmp_path):
    (table, _) = tables(tmp_path, *["1;2;3"] * 6, "t|u|F", *["1|2|3"] * 3, "t;u;F", *["1;2;3"] * 3)
    assert (table.separator, table.first) == (";", 1)


def test_a_broken_row_has_the_decimal_mark_of_the_table(tmp_path):
    (table,) = tables(tmp_path, "t,u,F", "0.5,-,0.5", *["1.5,1.5,1.5"] * 3)
    assert (table.titles, table.first) == (("t", "u", "F"), 2)


def test_blank_rows_around_a_table_are_nothing(tmp_path):
    (table,) = tables(tmp_path, "", *["1,2,3"] * 3, '"",""')
    assert (table.titles, table.title_row, table.header) == ((), 0, ())
    assert [at for at, _ in table.rows] == [2, 3, 4]


ROWS = "1,2,3\n2,3,4\n3,4,5\n"
LONG = {
    "rows that lack a number in turns": ("1,2,3,x\n" * 3 + "x,1,2,3\n" * 3) * 6_000,
    "tabs behind a quotation mark": f'a""{"	" * 95_000}x\n{ROWS}' * 5,
    "spaces in brackets": f"a ({' ' * 95_000}x(,b,c\n{ROWS}",
    "slashes in a title": f"a{'/' * 95_000} b,b,c\n{ROWS}",
    "brackets above a table": f"{'(' * 95_000},5,\n" * 20 + f"time,force,strain\n{ROWS}",
    "segments without signals": "Sig1 time (min)\n" + f"StartOfData\n{ROWS}".replace(",", " ") * 8_000,
}


@pytest.mark.parametrize("text", LONG.values(), ids=LONG)
def test_long_files_take_no_more_than_their_length(tmp_path, text):
    """Each took minutes or hours, with the square of its length or worse."""
    path = tmp_path / "long.csv"
    path.write_text(text, "utf-8")
    with at_most(10), suppress(BadInput):
        inspect(path)


def test_of_many_rows_above_a_table_those_at_both_ends_are_its_header(tmp_path):
    lines = [f"note {number}" for number in range(2_000)]
    (table,) = tables(tmp_path, *lines, "a,b,c", "1,2,3", "2,3,4", "3,4,5")
    assert table.header == tuple((line,) for line in (*lines[:450], *lines[-450:]))


def test_the_rows_above_the_second_of_two_tables_are_known_where_there_are_many(tmp_path):
    lines = [f"note {number}" for number in range(2_000)]
    _, second = tables(tmp_path, *lines, "t,u,F", "1,2,3", "2,3,4", "3,4,5", "Length: 7 mm", "t,u,F", "1,2,3")
    assert second.header[second.own :] == (("Length: 7 mm",),)
    assert second.header[: second.own] == tuple((line,) for line in (*lines[:450], *lines[-450:]))


def test_quoted_cells_may_have_commas_as_decimal_marks_between_commas(tmp_path):
    path = tmp_path / "test.csv"
    rows = "".join(f'"0,{i}","0,0{i}","{i},5"\n' for i in range(1, 6))
    path.write_text(f'"Zeit (s)","Weg (mm)","Kraft (N)"\n{rows}')
    (table,) = read_tables(path)
    assert (table.separator, table.decimal) == (",", ",")
    assert [table.number(1, place) for place in range(3)] == [0.2, 0.02, 2.5]


def test_quoted_cells_with_points_are_read_as_before(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text('"Time (s)","Disp (mm)","Force (N)"\n"0","0","1"\n"1","1","2"\n"2","2","4"\n')
    (table,) = read_tables(path)
    assert table.decimal == "."


def test_hidden_rows_of_a_test_are_counted(tmp_path):
    (table,) = tables(tmp_path, "a,b,c", "0,0,0", "1,1,1", "2,2,2")
    assert table.unseen(range(3), {}) == ()
    found = replace(table, hidden=Hidden(rows=frozenset({1, 3, 4})))
    assert found.unseen(range(3), {}) == ("hidden in the spreadsheet, but read: 2 of its 3 rows",)
    assert found.unseen(range(1), {0: "a"}) == ()
    both = replace(found, hidden=Hidden(rows=frozenset({1, 3, 4}), columns=frozenset({2, 3})))
    assert both.unseen(range(3), {-1: "", 0: "a", 2: "c"}) == (
        "hidden in the spreadsheet, but read: 2 of its 3 rows, column 'c'",
    )


def test_of_two_decimal_marks_the_one_with_more_columns_of_numbers_counts(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{i / 100:.3f};1;1;{i};17,{i:03d};-6,9\n".replace(".", ",") for i in range(9))
    path.write_text(f"Zeit (s);Zyklus;Schritt;Index;Weg (mm);Kraft (N)\n{rows}")
    (table,) = read_tables(path)
    assert table.decimal == ","
    assert table.number(3, 4) == 17.003


def test_lists_in_brackets_are_no_table(tmp_path):
    path = tmp_path / "packets.txt"
    path.write_text("".join(f"[{i}, {2 * i}, 3, 4, 5]\n" for i in range(20)))
    with pytest.raises(BadInput, match="lists in brackets, and no table"):
        inspect(path)
    path.write_text("[s],[mm],[N]\n" + "".join(f"{i},{i},{i}\n" for i in range(20)))
    assert len(next(read_tables(path)).rows) == 20


@given(
    st.lists(st.lists(st.sampled_from(["1", "2.5", "x", "", "1,5"]), max_size=4), max_size=40), st.sampled_from([2, 3])
)
def test_runs_end_where_a_row_lacks_a_number_of_the_first_rows(rows, fewest):
    """As found row by row."""
    for run in runs(rows, ".", fewest):
        assert all(numeric_places(row, ".") >= run.columns for row in rows[run.start : run.end])
        assert run.end == len(rows) or not numeric_places(rows[run.end], ".") >= run.columns


def test_tables_that_go_on_to_the_end_copy_no_rows_and_are_looked_at_once(tmp_path, monkeypatch):
    path = tmp_path / "many.csv"
    heads = "".join(f"time,force,col{n}\n1,2,3\n2,3,4\n3,4,5\n" for n in range(50))
    path.write_text(heads + "time,force,last\n" + "1,2,3\n" * 1000)
    looked = []
    monkeypatch.setattr("sinew.tasks.data.tables.tells_mark", lambda cell, decimal: looked.append(cell))
    source = read_source(path)
    found = list(tables_of(source))
    assert len(found) == 51
    assert all(table.rows.every is source.pages[0].rows for table in found)
    assert len(looked) == 3 * (50 * 4 + 1000)
