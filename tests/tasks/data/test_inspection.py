"""What files are taken for: columns, units and sizes that are right, or a question."""

import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data import tables
from sinew.tasks.data.exports import Reading, read_export, read_exports
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.text import read_lines
from tests.conftest import SHARED

EXPORTS = SHARED / "real" / "exports"
SIZES = ("length_mm", "width_mm", "thickness_mm", "diameter_mm", "area_mm2")


def taken(folder: Path, text: str, encoding: str = "utf-8") -> dict[str, Any]:
    path = folder / "export.csv"
    path.write_bytes(text.encode(encoding))
    return inspect(path).content()


def test_a_german_export(tmp_path):
    found = taken(
        tmp_path,
        '"Messlänge"\t20\t"mm"\n"Probenbreite b0"\t5,96\t"mm"\n"Probendicke a0"\t0,1\t"cm"\n'
        '"Prüfzeit"\t"Standardweg"\t"Standardkraft"\n"s"\t"mm"\t"kN"\n'
        "0,5\t0\t0,1464\n0,6\t0,1\t0,2\n0,7\t0,2\t-0,3\n",
        "cp1252",
    )
    assert found["time"] == {"column": "Prüfzeit", "unit": "s"}
    assert found["displacement"] == {"column": "Standardweg", "unit": "mm"}
    assert found["force"] == {"column": "Standardkraft", "unit": "kN"}
    assert [found[name] for name in SIZES] == [20.0, 5.96, 1.0, None, pytest.approx(5.96)]
    assert (found["rows"], found["first"], found["peak_force_N"]) == (3, [0.5, 0.0, 146.4], -300.0)
    assert (found["specimens"], found["ask"]) == (1, [])


@pytest.mark.parametrize(
    ("titles", "encoding"),
    [("时间,位移,力", "gb18030"), ("時間,ストローク,試験力", "shift_jis"), ("Temps,Course standard,Force", "cp1252")],
)
def test_titles_in_other_languages(tmp_path, titles, encoding):
    found = taken(tmp_path, f"\n{titles}\n(s),(mm),(N)\n0,0,1\n1,1,2\n2,2,3\n", encoding)
    columns = [found[name]["column"] for name in ("time", "displacement", "force")]
    assert columns == titles.split(",")
    assert len(found["ask"]) == 2, "length and cross-section"


@pytest.mark.parametrize(
    ("titles", "encoding"),
    [
        ("Temps;Déplacement en traction;Charge", "cp1252"),
        ("Tempo;Deslocamento;Força", "cp1252"),
        ("Zeit;Stauchung;Druckkraft", "utf-8"),
        ("Time since start of test;Extn;Load feedback", "utf-8"),
    ],
)
def test_titles_of_further_programs(tmp_path, titles, encoding):
    found = taken(tmp_path, f"{titles}\ns;mm;N\n0;0;1\n1;1;2\n2;2;3\n", encoding)
    assert [found[name]["column"] for name in ("time", "displacement", "force")] == titles.split(";")


def test_tables_of_peaks_and_valleys_are_not_taken_for_tests(tmp_path):
    found = taken(tmp_path, "Time,Disp Max,Disp Min,Load Max,Load Min\ns,mm,mm,N,N\n0,1,0,2,0\n1,1,0,2,0\n2,1,0,2,0\n")
    assert (found["displacement"], found["force"]) == (None, None)


def test_set_values_and_counters_are_not_taken(tmp_path):
    text = "S/No;C_1_Temps[s];C_1_Valeur de consigne[];C_1_Force[kN];C_1_Déplacement[mm];\n"
    found = taken(tmp_path, text + "".join(f"{i};{i / 10};{i};{i / 50};{i / 20};\n" for i in range(1, 6)))
    assert found["time"]["column"] == "C_1_Temps[s]"
    assert found["force"] == {"column": "C_1_Force[kN]", "unit": "kN"}
    assert found["first"] == [0.1, 0.05, 20.0]


