"""Times that a person tells, and numbers, cells and days that may be meant in two ways."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.questions import Unclear
from sinew.tasks.data.recordings import UNPADDED, read_recordings
from sinew.tasks.data.remarks import remarks
from tests.tasks.data.test_recordings import PLAIN, read
from tests.tasks.data.test_sheets import write_workbook

TIMELESS = "Extension (mm),Load (N)\n0,0\n0.1,5\n0.3,9\n"


def test_times_by_a_rate_or_a_speed(tmp_path):
    found = read(tmp_path, TIMELESS, rate_hz=10.0)
    assert found.numbers.tolist() == [[0, 0, 0], [0.1, 0.1, 5], [0.2, 0.3, 9]]
    assert remarks(found) == ["times by --rate-hz 10"]
    assert found.columns[0].title == "--rate-hz 10"
    found = read(tmp_path, TIMELESS, speed=0.1)
    assert found.numbers[:, 0] == pytest.approx([0.0, 1.0, 3.0])
    with pytest.raises(BadInput, match=r"no column of time among .*--rate-hz, --speed or --speed-column"):
        read(tmp_path, TIMELESS)


def test_a_column_of_times_counts_unless_it_stands_still(tmp_path):
    found = read(tmp_path, PLAIN, rate_hz=10.0)
    assert found.numbers[:, 0].tolist() == [0, 1, 2]
    assert remarks(found) == ["its own times count, not --rate-hz 10"]
    found = read(tmp_path, PLAIN.replace("\n1,", "\n0.1,").replace("\n2,", "\n0.2,"), rate_hz=100.0)
    assert found.numbers[:, 0].tolist() == [0, 0.1, 0.2], "a quick test, too"
    still = PLAIN.replace("\n1,", "\n0,").replace("\n2,", "\n0,")
    assert read(tmp_path, still, rate_hz=10.0).numbers[:, 0].tolist() == [0, 0.1, 0.2]


def test_a_speed_tells_no_times_of_a_motion_that_rests_or_is_noisy(tmp_path):
    with pytest.raises(BadInput, match=r"row 4: the same motion as in the row before.*--rate-hz"):
        read(tmp_path, TIMELESS.replace("0.3", "0.1"), speed=0.1)
    noisy = "".join(f"{i / 10 + 0.2 * (-1) ** i},{i}\n" for i in range(30))
    with pytest.raises(BadInput, match="the motion turns 28 times in 30 rows"):
        read(tmp_path, "Extension (mm),Load (N)\n" + noisy, speed=0.1)


def test_a_rate_and_a_column_of_times_contradict_each_other():
    with pytest.raises(BadInput, match="--rate-hz 10: given together with --time-column"):
        Hints(rate_hz=10.0, time_column="t")


def test_a_column_of_current_lengths_tells_the_gauge_length_of_each_test(tmp_path):
    rows = "".join(f"{i},{12.5 + 0.1 * i:g},{0.1 * i:g},{i}\n" for i in range(5))
    path = tmp_path / "lengths.csv"
    path.write_text("Time_S,Size_mm,Displacement_mm,Force_N\n" + rows)
    (one,) = read_recordings(path, Hints())
    assert (one.sizes["length"].mm, one.sizes["length"].has_unit) == (pytest.approx(12.5), True)
    assert one.left_out == ()
    path.write_text("Time_S,Size_mm,Displacement_mm,Force_N\n" + rows + "5,17,0,9\n6,17.1,0.1,6\n")
    (other,) = read_recordings(path, Hints())
    assert other.left_out == ("Size_mm",)
    assert "length" not in other.sizes


def test_a_file_of_very_many_tests_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("sinew.tasks.data.tables.MOST_TABLES", 3)
    part = "Time (s),Displacement (mm),Force (N)\n" + "".join(f"{i},{i},{i}\n" for i in range(4)) + "\n"
    (tmp_path / "a.csv").write_text(part * 3)
    assert len(read_recordings(tmp_path / "a.csv", Hints())) == 3
    (tmp_path / "a.csv").write_text(part * 4)
    with pytest.raises(BadInput, match=r"a\.csv: more than 3 tables"):
        read_recordings(tmp_path / "a.csv", Hints())


def test_clock_times_of_milliseconds_without_leading_zeros_are_told(tmp_path):
    rows = ["1:12:57.855", "1:12:58.29", "1:12:58.203"]
    content = "time,disp_mm,force_N\n" + "".join(f"{clock},{i},{i}\n" for i, clock in enumerate(rows))
    found = read(tmp_path, content)
    assert np.diff(found.numbers[:, 0]).tolist() == pytest.approx([0.174, 0.174])
    assert found.notes == (UNPADDED,)
    assert read(tmp_path, content.replace("58.29", "58.029")).notes == ()


MARKS = "Zeit (s);Weg (mm);Kraft (N)\n" + "".join(f"{i};{i};{220 * i}\n" for i in range(5))


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("beside", [(), ("5;5;880",), ("12;1234;880",)])
def test_numbers_that_may_have_marked_thousands_are_refused(tmp_path, mark, separator, beside):
    rows = "\n".join(("6;6;1.100", "7;7;1.320", *beside)).replace(".", mark)
    content = (MARKS + rows + "\n").replace(";", separator)
    with pytest.raises(BadInput) as refused:
        read(tmp_path, content)
    problem = f"row 7, Kraft (N): '1{mark}100' may be 1.100 or 1100, and no number beside it tells which; expected the"
    assert problem in str(refused.value)


@pytest.mark.parametrize("row", ["5;0.500;880", "5;5.5;880", "5;5;1.1000", "5;5;.125", "5;-0.125;1", "5;5;1.100e0"])
def test_one_number_tells_what_the_marks_are(tmp_path, row):
    found = read(tmp_path, f"{MARKS}{row}\n6;6;1.100\n")
    assert found.numbers[-1, 2] == 1.1


def test_a_further_table_that_may_be_a_test_is_not_left_out_without_a_word(tmp_path):
    other = [["Time (s)", "Load (N)", "Extension (mm)"], *([i, 2 * i, i] for i in range(4))]
    test = [["Time (s)", "Displacement (mm)", "Force (N)"], *([i, i, 3 * i] for i in range(4))]
    none = [["Point", "Load (N)", "Slope"], *([i, 2 * i, i] for i in range(4))]
    short = other[:3]
    path = write_workbook(tmp_path / "a.xlsx", one=test, two=other, three=none, four=short, five=other)
    with pytest.raises(Unclear) as unclear:
        read_recordings(path, Hints())
    assert "the table in sheet 'two', row 1 has other titles than the first one, and is a test" in str(unclear.value)
    assert (unclear.value.option, unclear.value.choices) == ("--tables", ("first",))
    (found,) = read_recordings(path, Hints(tables="first"))
    told = "left out; a test needs a file of its own, or --sheet"
    words = f"the table in sheet '{{}}', row 1 has other titles and is {told}"
    others = f"2 tables, the first in sheet 'two', row 1, have other titles and are {told}"
    assert remarks(found) == [others]
    unknown = [["Time (s)", "Load (N)", "Extension (furlong)"], *([i, 2 * i, i] for i in range(4))]
    path = write_workbook(tmp_path / "b.xlsx", one=test, two=unknown)
    assert remarks(*read_recordings(path, Hints())) == [words.format("two")]


def test_an_empty_cell_of_a_sheet_may_be_that_of_a_formula(tmp_path):
    rows = [["Time (s)", "Displacement (mm)", "Force (N)"], *([i, i, 3 * i] for i in range(4)), [4, 4, None]]
    path = write_workbook(tmp_path / "a.xlsx", one=[*rows, [5, 5, 5]])
    with pytest.raises(
        BadInput, match=r"row 6, Force \(N\): an empty cell; expected .*; a formula needs the value that"
    ):
        read_recordings(path, Hints())


def test_one_table_tells_what_the_marks_of_another_are(tmp_path):
    titles = "Time (s),Extension (mm),Load (N)\n"
    rows = "0.000,0.250,1\n1.000,0.5,2\n2.000,1.5,3\n"
    (tmp_path / "a.csv").write_text(f"{titles}{rows}{titles}8.000,2.000,9\n9.000,3.000,9\n")
    first, *others = read_recordings(tmp_path / "a.csv", Hints())
    assert (first.numbers[-1].tolist(), others) == ([2.0, 1.5, 3.0], [])


def test_a_time_of_another_day_without_a_clear_date_is_said(tmp_path):
    rows = "03.05.2024 23:59:58,0,0\n03.05.2024 23:59:59,1,1\n03.05.2024 23:59:59.5,2,2\n04.05.2024 00:00:01,3,3\n"
    (tmp_path / "a.csv").write_text(f"Time,Extension (mm),Load (N)\n{rows}")
    words = r"row 5, Time: '04.05.2024 00:00:01'; expected a time of the same day as those above, or dates such as"
    with pytest.raises(BadInput, match=words):
        read_recordings(tmp_path / "a.csv", Hints())
