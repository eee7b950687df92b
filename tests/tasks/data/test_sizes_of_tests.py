"""Sizes of several tests in one file: each test has its own."""

import pytest

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.sizes_of_tests import BY_ORDER, sizes_by_results
from tests.tasks.data.test_sheets import write_workbook

STRESSES = [[f"{0.5 * i}", f"{0.25 * i}", f"{2.5 * i}"] for i in range(6)]
TITLES = ["Time [s]", "Strain [%]", "Stress [MPa]"]


def rows_of(*lines: str) -> list[tuple[str, ...]]:
    return [tuple(line.split("|")) for line in lines]


def sizes(recording: Recording) -> dict[str, float | None]:
    return {name: size.mm for name, size in recording.sizes.items() if size.has_unit}


RESULTS = ["Results Table 1", "|Length|Width|Force", "|(mm)|(mm)|(N)", "1|9.5|4|10", "2|9.75|4.5|11", "3|10.1|5|12", ""]


def by_test(lines: list[str], count: int) -> list[dict[str, float | None]]:
    each, notes = sizes_by_results(rows_of(*lines), [str(number) for number in range(1, count + 1)])
    assert notes == ()
    return [{name: size.mm for name, size in one.items()} for one in each]


def test_a_table_of_results_has_a_row_for_each_test():
    assert by_test(RESULTS, 3) == [{"length": l_mm, "width": b_mm} for l_mm, b_mm in ((9.5, 4), (9.75, 4.5), (10.1, 5))]
    assert by_test(RESULTS[:-1], 3) == by_test(RESULTS, 3), "where nothing stands below it"
    assert by_test([*RESULTS, *RESULTS[1:3], "1|1|1|1", "2|1|1|1", "3|1|1|1"], 3) == by_test(RESULTS, 3), "the first"


@pytest.mark.parametrize(
    ("lines", "count"),
    [
        (RESULTS, 2),  # of other tests
        (RESULTS, 4),
        ([line.replace("(mm)", "(V)") for line in RESULTS], 3),
        ([line.replace("Length", "Rate").replace("Width", "Time") for line in RESULTS], 3),
        ([RESULTS[1], "9.5|4|10", *RESULTS[3:]], 3),  # no row of units
        ([RESULTS[1], "|||", *RESULTS[3:]], 3),
    ],
)
def test_no_table_of_results_for_these_tests(lines, count):
    assert not any(by_test(lines, count))


def test_units_may_stand_in_the_titles_of_a_table_of_results():
    lines = ["Length (mm)|Width (mm)|Load (N)", "9.5|4|10", "9.75|4.5|11", "10.1|5|12", ""]
    assert by_test(lines, 3) == by_test(RESULTS, 3) and any(by_test(lines, 3))
    assert not any(by_test([lines[0].replace("(mm)", "(V)"), *lines[1:]], 3))


def test_a_size_that_a_test_lacks_is_not_that_of_another():
    lines = [line.replace("9.75", "unknown") for line in RESULTS]
    widths = [{"width": 4}, {"width": 4.5}, {"width": 5}]
    assert [each | {"length": mm} for each, mm in zip(widths, (9.5, None, 10.1), strict=True)] == by_test(lines, 3)


def test_a_table_of_results_is_of_several_tests():
    assert by_test([*RESULTS[:4], ""], 1) == [{}]


NAMED = ["Specimen|Length|Width", "|mm|mm", "Specimen B|20|8", "Specimen A|10|5"]


def test_rows_of_a_table_of_results_are_found_by_the_names_of_tests():
    a, b = ({"length": 10.0, "width": 5.0}, {"length": 20.0, "width": 8.0})
    for names, expected in ((("Specimen A", "specimen b "), [a, b]), (("Specimen B", "Specimen A"), [b, a])):
        found, notes = sizes_by_results(rows_of(*NAMED), names)
        assert [{name: size.mm for name, size in one.items()} for one in found] == expected
        assert notes == ()