def test_tests_beside_each_other_and_one_under_another(tmp_path):
    beside = (
        "a,,,b,,\nTime,Force,Stroke,Time,Force,Stroke\ns,N,mm,s,N,mm\n0,1,0,0,1,0\n1,2,1,1,2,1\n2,3,2,2,3,2\n,,,3,4,3\n"
    )
    found = taken(tmp_path, beside)
    assert (found["specimens"], found["rows"]) == (2, 3)
    block = "{},Time,Force,Stroke\n,(s),(N),(mm)\n,0,1,0\n,1,2,1\n,2,3,2\n"
    found = taken(tmp_path, block.format(1) + block.format(2))
    assert (found["specimens"], found["rows"]) == (2, 3)
    again = taken(tmp_path, "time s,force N,stroke mm\n" + "0,1,0\n1,2,1\n2,3,2\n" * 2)
    assert "the time begins again in row 5: tests one under another, or one test" in again["ask"][0]


def test_tables_whose_times_go_on_are_one_test(tmp_path):
    block = "Time (s),Load (N),Stroke (mm)\n{},1,0\n{},2,1\n{},3,2\n"
    assert taken(tmp_path, block.format(0, 1, 2) + block.format(3, 4, 5))["specimens"] == 1
    assert taken(tmp_path, block.format(0, 1, 2) + block.format(2, 4, 5))["specimens"] == 2
    named = "{},Time (s),Load (N),Stroke (mm)\n,{},1,0\n,{},2,1\n,{},3,2\n"
    assert taken(tmp_path, named.format("A", 0, 1, 2) + named.format("B", 3, 4, 5))["specimens"] == 2


@pytest.mark.parametrize(("title", "specimens", "remedy"), [("id", 3, "--test-column"), ("Cycle", 1, "--cycle-column")])
def test_tests_and_cycles_that_a_column_tells_apart_are_asked_for(tmp_path, title, specimens, remedy):
    rows = "".join(f"{name},{i},{i},{i}\n" for name in "abc" for i in range(4))
    found = taken(tmp_path, f"{title},Time (s),Load (N),Stroke (mm)\n{rows}")
    assert (found["specimens"], found["rows"]) == (specimens, 12)
    assert found["ask"][0] == (
        "time: goes back 2 times, first in row 6: several tests or cycles in one table? one for each "
        f"'{title}'? {remedy}"
    )


def test_cycles_whose_times_go_on_are_one_test_and_need_no_answer(tmp_path):
    rows = [f"{i // 3},{i},{i},{i}" for i in range(9)]
    found = taken(tmp_path, "\n".join(["Cycle,Time (s),Load (N),Stroke (mm)", *rows, ""]))
    assert (found["specimens"], found["rows"], len(found["ask"]), found["remarks"]) == (1, 9, 2, [])
    answered = inspect(tmp_path / "export.csv", Reading(hints=Hints(cycle_column="Cycle"))).content()
    assert answered == found


def test_cycles_that_share_a_time_are_asked_for(tmp_path):
    rows = [f"{cycle},{2 * cycle + i},{i},{i}" for cycle in range(3) for i in range(3)]
    found = taken(tmp_path, "\n".join(["Cycle,Time (s),Load (N),Stroke (mm)", *rows, ""]))
    assert found["ask"][0] == (
        "row 5, time: 2 s after 2 s; expected increasing times, or --cycle-column 'Cycle', which changes there"
    )
    reading = Reading(length_mm=10, area_mm2=4, hints=Hints(cycle_column="Cycle"))
    assert inspect(tmp_path / "export.csv", reading).content()["ask"] == []
    assert read_export(tmp_path / "export.csv", reading=reading).curves[0].protocol.time_s.size == 9


