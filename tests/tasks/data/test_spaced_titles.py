"""Titles above columns that are apart by spaces: those of several words belong to one column, or are refused."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.spaced_titles import apart_by_several, cells_apart_otherwise, title_cells, usual_width
from sinew.tasks.data.tables import read_tables

ROWS = "".join(f"{i / 10}   {i / 100:.2f}   {i + 0.5}   21.0   {i}\n" for i in range(6))


def read(tmp_path, titles, rows=ROWS):
    path = tmp_path / "test.txt"
    path.write_text(f"{titles}\n{rows}")
    (recording,) = read_recordings(path, Hints())
    return recording


@pytest.mark.parametrize(("of_titles", "of_numbers"), [("\t", ","), (";", ","), ("\t", ";"), (",", ";"), ("\t", " ")])
def test_titles_may_be_apart_in_another_way_than_numbers(tmp_path, of_titles, of_numbers):
    titles = ["Time (s)", "Axial Displacement (mm)", "Axial Force (N)", "T", "n"]
    found = read(tmp_path, of_titles.join(titles), ROWS.replace("   ", of_numbers))
    assert [column.title for column in found.columns] == titles[:3]
    assert found.numbers[2].tolist() == [0.2, 0.02, 2.5]


def test_a_line_with_empty_cells_between_other_separators_holds_no_titles():
    assert cells_apart_otherwise("a\tb\tc", ("a\tb\tc",), 3) == ("a", "b", "c")
    assert cells_apart_otherwise("a\t\tc", ("a\t\tc",), 3) == ("a\t\tc",)
    assert cells_apart_otherwise("a\tb", ("a\tb",), 3) == ("a\tb",)
    assert cells_apart_otherwise("a;b,c", ("a;b", "c"), 2) == ("a;b", "c"), "as many as there are numbers"


def test_titles_of_several_words_with_two_spaces_between_them(tmp_path):
    found = read(tmp_path, "Time (s)  Axial Displacement (mm)  Axial Force (N)  Temp (C)  Count")
    assert [column.title for column in found.columns] == ["Time (s)", "Axial Displacement (mm)", "Axial Force (N)"]
    assert found.numbers[2].tolist() == [0.2, 0.02, 2.5]


@pytest.mark.parametrize(
    "titles",
    [
        "Time (s) Axial Displacement (mm) Axial Force (N) Temp (C) Count",
        "Elapsed Time (s) Disp (mm) Load (N) Temp (C) Count",
    ],
)
def test_more_titles_than_columns_are_refused(tmp_path, titles):
    words = r"names above 5 columns of numbers; expected as many; titles of several words need two spaces"
    with pytest.raises(BadInput, match=words):
        read(tmp_path, titles)


def test_a_title_too_many_is_refused_though_a_word_stands_in_some_row(tmp_path):
    rows = "".join(f"{i / 10} {i / 100:.2f} {i + 0.5} 21.0{' START' if i == 3 else ''}\n" for i in range(6))
    with pytest.raises(BadInput, match="5 names above 4 columns of numbers"):
        read(tmp_path, "Time_s Axial Disp_mm Force_N Temp_C", rows)


def test_a_mark_of_a_comment_in_a_cell_of_its_own_is_no_title(tmp_path):
    path = tmp_path / "test.txt"
    rows = "".join(f"{i / 10}\t{i / 100}\t{i + 0.5}\t21.0\n" for i in range(6))
    path.write_text(f"#\tTime (s)\tDisp (mm)\tForce (N)\tTemp (C)\n{rows}")
    (found,) = read_recordings(path, Hints())
    assert [column.title for column in found.columns] == ["Time (s)", "Disp (mm)", "Force (N)"]
    assert found.numbers[2].tolist() == [0.2, 0.02, 2.5]


@pytest.mark.parametrize(
    ("line", "width", "titles"),
    [
        ("# time  force", 2, ("time", "force")),
        ("time (s) force (N)", 2, ("time (s)", "force (N)")),
        ("time of test  force", 2, ("time of test", "force")),
        ("time of test  force", 4, ("time", "of", "test", "force")),
        ("time\tforce of cell", 2, ("time", "force of cell")),
        ('"Time (s)"  "Axial Force (N)"', 2, ("Time (s)", "Axial Force (N)")),
    ],
)
def test_a_line_parts_into_as_many_titles_as_there_are_columns(line, width, titles):
    assert title_cells(line, width) == titles


def test_the_usual_width_is_that_of_rows_of_numbers():
    rows = [(1, ("a", "b")), (2, ("1", "2", "3")), (3, ("1", "2", "3")), (4, ("1", "2", "end"))]
    assert usual_width(rows, ".") == 3
    assert usual_width(rows[:1], ".") == 0


def test_channels_begin_titles_that_one_space_parts():
    line = "Time      Ch 1 Force Ch 1 Displacement Ch 1 Laser Ext"
    assert title_cells(line, 4) == ("Time", "Ch 1 Force", "Ch 1 Displacement", "Ch 1 Laser Ext")
    assert title_cells(line, 5) != title_cells(line, 4)


def test_titles_and_numbers_apart_by_several_tabs(tmp_path):
    """As many of both, but not by as many tabs: no column between them is empty."""
    path = tmp_path / "a.txt"
    rows = "".join(f"{i}.5\t\t\t0\t\t\t{i * i}.25\n" for i in range(9))
    path.write_text(f"# pos [mm]\t\tdev [mm]\t\tforce [N]\t\t\n{rows}")
    table = next(read_tables(path))
    assert table.titles == ("# pos [mm]", "dev [mm]", "force [N]")
    assert table.rows[3][1] == ("3.5", "0", "9.25")


@pytest.mark.parametrize("numbers", ["{i}.5\t\t0\t\t{i}.25\n", "{i}.5\t\t\t0\t\t\n", "{i}.5\t{i}\t\t{i}.25\t{i}\n"])
def test_an_empty_column_stays(tmp_path, numbers):
    path = tmp_path / "a.txt"
    path.write_text("pos [mm]\t\tdev [mm]\t\tforce [N]\n" + "".join(numbers.format(i=i) for i in range(9)))
    assert "" in next(read_tables(path)).titles[:3]


def test_numbers_in_other_places_from_row_to_row_are_not_put_together():
    titles, one, other = ("a", "", "b"), ("1", "2", ""), ("1", "", "2")
    assert apart_by_several([(1, titles), (2, one), (3, one)], ".")
    assert not apart_by_several([(1, titles), (2, one), (3, other)], ".")


def test_a_comment_of_other_words_than_columns_is_no_titles():
    assert title_cells("# Fix print output for fix def", 4) == ()
    assert title_cells("# Time Way Force", 3) == ("Time", "Way", "Force")
    assert title_cells("Fix print output for fix def", 4) != ()
    assert title_cells("# time (s) way in mm force (N)", 3) != (), "words with units are told, and refused as too many"
