"""Several tests in one file: one under another, beside each other, on sheets, or told apart by a column."""

import tracemalloc
from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.curves import curve_of
from sinew.tasks.data.exports import Reading
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.questions import Unclear, UnknownUnit
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from tests.tasks.data.test_recordings import BAR, read
from tests.tasks.data.test_sheets import write_workbook

ONE = "Time (s),Extension (mm),Load (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n"


def names_and_loads(folder: Path, content: str, **hints: object) -> list[tuple[str, list[float]]]:
    path = folder / "test.csv"
    path.write_text(content)
    return [(one.test, one.numbers[:, 2].tolist()) for one in read_recordings(path, Hints(**hints))]


def test_tables_with_the_same_titles_are_several_tests(tmp_path):
    other = ONE.replace("5", "6")
    assert names_and_loads(tmp_path, ONE + other) == [("1", [0, 5, 9]), ("2", [0, 6, 9])]
    numbered = [f"{name},{one}".replace("\n", "\n,") for name, one in (("A", ONE), ("B", other))]
    assert names_and_loads(tmp_path, "\n".join(numbered)) == [("A", [0, 5, 9]), ("B", [0, 6, 9])]


def test_tables_of_another_kind_are_passed_over(tmp_path):
    assert names_and_loads(tmp_path, "a,b,c\n1,2,3\n2,3,4\n3,4,5\n" + ONE) == [("", [0, 5, 9])]