def test_tests_without_times_are_told_apart_by_the_title_of_a_column(tmp_path):
    rows = "".join(f"{name},{i},{i}\n" for name in "ab" for i in range(4))
    found = taken(tmp_path, f"Specimen,Load (N),Stroke (mm)\n{rows}")
    assert found["specimens"] == 2
    assert "2 tests in one table, one for each 'Specimen'? --test-column" in found["ask"]
    path = tmp_path / "export.csv"
    answered = inspect(path, Reading(hints=Hints(test_column="Specimen", rate_hz=10.0))).content()
    assert (answered["specimens"], [one.partition(":")[0] for one in answered["ask"]]) == (
        2,
        ["length", "cross-section"],
    )


def test_two_columns_without_times_are_asked_for_a_rate(tmp_path):
    found = taken(tmp_path, "Extension (mm),Load (N)\n0,0\n0.1,5\n0.3,9\n")
    assert (found["rows"], found["peak_force_N"], found["first"]) == (3, 9.0, [None, 0.0, 0.0])
    assert found["ask"][0].endswith("--time-column NAME or NUMBER, --rate-hz, --speed or --speed-column")


@pytest.mark.parametrize(("told", "title"), [({"speed": 0.1}, "--speed 0.1"), ({"rate_hz": 10.0}, "--rate-hz 10")])
def test_times_that_are_told_are_said(tmp_path, told, title):
    taken(tmp_path, "Extension (mm),Load (N)\n0,0\n0.1,5\n0.3,9\n")
    found = inspect(tmp_path / "export.csv", Reading(hints=Hints(**told))).content()
    assert (found["time"], found["first"]) == ({"column": title, "unit": "s"}, [0.0, 0.0, 0.0])
    assert found["remarks"] == [f"times by {title}"]


def test_a_file_is_read_once(tmp_path, monkeypatch):
    reads = []
    monkeypatch.setattr(tables, "read_lines", lambda path: reads.append(path) or read_lines(path))
    block = "Time (s),Load (N),Stroke (mm)\n{},1,0\n{},2,1\n{},3,2\n"
    assert taken(tmp_path, block.format(0, 1, 2) + block.format(3, 4, 5))["specimens"] == 1
    assert len(reads) == 1


def test_lines_that_end_in_two_returns_and_a_feed_are_one(tmp_path):
    found = taken(tmp_path, "Time (s),Load (N),Stroke (mm)\r\r\n0,1,0\r\r\n1,2,1\r\r\n2,3,2\r\r\n")
    assert found["rows"] == 3


def test_a_length_that_contradicts_the_strains_is_asked_for(tmp_path):
    table = "Time (s),Stroke (mm),Force (N),Strain (%)\n0,0,0,0\n1,0.4,1,0.5\n2,0.8,2,1\n"
    assert taken(tmp_path, "Length,80,mm\n" + table)["length_mm"] == 80.0
    found = taken(tmp_path, "Length,832,mm\n" + table)
    assert found["length_mm"] is None
    assert [question for question in found["ask"] if question.startswith("length")] == [
        "length: 832 mm in the lines above, but 80 mm by 'Strain (%)'; --length-mm"
    ]


@pytest.mark.parametrize(
    ("title", "strains", "contradicted"),
    [
        ("Strain (%)", (2.0, 2.5, 3.0, 3.5), True),  # the strain counts from another zero
        ("Strain (%)", (0.0, 0.5, 0.5, 0.1), False),  # the extensometer was taken off
        ("Strain", (0.0, 0.5, 1.0, 1.5), False),  # in what unit?
    ],
)
def test_strains_tell_a_length_if_they_follow_the_displacement(tmp_path, title, strains, contradicted):
    rows = "".join(f"{i},{0.4 * i},{i},{strain}\n" for i, strain in enumerate(strains))
    found = taken(tmp_path, f"Length,832,mm\nTime (s),Stroke (mm),Force (N),{title}\n{rows}")
    assert found["length_mm"] == (None if contradicted else 832.0)
    told = [question for question in found["ask"] if "but 80 mm by 'Strain (%)'" in question]
    assert len(told) == contradicted


