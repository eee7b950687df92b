"""Columns that are alike, and titles that may mean two things."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import GIVEN, SURE, partly, recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import DISPLACEMENT, STRAIN, STRESS, STRETCH
from sinew.tasks.data.questions import NoColumn, UnknownUnit
from tests.tasks.data.test_columns import columns, table_of


def test_of_columns_alike_none_is_taken_unless_that_is_asked_for():
    with pytest.raises(BadInput, match="may both be the force"):
        recognise(table_of("t_s|u_mm|F_N|F_N", *["0|1|2|3"] * 3), Hints())


def test_forces_of_several_specimens_are_never_taken_unasked():
    table = table_of("t_s|u_mm|RD2_force_kN|RD5_force_kN|TD2_force_kN", *["0|1|2|3|4"] * 3)
    for first_of_alike in (False, True):
        with pytest.raises(BadInput, match="'RD2_force_kN' and 'RD5_force_kN' and 1 more may each be the force"):
            recognise(table, Hints(), first_of_alike=first_of_alike)
    assert "--force-column, one of 'RD2_force_kN'" in partly(table, Hints())[1][0]
    assert recognise(table, Hints(force_column="TD2_force_kN"))[2].title == "TD2_force_kN"
    twice = table_of("t_s|u_mm|RD2_force_kN|RD2_force_kN", *["0|1|2|3"] * 3)  # of one specimen: told as others
    assert recognise(twice, Hints(), first_of_alike=True)[2].alike == ("RD2_force_kN",)


def test_columns_of_two_clocks_that_a_person_names_keep_their_units():
    table = table_of("Time_a [s]|Fn_a [mN]|Time_a [s]|Pd_a [nm]", *["0|1|0|2"] * 3)
    found = recognise(table, Hints(time_column="1", displacement_column="4", force_column="2"))
    assert [(one.place, one.unit) for one in found] == [(0, "s"), (3, "nm"), (1, "mN")]


@pytest.mark.parametrize("title", ["Time_0", "time 1"])
def test_a_time_may_have_a_number_and_no_unit(title):
    with pytest.raises(UnknownUnit, match="no unit of the time"):
        columns(f"{title}|u_mm|F_N")
    assert columns(f"{title}|u_mm|F_N", time_unit="ms")[0].title == title


@pytest.mark.parametrize(
    ("title", "quantity"),
    [("Extensometer (mm)", "displacement"), ("变形(mm)", "displacement"), ("Extensometer (%)", "strain"),
     ("LVDT (mm/mm)", "strain"), ("Déform1[mm]", "displacement")],
)  # fmt: skip
def test_an_extensometer_goes_before_the_machine_which_may_be_meant_as_well(title, quantity):
    table = table_of(f"t_s|Crosshead (mm)|F_N|{title}|Disp (mm)", "0|0|1|0|0", "1|2|2|1|2", "2|4|3|2|4")
    motion = recognise(table, Hints(), first_of_alike=True)[1]
    assert (motion.title, motion.quantity.name) == (title, quantity)
    assert motion.alike == ("Crosshead (mm)", "Disp (mm)")
    with pytest.raises(BadInput, match="and 1 more may each be the"):
        recognise(table, Hints())


@pytest.mark.parametrize("told", [{}, {"displacement_unit": "mm"}])
@pytest.mark.parametrize("title", ["LVDT (V)", "Extensometer [mV]", "Extensometer"])
@pytest.mark.parametrize("machine", ["Displacement (mm)", "Position (mm)"])
def test_an_extensometer_without_a_known_unit_is_not_taken_before_the_machine(title, machine, told):
    assert columns(f"t_s|{title}|{machine}|F_N", **told)[1].title == machine


def test_an_extensometer_without_a_known_unit_is_taken_where_nothing_else_is():
    assert columns("t_s|LVDT (V)|Disp|F_N", displacement_unit="mm")[1].title == "Disp"
    assert columns("t_s|Extensometer|F_N", displacement_unit="mm")[1].title == "Extensometer"
    with pytest.raises(BadInput, match="'Disp' and 'Extensometer' may both be the displacement"):
        columns("t_s|Extensometer|Disp|F_N", displacement_unit="mm")


@pytest.mark.parametrize("unit", ["V", "Volt", "mV/V"])
@pytest.mark.parametrize("told", [None, "mm"])
def test_a_signal_of_a_sensor_has_no_unit_that_could_be_told(unit, told):
    with pytest.raises(BadInput, match="multiply the signal by the factor of its sensor first") as refused:
        columns(f"t_s|LVDT ({unit})|F_N", displacement_unit=told)
    assert not isinstance(refused.value, UnknownUnit)


@pytest.mark.parametrize(
    "titles",
    [
        ("Zeit  1 - Standardmessrate [s]", "Weg WA20_CH 2 [µm]", "Kraft U9C_500N_MX840B_0_CH 1 [kN]"),
        ("Time  1 - default sample rate [s]", "Disp/AI A-2 (um)", "Force/AI A-1 (kN)"),
    ],
)
def test_names_of_channels_behind_those_of_quantities_do_not_hide_them(titles):
    recognised = columns("|".join(titles))
    assert tuple(column.title for column in recognised) == titles
    assert {column.how for column in recognised} == {"likely"}


@pytest.mark.parametrize(
    "other",
    [
        "Force limit 1 (N)",
        "Force rate 2 (N)",
        "Force temp 3 (N)",
        "Force U9C",
        "Force A (N)",
        "Kraft Soll 1 (N)",
        "Force Sollwert 1 (N)",
        "Force consigne 1 (N)",
        "Force SP1 (N)",
        "Force Peak1 (N)",
        "Force max 1 (N)",
        "Force lateral 1 (N)",
        "Force at 0.2% (N)",
        "Force rates 1 (N)",
        "Force x1000 (N)",
        "Load/Width 10 mm (N)",
        "Kraft bei Bruch 1 (N)",
        "Force offset1 (N)",
        "Force error1 (N)",
        "Force setpoint1 (N)",
        "Force avg1 (N)",
        "Force ch1+ch2 (N)",
        "Force 1000x (N)",
        "Load drop1 (N)",
        "Force/area1 (N)",
    ],
)
def test_what_else_is_told_of_a_channel_may_make_another_quantity_of_it(other):
    with pytest.raises(BadInput, match="no column of force or stress"):
        columns(f"t_s|Disp_mm|{other}")


def test_a_plain_name_goes_before_that_of_a_channel():
    assert columns("t_s|Disp_mm|Force CH 2 (N)|Force (N)")[2].title == "Force (N)"
    with pytest.raises(BadInput, match="may both be the force"):
        columns("t_s|Disp_mm|Force CH 1 (N)|Force CH 2 (N)")


def test_a_number_at_the_end_of_a_name_is_that_of_a_channel():
    recognised = columns("Time [s]|Disp1 [µm]|Force1 [mN]")
    assert [(column.title, column.unit) for column in recognised[1:]] == [("Disp1 [µm]", "μm"), ("Force1 [mN]", "mN")]
    assert {column.how for column in recognised[1:]} == {"likely"}
    assert columns("t_s|Disp_mm|Force1 (N)|Force (N)")[2].title == "Force (N)"
    with pytest.raises(BadInput, match="may both be the force"):
        columns("t_s|Disp_mm|Force1 (N)|Force2 (N)")
    with pytest.raises(BadInput, match="no column of force or stress"):
        columns("t_s|Disp_mm|Forces1 (N)|P1 (N)")


@pytest.mark.parametrize(
    "titles",
    [
        ("Time measurement (s)", "Extension (mm)", "Primary load measurement (N)"),
        ("Zeit Messwert [s]", "Standardwegaufnehmer [mm]", "Kraft Istwert [kN]"),
        ("t_s", "Déformation nominale (%)", "Contrainte nominale (MPa)"),
        ("t_s", "Steel1_Strain_%", "Steel1_Stress_MPa"),
        ("t_s", "Position des Aktuators (mm)", "RD2_force_kN"),
        ("current_time (s)", "Lead Actuator Displacment (mm)", "Lead Actuator Force (kN)"),
        ("Millis", "Travel (mm)", "Scale (gf)"),
    ],
)
def test_words_that_change_nothing_do_not_hide_a_name(titles):
    assert tuple(column.title for column in columns("|".join(titles))) == titles


def test_names_of_specimens_in_front_of_others_leave_a_question():
    with pytest.raises(BadInput, match="'RD2_force_kN' and 'RD5_force_kN' may both be the force"):
        columns("t_s|Disp_mm|RD2_force_kN|RD5_force_kN")
    with pytest.raises(BadInput, match="no unit of the stress can be found"):
        columns("t_s|Déformation nominale (%)|Contrainte nominale")
    for other in ("SP1 force (N)", "Max1 force (N)", "Nominal (N)", "Force nominal (N)", "Peak1 Force (N)"):
        with pytest.raises(BadInput, match="no column of force or stress"):
            columns(f"t_s|Disp_mm|{other}")
    for other in ("Steel1 Force (mm)", "Primary load limit (N)", "Kraft Soll1 (N)"):
        with pytest.raises(BadInput, match="no column of force or stress"):
            columns(f"t_s|Disp_mm|{other}")


def test_an_extensometer_that_does_not_move_with_the_machine_is_not_taken():
    titles, rng = "t_s|Position (mm)|Extensometer (mm)|F_N", np.random.default_rng(3)
    noise, force = 1e-4 * rng.standard_normal(60), np.arange(60.0)
    noise[-1] = 1.0  # at the break
    for sensor, taken in ((noise, "Position (mm)"), (noise + 0.001 * force, "Extensometer (mm)")):
        rows = [f"{i}|{0.05 * i:.4f}|{each:.6f}|{i}" for i, each in enumerate(sensor)]
        motion = recognise(table_of(titles, *rows), Hints(), first_of_alike=True)[1]
        assert motion.title == taken
        assert motion.alike == tuple({"Position (mm)", "Extensometer (mm)"} - {taken})
    still = [f"{i}|{0.05 * i:.4f}|{0.001 if i == 30 else 0.0}|{i}" for i in range(60)]
    motion = recognise(table_of(titles, *still), Hints(), first_of_alike=True)[1]
    assert motion.title == "Position (mm)", "zeros but for a glitch"
    held = [f"{i}|{min(i, 6)}|{0.1 * min(i, 6) + each:.6f}|{i}" for i, each in enumerate(noise)]
    motion = recognise(table_of(titles, *held), Hints(), first_of_alike=True)[1]
    assert motion.title == "Extensometer (mm)", "most rows are of a hold, where both rest"
    gone = [f"{i}|{0.05 * i:.4f}|{0.01 * i if i < 50 else ''}|{i}" for i in range(60)]
    motion = recognise(table_of(titles, *gone), Hints(), first_of_alike=True)[1]
    assert motion.title == "Position (mm)", "the extensometer was taken off"


def test_files_may_have_one_of_several_titles_that_are_given():
    given = {"displacement_column": ("Way", "Gap"), "displacement_unit": "mm"}
    assert columns("t_s|Gap|F_N", **given)[1].title == "Gap"
    assert columns("t_s|Gap|Way|F_N", **given)[1].title == "Way"
    with pytest.raises(BadInput, match=r"none of 'Way', 'Gap' is a column; .* repeat --displacement-column"):
        columns("t_s|Other|F_N", **given)
    with pytest.raises(BadInput, match="'Gap' names 2 columns"):
        columns("t_s|Gap|Gap|F_N", **given)


def test_a_column_that_never_changes_is_taken_only_if_no_other_does():
    table = table_of("t_s|Extensometer (mm)|F_N|Crosshead (mm)", "0|0.0|1|0", "1|0.0|2|2", "2|0.0|3|4")
    assert recognise(table, Hints())[1].title == "Crosshead (mm)"
    table = table_of("t_s|Disp (mm)|F_N|Crosshead (mm)", "0|5|1|0", "1|5|2|0", "2|5|3|0")
    assert recognise(table, Hints())[1].title == "Disp (mm)"


def test_a_displacement_that_never_changes_beside_a_strain_is_named():
    table = table_of("t_s|Displacement (mm)|F_N|Strain (%)", "0|5|1|0", "1|5|2|1", "2|5|3|2")
    motion = recognise(table, Hints(), first_of_alike=True)[1]
    assert (motion.title, motion.alike) == ("Strain (%)", ("Displacement (mm)",))
    with pytest.raises(BadInput, match=r"'Strain \(%\)' and 'Displacement \(mm\)' may both be the strain"):
        recognise(table, Hints())
    table = table_of("t_s|Extensometer (mm)|F_N|Strain (%)|Length (mm)", "0|0|1|0|9", "1|0|2|1|9", "2|0|3|2|9")
    assert recognise(table, Hints())[1].title == "Strain (%)"
    table = table_of("t_s|mm|F_N|Strain (%)", "0|5|1|0", "1|6|2|1", "2|7|3|2")
    assert recognise(table, Hints())[1].title == "Strain (%)"


def test_texts_beyond_the_titles_do_no_harm_and_numbers_do():
    assert len(recognise(table_of("t_s|u_mm|F_N", *["0|1|2|note"] * 3), Hints())) == 3
    for titles, row in (("t_s|u_mm|F_N", "0.5|1.5|2.5|3.5"), ("t_s|u_mm|F_N|||", "0|1|2|3|4|5")):
        with pytest.raises(BadInput, match=r"3 names above . columns of numbers"):
            recognise(table_of(titles, *[row] * 3), Hints())
    numbered = Hints(time_column="1", displacement_column="2", force_column="3")
    assert len(recognise(table_of("t_s|u_mm|F_N", *["0|1|2|3|4|5"] * 3), numbered)) == 3, "they are told by number"


def test_the_first_row_tells_how_many_columns_there_are():
    found = recognise(table_of("t_s|u_mm", "0|1|2", "0|1"), Hints(force_column="3", force_unit="N", time_column="1",
                                                               displacement_column="2"))  # fmt: skip
    assert found[2].place == 2


@pytest.mark.parametrize(
    "titles",
    ["#time_s|u_mm|force_N", "'time (s)'|\"u (mm)\"|F_N", "Test-Time (s)|Crosshead.Displacement [mm]|Load:Cell (N)"],
)
def test_marks_around_and_in_titles_do_not_count(titles):
    assert [column.quantity.name for column in columns(titles)] == ["time", "displacement", "force"]


def test_long_titles_are_listed_in_full():
    titles = "|".join(f"a long title with a number {i}" for i in range(5))
    with pytest.raises(NoColumn, match=r"among 'a long title with a number 0, .* number 4'; expected"):
        columns(titles)


def test_how_sure_a_choice_is():
    assert columns("time_s|Tensile displacement (mm)|F_N")[1].how == "sure"
    assert columns("time_s|Deformation (mm)|F_N")[1].how == "likely", "a title that may mean something else"
    assert columns("time_s|u_mm|Static Force (N)")[2].how == "likely", "only the mean load of a DMA, perhaps"
    assert columns("time_s|u|F_N", displacement_unit="mm")[1].how == "as you said"
    assert columns("time_s|Stretch|F_N")[1].how == "likely"


def test_a_title_that_is_only_a_unit_is_the_last_resort():
    assert [one.title for one in columns("Time (s)|u_mm|N|Stress (MPa)")][2] == "Stress (MPa)"
    time, _, _ = columns("t|s|u_mm|F_N", time_unit="s")
    assert time.title == "t"
    assert [one.title for one in columns("s|µm|N")] == ["s", "µm", "N"]


def test_a_number_behind_a_title_is_no_unit():
    _, motion, _ = columns("Time|Strain 1|Load", units="(s)|(%)|(N)")
    assert (motion.unit, motion.factor) == ("%", 0.01)


def test_a_person_tells_what_an_unknown_unit_means():
    time, _, _ = columns("time (h:m)|u_mm|F_N", time_unit="min")
    assert (time.unit, time.factor, time.how) == ("min", 60.0, GIVEN)
    with pytest.raises(BadInput, match="unit 's', but --time-unit says min"):
        columns("time (s)|u_mm|F_N", time_unit="min")


def test_what_is_asked_is_told_apart():
    with pytest.raises(UnknownUnit) as asked:
        columns("time_s|u_mm|force (mn)")
    assert (asked.value.quantity, asked.value.option, asked.value.choices) == ("force", "--force-unit", ("mN",))
    with pytest.raises(UnknownUnit) as asked:
        columns("time|u_mm|F_N")
    assert (asked.value.quantity, asked.value.choices[:2]) == ("time", ("s", "ms"))


def test_a_number_of_a_column_with_another_title_is_refused():
    by_number = {"time_column": "1", "displacement_column": "2", "force_column": "3"}
    assert columns("time_s|u_mm|force_N", **by_number)
    with pytest.raises(BadInput, match="--displacement-column: column 2 is 'Load', a force; expected its title"):
        columns("time_s|Load|Ext", displacement_unit="mm", force_unit="N", **by_number)
    by_title = {"time_column": "1", "displacement_column": "Load", "force_column": "Ext"}
    assert columns("time_s|Load|Ext", displacement_unit="mm", force_unit="N", **by_title)


@pytest.mark.parametrize("title", ["Eyy (%)", "Eyy (mm/mm)", "Streckung (%)", "Stretch (%)"])
def test_what_begins_at_zero_is_no_stretch(title):
    motion = columns(f"{title}|Force (N)|Time (s)", displacement_column="1")[1]
    assert motion.quantity is STRAIN
    assert motion.factor == (0.01 if "%" in title else 1.0)


@pytest.mark.parametrize("title", ["Streckung (%)", "Stretch (%)"])
def test_a_stretch_is_one_only_if_no_length_is_zero(title):
    assert columns(f"{title}|Force (N)|Time (s)")[1].quantity is STRAIN
    assert columns(f"Time (s)|{title.partition(' ')[0]}|Force (N)")[1].quantity is STRETCH, "it begins at 1"
    with pytest.raises(UnknownUnit, match="no unit of the strain"):
        columns(f"{title.partition(' ')[0]}|Force (N)|Time (s)")


@pytest.mark.parametrize(("unit", "quantity"), [("%", STRAIN), ("mm/mm", STRAIN), ("mm", DISPLACEMENT)])
@pytest.mark.parametrize("word", ["Elongation", "Extension", "Deformation", "Verlängerung"])
def test_an_elongation_in_percent_is_a_strain(word, unit, quantity):
    time, motion, _ = columns(f"Time (s)|{word} ({unit})|Force (N)")
    assert motion.quantity is quantity
    assert time.how == SURE
    assert (motion.how == SURE) == (quantity is DISPLACEMENT and word != "Deformation")


def test_a_column_that_is_named_is_what_its_unit_says():
    assert columns("Zeit (s)|Dehnung (mm)|Kraft (N)", displacement_column="Dehnung")[1].quantity is DISPLACEMENT
    assert columns("Zeit (s)|Weg (mm)|F (MPa)", force_column="F")[2].quantity is STRESS


def test_a_displacement_by_an_extensometer_is_asked_for_beside_the_machines():
    titles = "Time (s)|Extension (mm)|Load (N)|Displacement (Strain 1) (mm)"
    with pytest.raises(BadInput, match=r"'Displacement \(Strain 1\) \(mm\)' and 'Extension \(mm\)' may both"):
        columns(titles)
    assert columns(titles, displacement_column="Extension")[1].title == "Extension (mm)"


@pytest.mark.parametrize("what", ["Maximum", "max", "Mean", "Amplitude"])
def test_what_is_told_of_a_cycle_is_no_curve(what):
    with pytest.raises(NoColumn, match="no column of force or stress"):
        columns(f"Time (s)|Weg (mm)|Load ({what}) (N)")


@pytest.mark.parametrize("unit", ["-", "1"])
def test_a_mark_in_place_of_a_unit_is_none(unit):
    with pytest.raises(UnknownUnit):
        columns("Time|Weg|Kraft", units=f"s|mm|{unit}")
    assert columns("Time|Weg|Kraft", units=f"s|mm|{unit}", force_unit="kN")[2].factor == 1e3