def test_tables_whose_times_go_on_are_one_test(tmp_path):
    later = ONE.replace("\n0,", "\n3,").replace("\n1,", "\n4,").replace("\n2,", "\n5,")
    path = tmp_path / "test.csv"
    path.write_text(ONE + later)
    (found,) = read_recordings(path, Hints())
    assert found.numbers[:, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert found.rows == (2, 3, 4, 6, 7, 8)
    assert remarks(found) == ["2 tables whose times go on: read as one test"]
    path.write_text(ONE + later.replace("\n4,", "\n3,"))
    with pytest.raises(BadInput, match="times repeat in 1 of 3 rows, first in row 7"):
        curve_of(*read_recordings(path, Hints()), BAR, "pull")
    named = ["A," + ONE.replace("\n", "\n,"), "B," + later.replace("\n", "\n,")]
    assert [name for name, _ in names_and_loads(tmp_path, "\n".join(named))] == ["A", "B"], "they have names"


OWN = "{}\nLength: {} mm\nWidth,{},mm\n" + ONE


def sizes(one: Recording) -> dict[str, float | None]:
    return {name: size.mm for name, size in one.sizes.items()}


@pytest.mark.parametrize("name", ["", "Specimen B"])
def test_each_of_several_tests_has_the_sizes_above_it(tmp_path, name):
    path = tmp_path / "test.csv"
    path.write_text(f"Diameter (mm): 3\n{OWN.format('', 10, 2)}\n{OWN.format(name, 20, 4)}\n{ONE}")
    first, second, third = read_recordings(path, Hints())
    assert sizes(first) == {"diameter": 3.0, "length": 10.0, "width": 2.0}
    assert sizes(second) == {"length": 20.0, "width": 4.0}, "the diameter may be that of the first"
    assert sizes(third) == sizes(first), "those above the first test"
    assert [one.numbers.shape for one in (first, second, third)] == [(3, 3)] * 3


def test_each_sheet_has_its_own_sizes(tmp_path):
    table = [["Time (s)", "Extension (mm)", "Load (N)"], *([i, i / 10, 5 * i] for i in range(4))]
    sheets = {name: [["Length", length, "mm"], *table] for name, length in (("one", 10), ("two", 20))}
    both = read_recordings(write_workbook(tmp_path / "test.xlsx", **sheets), Hints())
    assert [sizes(one) for one in both] == [{"length": 10.0}, {"length": 20.0}]


def test_tests_with_something_between_them_are_not_joined(tmp_path):
    later = ONE.replace("\n0,", "\n3,").replace("\n1,", "\n4,").replace("\n2,", "\n5,")
    assert [name for name, _ in names_and_loads(tmp_path, f"{ONE}Specimen B\n{later}")] == ["1", "2"]
    pause = later.replace("\n3,", "\n30,").replace("\n4,", "\n31,").replace("\n5,", "\n32,")
    with pytest.raises(
        Unclear, match="a test begins a while after the end of the table before, by its times; expected --tables join"
    ):
        names_and_loads(tmp_path, ONE + pause)
    assert [name for name, _ in names_and_loads(tmp_path, ONE + pause, tables="apart")] == ["1", "2"]
    ((_, loads),) = names_and_loads(tmp_path, ONE + pause, tables="join")
    assert loads == [0, 5, 9, 0, 5, 9]


ABOVE = "{more}\t\tTime:\t{end}\ts\t10/19/2023 11:59:35 {half}\nStation\t{station}\n"
RECORD = ABOVE + "Time\tCh 1 Disp\tCh 1 Force\ns\tmm\tN\n"


@pytest.mark.parametrize(
    ("more", "station", "one"),
    [("Data Acquisition", "a40", True), ("Data Acquisition", "a41", False), ("Second Acquisition", "a40", False)],
)
def test_tables_of_one_record_have_the_same_words_above_but_for_the_time(tmp_path, more, station, one):
    rows = [f"{i / 10}\t{i / 100}\t{i}\n" for i in range(40)]
    first = RECORD.format(more="Data Acquisition", end=2.0, half="AM", station="a40") + "".join(rows[:20])
    second = RECORD.format(more=more, end=4.0, half="PM", station=station) + "".join(rows[20:])
    path = tmp_path / "record.dat"
    path.write_text(f"MTS793|MPT\n\n{first}\n{second}")
    assert inspect(path).specimens == (1 if one else 2)
    if not one:
        with pytest.raises(Unclear, match="--tables join for one test, or --tables apart"):
            read_recordings(path, Hints())
        assert len(read_recordings(path, Hints(tables="apart"))) == 2
    (joined,) = read_recordings(path, Hints() if one else Hints(tables="join"))
    assert joined.numbers[:, 0].tolist() == [i / 10 for i in range(40)]


def test_many_tests_in_a_file_take_no_time_of_the_square_of_their_number(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(("Time (s),Extension (mm),Load (N)\n" + "".join(f"{i},{i},{i}\n" for i in range(50))) * 100)
    tracemalloc.start()
    found = read_recordings(path, Hints())
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found) == 100
    assert max(len(one.header) for one in found) == 0
    assert most < 20 * 2**20


def test_a_test_that_was_broken_off_is_left_out_with_a_remark(tmp_path):
    path = tmp_path / "test.csv"
    path.write_text(ONE + "Time (s),Extension (mm),Load (N)\n0,0,0\n")
    (found,) = read_recordings(path, Hints())
    assert remarks(found) == ["1 further tables with fewer than 3 rows are left out"]
    path.write_text("Time (s),Extension (mm),Load (N),Extension (mm),Load (N)\n0,0,0,,\n1,0.1,5,,\n2,0.2,9,,\n")
    (found,) = read_recordings(path, Hints())
    assert found.numbers[:, 2].tolist() == [0, 5, 9]


def test_a_column_of_tests_is_remarked_on_where_times_go_on(tmp_path):
    rows = "".join(f"{'AB'[i // 6]},{i},{i % 6},{i % 6}\n" for i in range(12))
    found = read(tmp_path, f"Specimen,Time (s),Extension (mm),Load (N)\n{rows}")
    assert remarks(found) == ["2 values of 'Specimen': --test-column, if each is a test of its own"]


def test_tests_on_several_sheets_have_the_names_of_their_sheets(tmp_path):
    rows = [["Time (s)", "Extension (mm)", "Load (N)"], *([i, i / 10, 5 * i] for i in range(4))]
    path = write_workbook(tmp_path / "test.xlsx", dermis=rows, belly=rows)
    assert [one.test for one in read_recordings(path, Hints())] == ["dermis", "belly"]


def test_tests_beside_each_other_have_units_of_their_own(tmp_path):
    text = "A,,,B\nTime,Extension,Load,Time,Extension,Load\ns,mm,N,ms,um,kN\n"
    text += "0,0,1,0,0,0.001\n1,0.1,5,1000,100,0.005\n2,0.2,9,2000,200,0.009\n"
    path = tmp_path / "a.csv"
    path.write_text(text)
    one, other = read_recordings(path, Hints())
    assert other.numbers == pytest.approx(one.numbers)
    assert [column.unit for column in other.columns] == ["ms", "um", "kN"]
    path.write_text(text.replace("kN", "V"))
    with pytest.raises(BadInput, match="unit 'V' is that of a sensor's signal, no force"):
        read_recordings(path, Hints())


def test_units_that_contradict_each_other_are_refused_until_a_person_decides(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Extension (mm),Force (N)\ns,mm,kN\n0,0,1\n1,0.1,5\n2,0.2,9\n")
    with pytest.raises(UnknownUnit, match="the force has two units: 'N' and 'kN'"):
        read_recordings(path, Hints())
    (told,) = read_recordings(path, Hints(force_unit="kN"))
    assert told.numbers[:, 2] == pytest.approx([1000, 5000, 9000])


def test_the_second_of_two_tests_may_be_the_first_with_a_number(tmp_path):
    titles = ["Time (s)", "Extension (mm)", "Load (N)", "Time 2 (s)", "Extension 2 (mm)", "Load 2 (N)"]
    rows = [",".join(f"{(place + 1) * row / 7:.5f}" for place in range(6)) for row in range(30)]
    (tmp_path / "two.csv").write_text("\n".join([",".join(titles), *rows]) + "\n")
    found = read_recordings(tmp_path / "two.csv", Hints(), first_of_alike=True)
    assert [[column.place for column in one.columns] for one in found] == [[0, 1, 2], [3, 4, 5]]


@pytest.mark.parametrize(
    ("titles", "motion", "load", "left"),
    [
        (["Time (s)", "Extension (mm)", "Load (N)", "Time (s)", "Crosshead (mm)", "Force (kN)"], 1, 2, "4 to 6"),
        (["Extension (mm)", "Load (N)", "Time (s)", "Crosshead (mm)", "Force (kN)", "Time (s)"], 0, 1, "4 to 6"),
        (["Time (s)", "Extension (mm)", "Load (N)", "", "Time (s)", "Crosshead (mm)", "Force"], 1, 2, "5 to 7"),
        (["Time (s)", "Load (N)", "Time (s)", "Extension (mm)"], 3, 1, None),
        (["Time (s)", "Extension (mm)", "Load (N)", "Clock (s)", "Crosshead (mm)"], 1, 2, None),
    ],
)
def test_columns_of_two_tests_with_other_titles_are_never_taken_together(tmp_path, titles, motion, load, left):
    path = tmp_path / "two.csv"
    rows = [",".join(f"{(place + 1) * row / 7:.5f}" if title else "" for place, title in enumerate(titles))
            for row in range(30)]  # fmt: skip
    path.write_text("\n".join([",".join(titles), *rows]) + "\n")
    (test,) = read_recordings(path, Hints(), first_of_alike=True)
    assert [column.place for column in test.columns[1:]] == [motion, load]
    told = [note for note in test.notes if "may be another test" in note]
    assert told == (
        [] if left is None else [f"columns {left} may be another test and are left out; it needs a file of its own"]
    )


def test_tests_beside_each_other(tmp_path):
    beside = "A,,,B\nTime (s),Extension (mm),Load (N),Time (s),Extension (mm),Load (N)\n"
    beside += "0,0,0,0,0,1\n1,0.1,5,1,0.1,6\n2,0.2,9,2,0.2,7\n,,,3,0.3,8\n"
    assert names_and_loads(tmp_path, beside) == [("A", [0, 5, 9]), ("B", [1, 6, 7, 8])]
    (first,) = names_and_loads(tmp_path, beside, time_column="1", displacement_column="2", force_column="3")
    assert first == ("", [0, 5, 9]), "who names columns means one test"
    empty = beside.replace("2,0.2,9,", ",,,").replace("1,0.1,5,", ",,,")
    assert names_and_loads(tmp_path, empty) == [("B", [1, 6, 7, 8])], "the first was not made"


def test_further_columns_of_tests_beside_and_under_each_other_are_their_own(tmp_path):
    titles = "Time (s),Displacement (mm),Force (N),Lateral strain (%)"
    rows = [f"{i % 4},{i},{i},{i},{i % 4},{i},{2 * i},{2 * i},{'ab'[i // 4]}" for i in range(8)]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([f"{titles},{titles},run", *rows, ""]))
    found = read_recordings(path, Hints(test_column="run", keep_column=("Lateral strain=lateral_strain",)))
    kept = [100 * one.further.values["lateral_strain"] for one in found]
    assert [each.round(9).tolist() for each in kept] == [[0, 1, 2, 3], [4, 5, 6, 7], [0, 2, 4, 6], [8, 10, 12, 14]]


BELOW = "id,Time (s),Extension (mm),Load (N)\n" + "".join(
    f"{name},{i},{i / 10},{i * force}\n" for name, force in (("a", 5), ("b", 6)) for i in range(4)
)


def test_tests_one_under_another_by_a_column(tmp_path):
    found = names_and_loads(tmp_path, BELOW, test_column="id")
    assert found == [("a", [0, 5, 10, 15]), ("b", [0, 6, 12, 18])]
    with pytest.raises(BadInput) as refused:
        curve_of(read(tmp_path, BELOW), BAR, "pull")
    assert str(refused.value).endswith(
        "row 6, time: 0 s after 3 s; expected increasing times, or --test-column 'id', which changes there"
    )
    with pytest.raises(BadInput, match="2 rows of numbers of test 'c'; expected at least 3"):
        read(tmp_path, BELOW + "c,0,0,0\nc,1,1,1\n", test_column="id")


def test_cycles_whose_times_start_again_are_one_test(tmp_path):
    cycles = BELOW.replace("id,", "Cycle,")
    with pytest.raises(BadInput, match="or --cycle-column 'Cycle', which changes there"):
        curve_of(read(tmp_path, cycles), BAR, "pull")
    found = read(tmp_path, cycles + "b,4,0.4,24\n", cycle_column="Cycle")
    assert found.numbers[:, 0].tolist() == list(range(9))
    assert remarks(found)[-1] == "times go on over 2 cycles, which 'Cycle' tells apart"


STEPS = "".join(
    "<Stress Relaxation>\nTime, s\tPosition (z), mm\tFz, gf\n"
    + "".join(f"{i}\t{begin + 0.1 * min(i, 5):g}\t{100 * begin + 8 * min(i, 5) + i:g}\n" for i in range(8))
    for begin in (5.0, 5.5, 6.0)
)


def test_tables_that_begin_where_the_one_before_ends_are_asked_about(tmp_path):
    """Steps of one relaxation, each with times of its own: as tests of their own, their strains would be wrong."""
    path = tmp_path / "steps.txt"
    path.write_text(STEPS)
    with pytest.raises(Unclear) as unclear:
        read_recordings(path, Hints(force_column="3"), first_of_alike=True)
    assert "a test begins where the table before ends, at 5.5 mm and 5.3" in str(unclear.value)
    assert unclear.value.choices == ("join", "apart")
    apart = read_recordings(path, Hints(tables="apart"), first_of_alike=True)
    assert [test.test for test in apart] == ["1", "2", "3"]
    (one,) = read_recordings(path, Hints(tables="join"), first_of_alike=True)
    assert one.numbers[:, 0].tolist() == list(range(24))
    assert one.numbers[[0, 8, 23], 1].tolist() == [5.0, 5.5, 6.5]
    assert "3 tables that go on from each other, as --tables says: read as one test" in one.notes
    assert inspect(path, Reading(hints=Hints(tables="join"))).specimens == 1