def test_a_column_of_current_lengths_tells_the_gauge_length(tmp_path):
    found = taken(tmp_path, "Time_S,Size_mm,Displacement_mm,Force_N\n0,12.5,0,1\n1,12.6,0.1,2\n2,12.7,0.2,3\n")
    assert (found["length_mm"], found["time"]["unit"]) == (12.5, "s")


def test_a_gauge_length_that_a_preload_has_changed_is_asked_for(tmp_path):
    before = [f"{i},{12.5 + 0.1 * i:g},{0.1 * i:g},{i}" for i in range(50)]
    after = [f"{50 + i},{17.5 + 0.1 * i:g},{0.1 * i:g},{50 + i}" for i in range(50)]
    text = "\n".join(["Time_S,Size_mm,Displacement_mm,Force_N", *before, *after, ""])
    found = taken(tmp_path, text)
    assert found["length_mm"] is None
    assert found["ask"][0] == "length: 12.5 mm by 'Size_mm', and 17.5 mm where it is set to zero again; --length-mm"
    (tmp_path / "preload.csv").write_text(text)
    told = inspect(tmp_path / "preload.csv", Reading(hints=Hints(preload="leave-out"))).content()
    assert told["length_mm"] == pytest.approx(17.5)
    assert not [question for question in told["ask"] if question.startswith("length")]
    kept = inspect(tmp_path / "preload.csv", Reading(hints=Hints(preload="keep"))).content()
    assert kept["length_mm"] == pytest.approx(12.5)
    assert not [question for question in kept["ask"] if question.startswith("length")]


def test_sizes_in_the_name_of_a_file_are_said_and_not_taken(tmp_path):
    path = tmp_path / "T1_L10mm_W8mm.csv"
    path.write_text("Time (s),Load (N),Extension (mm)\n0,1,0\n1,2,1\n2,3,2\n")
    found = inspect(path).content()
    assert (found["length_mm"], found["width_mm"]) == (None, None)
    assert found["ask"] == [
        "length: the file does not give it, but its name may: length 10 mm, width 8 mm; --length-mm",
        "cross-section: the file does not give it, but its name may: length 10 mm, width 8 mm; --area-mm2",
    ]


def test_the_first_length_for_a_gauge_length_is_remarked_on(tmp_path):
    text = "Time (s),Length (mm),Load (N)\n0,12,1\n1,12.5,2\n2,13,3\n"
    remark = "gauge length 12 mm, likely: the length in the first row"
    assert taken(tmp_path, text)["remarks"] == [remark]
    path = tmp_path / "export.csv"
    assert read_exports([path], reading=Reading(area_mm2=4)).remarks == {"export/test": (remark,)}
    told = Reading(area_mm2=4, length_mm=11.5)
    assert (read_exports([path], reading=told).remarks, inspect(path, told).remarks) == ({}, ())
    assert taken(tmp_path, f"Length,11.5,mm\n{text}")["remarks"] == []


def test_units_that_a_file_does_not_tell_are_asked_for(tmp_path):
    found = taken(tmp_path, "Time,Load,Extension (mm)\n0,1,0\n1,2,1\n2,3,2\n")
    assert (found["time"], found["force"]) == ({"column": "Time", "unit": None}, {"column": "Load", "unit": None})
    assert [question.partition(";")[2] for question in found["ask"][:2]] == [" --time-unit", " --force-unit"]