@pytest.mark.parametrize(("names", "notes"), [(("Sheet1", "Sheet2"), (BY_ORDER,)), (("1", "2"), ())])
def test_rows_with_other_names_are_taken_in_their_order(names, notes):
    found, said = sizes_by_results(rows_of(*NAMED), names)
    assert [one["length"].mm for one in found] == [20.0, 10.0]
    assert said == notes


def beside(tmp_path, *above: str) -> list[Recording]:
    """Two tests beside each other, with an empty column between them, below these lines."""
    lines = [*above, "|".join([*TITLES, "", *TITLES]), *("|".join([*row, "", *row]) for row in STRESSES)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines).replace("|", ";") + "\n")
    return read_recordings(path, Hints())


@pytest.mark.parametrize(
    ("above", "expected"),
    [
        (["Length|10|mm||Length|20|mm", "Width|5|mm||Width|8|mm"],
         [{"length": 10, "width": 5}, {"length": 20, "width": 8}]),
        (["Diameter: 4 mm||||Diameter: 8 mm||"], [{"diameter": 4}, {"diameter": 8}]),
        (["Length [mm]|10|||Length [mm]|20|"], [{"length": 10}, {"length": 20}]),
        (["Length|10|mm||||", "Width|5|mm||Width|8|mm"], [{"length": 10, "width": 5}, {"width": 8}]),
        (["Length|10|mm||||"], [{"length": 10}, {"length": 10}]),  # of both
        (["Length [mm]|10|||20||", "Width|5|mm|6|mm||"], [{"length": 10}, {"length": 20}]),  # one above each test
        (["Length [mm]|10||||7|"], [{}, {}]),  # anywhere above the second test
        (["Length [mm]|10|20||||", "Width [mm]|5|||8|9|"], [{}, {}]),  # two numbers above one of the tests
        (["Length|10|mm||||", "Width: 5 mm|Width: 8 mm|||||"], [{"length": 10}, {"length": 10}]),
    ],
)  # fmt: skip
def test_tests_beside_each_other_have_the_sizes_above_their_columns(tmp_path, above, expected):
    assert [sizes(one) for one in beside(tmp_path, *above)] == expected


def test_times_of_all_tests_stand_above_none(tmp_path):
    lines = ["Width;5;mm;Width;8;mm", "Time [s];Extension [mm];Load [N];Extension [mm];Load [N]"]
    lines += [f"{i};{0.1 * i:.1f};{i};{0.1 * i:.1f};{2 * i}" for i in range(6)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines) + "\n")
    assert [sizes(one) for one in read_recordings(path, Hints())] == [{"width": 5.0}, {"width": 8.0}]


TEST = [TITLES, *[[float(cell) for cell in row] for row in STRESSES]]
LENGTH, WIDTH = [["Length", 10, "mm"]], [["Width", 5, "mm"]]


def test_sizes_of_another_sheet_with_a_test_are_of_that_test(tmp_path):
    path = write_workbook(
        tmp_path / "a.xlsx", front=WIDTH, one=[*LENGTH, *TEST], two=TEST, three=[["Length", 20, "mm"], *TEST]
    )
    assert [sizes(one) for one in read_recordings(path, Hints())] == [
        {"width": 5.0, "length": 10.0}, {"width": 5.0}, {"width": 5.0, "length": 20.0},
    ]  # fmt: skip


def test_sizes_of_a_test_that_is_left_out_are_of_no_other(tmp_path):
    other = [["Time [s]", "Extension [mm]", "Load [N]"], *TEST[1:]]
    short = [*LENGTH, *TEST[:3]]
    for left_out in (short, [*LENGTH, *other]):
        path = write_workbook(tmp_path / "a.xlsx", one=TEST, two=left_out, three=TEST)
        assert [sizes(one) for one in read_recordings(path, Hints(tables="first"))] == [{}, {}]


