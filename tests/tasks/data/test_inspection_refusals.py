"""Files that hold no test, and columns that only a person can tell: what an inspection says of them."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Reading, inspect
from sinew.tasks.data.recordings import read_recordings
from tests.tasks.data.test_sheets import write_workbook


def inspected(tmp_path, titles, rows=None, **hints):
    path = tmp_path / "a.csv"
    width = titles.count(",") + 1
    rows = rows or [[i / 10 + 0.01 * j * i for j in range(width)] for i in range(8)]
    path.write_text("\n".join([titles, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return inspect(path, Reading(hints=Hints(**hints)))


def taken(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_text(text)
    return inspect(path).content()


def test_a_table_without_titles_is_asked_for(tmp_path):
    found = taken(tmp_path, "0,1,2\n0.1,1.1,2.1\n0.2,1.2,2.2\n")
    assert (found["rows"], found["time"], found["force"]) == (3, None, None)
    assert [one.rpartition("; ")[2] for one in found["ask"][:3]] == [
        "--time-column NUMBER and --time-unit, --rate-hz, --speed or --speed-column",
        "--displacement-column NUMBER and --displacement-unit",
        "--force-column NUMBER and --force-unit",
    ]


@pytest.mark.parametrize(
    ("titles", "words"),
    [
        ("time_ms,force_N", "no title names displacement, and there are no other columns of numbers"),
        ("Time (s),Load (Volts),Accel (Volts)", "no title names displacement, and there are no other columns"),
        ("time_s,data", "no title names displacement or force, and there is 1 other column of numbers"),
        ("Ca_pct,f,E_kPa", "no columns of a test among 'Ca_pct, f, E_kPa'; expected titles of time"),
        ("Analog1[V],Analog2[V]", "no columns of a test .* expected forces and displacements: multiply the signals"),
        ("No,max_force,fracture_force,yield_disp,fracture_disp,yield_force", "no columns of a test"),
        (
            "Step time (s),Oscillation strain (%),Oscillation stress (MPa),Storage modulus (MPa)",
            "'Storage modulus .*amp",
        ),
    ],
)
def test_files_that_cannot_hold_a_test_are_refused(tmp_path, titles, words):
    with pytest.raises(BadInput, match=words):
        inspected(tmp_path, titles)


def test_a_column_that_counts_the_rows_is_no_force(tmp_path):
    rows = [[i, i / 10] for i in range(8)]
    with pytest.raises(BadInput, match="no title names force, and there are no other columns of numbers"):
        inspected(tmp_path, "Pixel Row,strain", rows)
    assert inspected(tmp_path, "Pixel Row,strain", [[2 * i, i / 10] for i in range(8)]).rows == 8


def test_other_columns_may_be_named_by_a_person(tmp_path):
    for titles in ("time_s,displacement_mm,data", "Fout,Lin,Lout"):
        unit = {} if titles[0] == "t" else {"displacement_column": "Lout", "rate_hz": 10.0}
        asked = inspected(tmp_path, titles, force_column=titles.split(",")[-1 if not unit else 0], **unit).questions
        assert "no unit of the force or stress can be found; --force-unit" in " ".join(asked)
        assert ("displacement-unit" in " ".join(asked)) == bool(unit)


def test_a_person_may_tell_the_unit_of_a_column_whose_own_is_not_known(tmp_path):
    hints = {"displacement_column": "2", "displacement_unit": "1", "force_column": "3", "force_unit": "kPa"}
    found = inspected(tmp_path, "Time [s],transverse (XF) stretch,transverse (XF) stress", **hints)
    assert [one.unit for one in found.columns] == ["s", "1", "kPa"]


def test_a_column_in_volts_that_a_person_names_is_refused_for_its_unit(tmp_path):
    for told in ({}, {"force_unit": "N"}):
        found = inspected(tmp_path, "Time (s),Disp (mm),ai0 (V),ai1 (V)", force_column="3", **told)
        assert "unit 'V' is that of a sensor's signal, no force" in found.questions[0]


def test_tests_without_times_that_two_columns_tell_apart_are_counted(tmp_path):
    rows = [[a, b, i / 100, i * i] for a in "xy" for b in (1, 2, 3) for i in range(20)]
    found = inspected(tmp_path, "TestID,RepeatID,Strain (%),Stress (MPa)", rows)
    assert found.specimens == 6 and "6 tests in one table, one for each 'TestID, RepeatID'?" in " ".join(
        found.questions
    )
    rows = [[7.5 + ord(a), a, i / 100, i * i] for a in "xyz" for i in range(20)]
    found = inspected(tmp_path, "Density,TestID,Strain (%),Stress (MPa)", rows)
    assert found.specimens == 3 and "one for each 'TestID'?" in " ".join(found.questions)


def test_a_size_beside_a_positive_compression_tells_the_length(tmp_path):
    rows = [[i, 29.5 - i / 10, i / 10, 2 * i] for i in range(8)]
    assert inspected(tmp_path, "Time_S,Size_mm,Displacement_mm,Force_N", rows).sizes["length"] == pytest.approx(29.5)


def test_a_displacement_with_an_offset_is_no_compression(tmp_path):
    rows = [[i, -21.2 + i, 2 * i] for i in range(20)]
    found = inspected(tmp_path, "Time_s,Displacement_mm,Force_N", rows)
    assert any("may be an offset" in one for one in found.remarks) and not any(
        "shorter" in one for one in found.remarks
    )


def test_a_displacement_that_hardly_moves_may_be_that_of_a_sensor_which_is_not_used(tmp_path):
    rows = [[i, i // 20 / 100, 3 * i, i / 7] for i in range(50)]
    found = inspected(tmp_path, "Time_s,Distance,Load_N,Strain", rows)
    assert "it may be in another: 'Strain'" in str(found.remarks)
    assert "it may be" not in str(inspected(tmp_path, "Time_s,Distance_mm,Load_N,Strain", rows).remarks)
    rows = [[i, i / 100, 3 * i, i / 7] for i in range(50)]
    assert "it may be" not in str(inspected(tmp_path, "Time_s,Distance,Load_N,Strain", rows).remarks)


def test_simulated_columns_beside_measured_ones_are_no_test(tmp_path):
    titles = "elongation (um),force (gf),,time (s),strain (%),stress (N/m2)\n"
    rows = "".join(f"{i},{2 * i},,{i / 10},{i},{3 * i}\n" for i in range(6))
    found = taken(tmp_path, f"measurement,,,simulation high speed,,\n{titles}{rows}")
    assert (found["time"], found["displacement"]["column"], found["rows"]) == (None, "elongation (um)", 6)
    assert taken(tmp_path, f"measurement,,,high speed,,\n{titles}{rows}")["time"]["column"] == "time (s)"
    assert taken(tmp_path, f"simulation,,,high speed,,\n{titles}{rows}")["displacement"] is not None


def test_sizes_may_stand_in_columns_of_the_table(tmp_path):
    titles = "Time (s),Extension (mm),Load (N),Original Length (mm),Original Diameter (mm),Final Diameter (mm)"
    rows = [[i, i / 10, 2 * i, *((25.4, 7.08, 5.5) if i == 0 else ("", "", ""))] for i in range(8)]
    found = inspected(tmp_path, titles, rows)
    assert (found.sizes["length"], found.sizes["diameter"], found.questions) == (25.4, 7.08, ())
    assert [round(one.sizes["diameter"].mm, 2) for one in found.recordings] == [7.08]
    held = [[i, 20.0, 9 - i] for i in range(8)]
    found = inspected(tmp_path, "Time (s),Length (mm),Load (N)", held)
    assert found.recordings[0].sizes == {}, "the motion itself is no size, though it rests"
    changing = [[i, i / 10, 2 * i, 25.4, 7.08 - i / 100, 5.5] for i in range(8)]
    found = inspected(tmp_path, titles, changing)
    assert (found.sizes["length"], found.sizes["diameter"]) == (25.4, None)


def test_a_sheet_of_two_columns_may_be_the_test_beside_one_with_more(tmp_path):
    results = [
        ["", "Fmax", "a0", "b0"],
        ["", "N", "mm", "mm"],
        ["", 25.3, 4.8, 60.0],
        ["", 25.1, 4.7, 60.0],
        ["", 24, 5, 60],
    ]
    curve = [["Strain", "Stress"], ["%", "MPa"], *[[i / 10, i / 3] for i in range(9)]]
    path = write_workbook(tmp_path / "a.xlsx", Parameters=results, Test=curve)
    found = inspect(path, Reading(hints=Hints(rate_hz=10.0)))
    assert (found.sheet, found.rows, [one.quantity.name for one in found.columns[1:]]) == (
        "Test",
        9,
        ["strain", "stress"],
    )
    assert len(found.recordings) == 1
    odd = [["Bending strain", "Bending stress"], *curve[1:]]
    path = write_workbook(tmp_path / "a.xlsx", Parameters=results, Test=odd)
    with pytest.raises(BadInput, match="no columns of a test"):
        inspect(path)
    hints = Hints(displacement_column="Bending strain", force_column="Bending stress", rate_hz=10.0)
    assert inspect(path, Reading(hints=hints)).rows == 9


def test_a_sheet_with_units_in_place_of_titles_is_passed_over(tmp_path):
    summary = [["s", "mm", "mN", "mN"], *[[i, i / 10, i, 2 * i] for i in range(6)]]
    curve = [["Time", "Depth", "Load"], ["s", "nm", "mN"], *[[i, 5 * i, i / 3] for i in range(9)]]
    found = inspect(write_workbook(tmp_path / "a.xlsx", Summary=summary, Test=curve))
    assert (found.sheet, found.rows) == ("Test", 9)
    with pytest.raises(BadInput, match="units in place of titles, of which several are alike"):
        read_recordings(write_workbook(tmp_path / "b.xlsx", Summary=summary), Hints())
    alone = [["s", "mm", "mN"], *[[i, i / 10, i] for i in range(6)]]
    assert inspect(write_workbook(tmp_path / "d.xlsx", Alone=alone, Test=curve)).sheet == "Alone", "none is alike"
    both = [["s", "mm", "mN", "s", "mm", "mN"], *[[i, i / 10, i, i, i / 10, 2 * i] for i in range(6)]]
    assert inspect(write_workbook(tmp_path / "c.xlsx", Both=both)).specimens == 2


def test_columns_by_number_need_no_titles_where_times_are_told(tmp_path):
    titles, rows = "A_1,0.371,A_2,0.370", [[i, 2 * i, 0, i, 3 * i, 0] for i in range(8)]
    told = {"displacement_unit": "mm", "force_unit": "N", "rate_hz": 10.0}
    found = inspected(tmp_path, titles, rows, displacement_column="1", force_column="2", **told)
    assert len(found.recordings) == 1 and not any("names above" in one for one in found.questions)


def test_true_strains_and_stresses_are_refused_for_what_they_are(tmp_path):
    with pytest.raises(
        BadInput,
        match="'true strain, true stress'; expected engineering strain and stress, which are of the first sizes",
    ):
        inspected(tmp_path, "true strain,true stress")


def test_a_speed_is_not_offered_where_the_motion_turns_often(tmp_path):
    def asked(moved):
        ask = inspected(tmp_path, "Position (mm),Force (N)", [[x, i] for i, x in enumerate(moved)]).content()["ask"][0]
        return "--speed" in ask

    assert asked([i / 10 for i in range(40)])
    assert not asked([i / 10 + 0.3 * (i % 2) for i in range(40)])


@pytest.mark.parametrize("unit", ["g", "kg"])
def test_a_load_in_units_of_a_mass_is_a_force_whose_unit_is_asked_for(tmp_path, unit):
    found = inspected(tmp_path, f"Time (s),Disp (mm),Load 3 ({unit})").content()
    assert found["force"]["column"] == f"Load 3 ({unit})"
    assert any(f"unit '{unit}' of the force is not known" in one for one in found["ask"])
    with pytest.raises(BadInput, match="no title names force"):
        inspected(tmp_path, "Time (s),Disp (mm),Load 3 (V)")


def test_titles_in_brackets_and_in_turkish(tmp_path):
    found = inspected(tmp_path, "(Time),(Position),(Load)").content()
    assert [found[name]["column"] for name in ("time", "displacement", "force")] == ["(Time)", "(Position)", "(Load)"]
    found = inspected(tmp_path, "Saat (sec),Uzama (mm),Yük (N),Çekme gerinimi (mm/mm)").content()
    assert [found[name]["unit"] for name in ("time", "displacement", "force")] == ["sec", "mm", "N"]


def test_columns_of_the_same_times_go_before_those_of_a_table_beside_them(tmp_path):
    """A camera beside a rheometer: 'D' would be a displacement, but its times are others than those of the force."""
    titles = "Time (s),Axial force (N),Gap (mm),,Time (s),D (mm)"
    path = tmp_path / "a.csv"
    path.write_text(f"{titles}\n" + "".join(f"{i},{i},{9 - i / 10},,{7 * i},0.{i}\n" for i in range(9)))
    assert inspect(path).content()["displacement"] == {"column": "Gap (mm)", "unit": "mm"}


def test_columns_of_a_refused_table_are_told_by_their_units(tmp_path):
    told = r"--force-column NAME or NUMBER \(by their units, 'Z\(m\)' and 'A\(N\)' or 'B\(N\)'\)"
    with pytest.raises(BadInput, match=told):
        inspected(tmp_path, "Z(m),A(N),B(N)")
    with pytest.raises(BadInput, match=r"--force-column NAME or NUMBER$"):
        inspected(tmp_path, "Z(m),A,B")


def test_single_letters_are_titles_where_they_stand_together(tmp_path):
    found = inspected(tmp_path, "F,h,t").content()
    assert (found["force"]["column"], found["time"]["column"]) == ("F", "t")
    with pytest.raises(BadInput, match="no columns of a test among"):
        inspected(tmp_path, "F,Ca,K")