@pytest.mark.parametrize(
    ("title", "clocks", "separator"),
    [
        ("Time", ("00:59:59.9", "01:00:00.0", "01:00:00.25"), ","),
        ("Zeit (hh:mm:ss)", ("9:59:59,9", "10:00:00,0", "10:00:00,25"), ";"),
        ("time (min)", ("59:59.90", "60:00.00", "60:00.25"), "\t"),
        ("Time", ("2024-05-03 00:59:59.9", "2024-05-03 01:00:00", "2024-05-03 01:00:00.25"), ","),
        ("Time", ("3.5.2024 10:22:33.9", "3.5.2024 10:22:34.0", "3.5.2024 10:22:34.25"), ";"),
    ],
)
def test_clock_times_are_seconds_since_the_first_row(tmp_path, title, clocks, separator):
    rows = [(title, "Stroke (mm)", "Load (N)"), *((clock, str(i), str(i + 1)) for i, clock in enumerate(clocks))]
    text = "\n".join(separator.join(row) for row in rows)
    found = taken(tmp_path, text)
    assert found["time"] == {"column": title, "unit": "s"}
    assert (found["rows"], found["first"]) == (3, [0.0, 0.0, 1.0])
    curve = read_export(tmp_path / "export.csv", reading=Reading(length_mm=10, area_mm2=4)).curves[0]
    assert curve.protocol.time_s.tolist() == pytest.approx([0.0, 0.1, 0.35])


def test_a_cell_without_a_number_is_null(tmp_path):
    found = taken(tmp_path, "time s,force N,stroke mm,n\n,1,0,1\n1,2,1,2\n2,3,2,3\n3,4,3,4\n")
    assert found["first"] == [None, 0.0, 1.0]