def test_a_second_test_of_a_sheet_takes_none_of_another_sheet(tmp_path):
    path = write_workbook(tmp_path / "a.xlsx", one=[*LENGTH, *TEST], two=[*TEST, [None, None, None], *TEST])
    assert [sizes(one) for one in read_recordings(path, Hints())] == [{"length": 10.0}, {}, {}]


def test_a_label_without_a_number_leaves_that_size_open(tmp_path):
    table = "\n".join(";".join(map(str, row)) for row in TEST) + "\n"
    path = tmp_path / "a.csv"
    path.write_text("Width;5;mm\nLength;10;mm\n" + table + "\nWidth;see above;\n" + table)
    assert [sizes(one) for one in read_recordings(path, Hints())] == [{"width": 5.0, "length": 10.0}, {"length": 10.0}]


def test_a_later_table_that_tells_sizes_takes_none_of_another(tmp_path):
    head = "Width;5;mm\n"
    table = "\n".join(";".join(map(str, row)) for row in TEST) + "\n"
    path = tmp_path / "a.csv"
    path.write_text(head + "Length;10;mm\n" + table + "\nLength;20;mm\n" + table + "\nSpecimen;3\n" + table)
    assert [sizes(one) for one in read_recordings(path, Hints())] == [
        {"width": 5.0, "length": 10.0}, {"length": 20.0}, {"width": 5.0, "length": 10.0},
    ]  # fmt: skip


def test_marks_of_thousands_in_a_table_of_results_are_told_by_the_tests(tmp_path):
    results = ["Name,Length,Width", ",mm,mm", 'A,"1,200",4.5', 'B,"1,300",4.6']
    titles = "Time (s),Extension (mm),Load (N),Time (s),Extension (mm),Load (N)"
    rows = [",".join(f"{(place + 1) * row / 7:.5f}" for place in range(6)) for row in range(30)]
    path = tmp_path / "two.csv"
    path.write_text("\n".join([*results, "", "A,,,B,,", titles, *rows]) + "\n")
    found = read_recordings(path, Hints(), first_of_alike=True)
    assert [one.test for one in found] == ["A", "B"]
    told = [{name: size.mm for name, size in one.sizes.items() if size.mm is not None} for one in found]
    assert told == [{"width": 4.5}, {"width": 4.6}]


@pytest.mark.parametrize("units", ["", "Units", "単位"])
@pytest.mark.parametrize("length", ["Gauge Length", "Gauge_Length", "標点間距離"])
def test_a_table_of_results_right_above_tests_beside_each_other(tmp_path, units, length):
    """The names of the tests stand right below it, above their first columns."""
    path = tmp_path / "tests.csv"
    rows = "".join(f"{i / 10},{0.01 * i},{0.5 * i},{i / 10},{0.02 * i},{0.7 * i}\n" for i in range(20))
    path.write_text(
        f"Name,Thickness,Width,{length}\n{units},mm,mm,mm\nT1,1.9,5.1,24.6\nT2,2.0,5.2,24.7\nT1,,,T2,,\n"
        f"Time,Stroke,Force,Time,Stroke,Force\nsec,mm,N,sec,mm,N\n{rows}",
        "utf-8",
    )
    found = read_recordings(path, Hints())
    assert [{name: size.mm for name, size in one.sizes.items()} for one in found] == [
        {"thickness": 1.9, "width": 5.1, "length": 24.6},
        {"thickness": 2.0, "width": 5.2, "length": 24.7},
    ]


def test_a_further_row_of_numbers_in_a_table_of_results_tells_nothing(tmp_path):
    path = tmp_path / "tests.csv"
    rows = "".join(f"{i / 10},{0.01 * i},{0.5 * i},{i / 10},{0.02 * i},{0.7 * i}\n" for i in range(20))
    path.write_text(
        "Name,Width\n,mm\nT1,5.1\nT2,5.2\nMean,5.15\nT1,,,T2,,\nTime,Stroke,Force,Time,Stroke,Force\n"
        f"sec,mm,N,sec,mm,N\n{rows}"
    )
    assert [dict(one.sizes) for one in read_recordings(path, Hints())] == [{}, {}]