def test_many_tables_take_no_memory_of_the_square_of_their_number(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("".join(f"a{i},b{i},c{i}\n0,1,0\n1,2,1\n2,3,2\n" for i in range(1000)))
    tracemalloc.start()
    with pytest.raises(BadInput):
        inspect(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 10 * 2**20


def test_what_is_no_test_is_refused(tmp_path):
    titles = ",".join(f"{one} of the room" for one in ("Temperature", "Humidity", "Pressure", *map(str, range(9))))
    with pytest.raises(BadInput, match="no columns of a test among 'Temperature of the room, Hum") as refused:
        taken(tmp_path, f"{titles}\n" + f"{','.join('1' * 12)}\n" * 3)
    assert len(str(refused.value).removeprefix(str(tmp_path))) < 300
    assert "--time-column, --displacement-column and --force-column NAME or NUMBER" in str(refused.value)


@pytest.mark.shared
def test_real_exports_are_right_or_asked_for():
    """Never a silent wrong column, unit or size; of the files, most are right in everything that can be told."""
    wrong, right, files = [], 0, 0
    for truth in sorted(EXPORTS.glob("*/expected.json")):
        for name, expected in json.loads(truth.read_text()).items():
            files += 1
            try:
                found = inspect(truth.parent / name).content()
            except BadInput:
                right += expected["rows"] == 0 or "there is no displacement" in expected["ask"]
                continue
            problems = list(silently_wrong(found, expected))
            wrong += [f"{name}: {problem}" for problem in problems]
            right += not problems and not missed(found, expected)
    assert wrong == []
    assert right >= 39, f"{right} of {files}"


def silently_wrong(found: dict[str, Any], expected: dict[str, Any]):
    for name in ("time", "displacement", "strain", "stretch", "force", "stress"):
        got, want = found.get(name), expected.get(name)
        if isinstance(got, dict) and isinstance(want, dict):
            if got["column"] != want["column"] and got["column"] not in str(want.get("alternatives")):
                yield f"{name} from {got['column']}, not {want['column']}"
            elif got["unit"] not in (None, _seconds(want["unit"])) and "?" not in want["unit"] and want["unit"] != "-":
                yield f"{name} in {got['unit']}, not {want['unit']}"
    for name in SIZES:
        if found[name] is not None and found[name] != pytest.approx(expected.get(name) or 0.0, rel=1e-4):
            yield f"{name} {found[name]}, not {expected.get(name)}"
    peak = expected.get("peak_force_N")
    if None not in (peak, found.get("peak_force_N")) and found["peak_force_N"] != pytest.approx(peak, rel=1e-4):
        yield f"peak {found['peak_force_N']}, not {peak}"


def _seconds(unit: str) -> str:
    """Clock times are read as seconds."""
    return "s" if unit.startswith("clock") else unit


def missed(found: dict[str, Any], expected: dict[str, Any]) -> bool:
    """Whether something that the file states was not found."""
    sizes = any(found[name] is None and expected.get(name) is not None for name in SIZES)
    rows = found["rows"] == expected["rows"] or any("and are left out" in one for one in found["remarks"])
    return sizes or not rows or found["specimens"] != expected["specimens"]


def test_a_column_of_a_rate_is_not_the_displacement(tmp_path):
    found = taken(
        tmp_path,
        "Time (s),Displacement (mm/s),Position (mm),Force (N)\n" + "".join(f"{i},9,{i},{i}\n" for i in range(4)),
    )
    assert found["displacement"] == {"column": "Position (mm)", "unit": "mm"}


def test_rows_with_names_have_no_title_above_them(tmp_path):
    rows = "".join(f'"{i + 1}" {i / 10} {i / 20} {i * 2.5}\n' for i in range(4))
    found = taken(tmp_path, f"time_s displacement_mm force_N\n{rows}")
    assert found["first"] == [0.0, 0.0, 0.0]
    assert found["peak_force_N"] == 7.5


def test_what_an_import_would_refuse_is_asked(tmp_path):
    table = "Time (s),Displacement (mm),Force (N)\n0,0,1\n1,1,2\n2,2,3\n"
    assert len(taken(tmp_path, table)["ask"]) == 2, "length and cross-section"
    broken = taken(tmp_path, table + "3,oops,4\n4,4,5\n5,5,6\n")["ask"]
    assert [question for question in broken if "row 5, Displacement" in question and "oops" in question]


def test_remarks_tell_of_signs_and_of_a_displacement_that_begins_far_off(tmp_path):
    rows = "".join(f"{i},{37.21 + i / 20},{-5 * i}\n" for i in range(6))
    remarks = taken(tmp_path, f"Time (s),Displacement (mm),Force (N)\n{rows}")["remarks"]
    assert [remark for remark in remarks if "starts at 37.21 mm but changes by only 0.25 mm" in remark]
    assert [remark for remark in remarks if "forces are negative" in remark]
    assert taken(tmp_path, "Time (s),Displacement (mm),Force (N)\n0,0,1\n1,1,2\n2,2,3\n")["remarks"] == []


def test_sizes_that_contradict_each_other_are_asked_for(tmp_path):
    rows = "Time (s),Displacement (mm),Force (N)\n0,0,1\n1,1,2\n2,2,3\n"
    found = taken(tmp_path, f'"Width",6.35,mm\n"Thickness",1.524,mm\n"Diameter",5,um\n{rows}')
    assert found["area_mm2"] is None
    said = "cross-section: the file gives a diameter of 0.005 mm, but 6.35 x 1.524 mm is 9.6774 mm2; --area-mm2"
    assert said in found["ask"]
    found = inspect(tmp_path / "export.csv", Reading(area_mm2=9.7)).content()
    assert found["area_mm2"] == 9.7
    assert [question for question in found["ask"] if "cross-section" in question] == []


def test_a_table_without_rows_of_a_test_is_refused(tmp_path):
    for rows, told in (("1;2;3;HBM\n" * 3, "0 rows of numbers"), ("0,1;2;3;4\n" * 2, "2 rows of numbers")):
        with pytest.raises(BadInput, match=f"{told}; expected a test, which has at least 3"):
            taken(tmp_path, f"a;b;c;Extensometer\n{rows}")


def test_other_columns_are_remarked_on_where_something_is_missing(tmp_path):
    rows = "".join(f"{i},{i},{2 * i}\n" for i in range(4))
    found = taken(tmp_path, f"displacement_mm,RD2_force_kN,RD5_force_kN\n{rows}")
    assert found["force"] == {"column": "RD2_force_kN", "unit": "kN"}
    assert found["remarks"][0] == "force from column 2; it may be in another: 'RD5_force_kN'"
    assert found["remarks"][1:] == ["force from column 2, likely by 'force' in its title"]
