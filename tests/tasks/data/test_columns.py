"""Which column holds what, in which unit: recognised by titles, read or given, never assumed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import GIVEN, LIKELY, SURE, Column, recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import DISPLACEMENT, FORCE, LENGTH, POSITION, STRAIN, STRESS, STRETCH
from sinew.tasks.data.questions import NoColumn, UnknownUnit
from sinew.tasks.data.tables import Table

NUMBERS = ["0", "1", "2", "3", "4", "5"]


def columns(
    titles: str, *, units: str = "", numbers: int | None = None, first: bool = False, **hints: str
) -> list[Column]:
    """The columns of a table with these titles, separated by ``|``, above a row of numbers."""
    cells = tuple(titles.split("|")) if titles else ()
    row = tuple(NUMBERS[: numbers or len(cells)])
    below = tuple(units.split("|")) if units else ()
    table = Table("test.csv", (), cells, below, [(i, row) for i in (2, 3, 4)], "|", ".", 1 if cells else 0)
    return list(recognise(table, Hints(**hints), first_of_alike=first))


def test_titles_that_tests_beside_each_other_repeat_are_certain():
    repeated = columns("Time (s)|Weg (mm)|Kraft (N)|Time (s)|Weg (mm)|Kraft (N)", first=True)
    assert [column.how for column in repeated] == [SURE] * 3
    other = columns("Time (s)|Weg (mm)|Kraft (N)|Load (N)", first=True)
    assert [column.how for column in other] == [SURE, SURE, LIKELY]
    shared = columns("Time (s)|Weg (mm)|Kraft (N)|Weg (mm)|Kraft (N)", first=True)
    assert [column.how for column in shared] == [SURE, LIKELY, LIKELY], "perhaps two sensors of one test"


@pytest.mark.parametrize(
    ("title", "quantity", "factor"),
    [
        ("Strain (%)", STRAIN, 0.01),
        ("strain [mm/mm]", STRAIN, 1.0),
        ("Tensile strain (1)", STRAIN, 1.0),
        ("Tensile strain (Extension) (mm/mm)", STRAIN, 1.0),
        ("L/L0", STRETCH, 1.0),
        ("Stretch", STRETCH, 1.0),
        ("Length ratio [%]", STRETCH, 0.01),
        ("L", STRETCH, 1.0),
        ("L (L/L0)", STRETCH, 1.0),
        ("L (mm)", LENGTH, 1.0),
        ("Position (mm)", POSITION, 1.0),
        ("Length (m)", LENGTH, 1000.0),
        ("Crosshead displacement, mm", DISPLACEMENT, 1.0),
        ("displacement in mm", DISPLACEMENT, 1.0),
        ("Displacement_MM", DISPLACEMENT, 1.0),
        ("CrossheadDisplacement / mm", DISPLACEMENT, 1.0),
        ("ΔL (µm)", DISPLACEMENT, 1e-3),
    ],
)
def test_kinds_of_motion(title, quantity, factor):
    _, motion, _ = columns(f"time_s|{title}|force_N")
    assert (motion.quantity, motion.factor, motion.place) == (quantity, factor, 1)


@pytest.mark.parametrize(
    ("title", "quantity", "factor"),
    [
        ("stress (kPa)", STRESS, 1e-3),
        ("Tension [MPa]", STRESS, 1.0),
        ("Stress (N/mm2)", STRESS, 1.0),
        ("stress (mpa)", STRESS, 1.0),
        ("Load (N) (filtered)", FORCE, 1.0),
        ("Kraft [KN]", FORCE, 1000.0),
        ("F / mN", FORCE, 1e-3),
    ],
)
def test_kinds_of_load(title, quantity, factor):
    *_, load = columns(f"time_s|u_mm|{title}")
    assert (load.quantity, load.factor) == (quantity, factor)


def test_units_in_the_row_below():
    found = columns("Time|Extension|Load (cell 1)|SD", units="(ms)|[um]|(kN)|")
    assert [column.factor for column in found] == [1e-3, 1e-3, 1000.0]
    assert [column.unit for column in found] == ["ms", "um", "kN"]


@given(missing=st.integers(0, 2), spelling=st.sampled_from(["{0}", "{0} ()", "{0} []", "{0} (-?)", "{0} (1)"]))
def test_a_unit_is_never_assumed(missing, spelling):
    titles = ["time (s)", "displacement (mm)", "force (N)"]
    titles[missing] = spelling.format(titles[missing].split()[0])
    with pytest.raises(BadInput) as refused:
        columns("|".join(titles))
    if spelling in ("{0}", "{0} ()", "{0} []"):
        option = ["--time-unit", "--displacement-unit", "--force-unit"][missing]
        assert isinstance(refused.value, UnknownUnit)
        assert refused.value.option == option
        assert option in str(refused.value)
        answered = Hints().answered(option, ["ms", "um", "kN"][missing])
        given = {name: value for name, value in vars(answered).items() if value is not None}
        assert columns("|".join(titles), **given)[missing].factor in (1e-3, 1e3)


def test_a_unit_that_is_given_is_used_and_must_not_contradict():
    assert columns("time_s|u_mm|force", force_unit="kN")[2].factor == 1000
    assert columns("time_s|u_mm|force_N", force_unit="N")[2].factor == 1
    with pytest.raises(BadInput, match="says kN; expected one and the same unit"):
        columns("time_s|u_mm|force_N", force_unit="kN")
    with pytest.raises(BadInput, match="says 'stone'"):
        columns("time_s|u_mm|force", force_unit="stone")
    with pytest.raises(BadInput, match="a stress, but --force-unit says 'N'"):
        columns("time_s|u_mm|stress (kPa)", force_unit="N")


def test_a_strain_without_a_unit_may_be_percent():
    with pytest.raises(UnknownUnit, match="--displacement-unit, one of %"):
        columns("time_s|strain|force_N")
    assert columns("time_s|strain|force_N", displacement_unit="%")[1].factor == 0.01


def test_l_is_a_length_if_its_unit_is_given_as_one():
    assert columns("time_s|L|force_N", displacement_unit="mm")[1].quantity is LENGTH
    assert columns("time_s|L|force_N", displacement_unit="%")[1].quantity is STRETCH


def test_a_given_unit_of_stress_makes_a_load_a_stress():
    assert columns("time_s|u_mm|F", force_unit="kPa")[2].quantity is STRESS
    assert columns("time_s|u_mm|Load (N)|Stress", force_unit="MPa")[2].title == "Stress"
    with pytest.raises(NoColumn, match="no column of stress among"):
        columns("time_s|u_mm|Load (N)", force_unit="kPa")


@pytest.mark.parametrize("title", ["force (mn)", "force (MN)", "stress (mPa)"])
def test_a_unit_that_may_be_milli_or_mega_is_asked(title):
    with pytest.raises(UnknownUnit, match=r"may stand for milli or for mega; expected --force-unit, one of (mN|MPa)$"):
        columns(f"time_s|u_mm|{title}")
    if "n" in title.split("(")[1].lower():
        assert columns(f"time_s|u_mm|{title}", force_unit="mN")[2].factor == 1e-3


def test_displacement_goes_before_strain_and_force_before_stress():
    found = columns("Stress (MPa)|Strain (%)|Time (s)|Load (N)|Extension (mm)")
    assert [column.place for column in found] == [2, 4, 3]
    assert [column.how for column in found] == ["sure", "likely", "sure"], "the strain may be an extensometer's"


@pytest.mark.parametrize(
    ("title", "how"),
    [("Standardweg (mm)", "sure"), ("Axial Displacement (mm)", "sure"), ("横梁位移(mm)", "sure"),
     ("Maschine (mm)", "likely"), ("u (mm)", "likely"), ("Deformation (mm)", "likely")],
)  # fmt: skip
def test_a_title_that_means_one_thing_is_sure(title, how):
    assert columns(f"Running Time (s)|{title}|Size_mm|Axial Force (kN)")[1].how == how
    assert columns(f"Running Time (s)|{title}|Axial Force (kN)")[1].how == how


def test_of_one_quantity_a_column_with_a_unit_goes_first():
    assert columns("Time (s)|Displacement|Extension (mm)|Load (N)")[1].title == "Extension (mm)"
    assert columns("Time (s)|Displacement|Extension (mm)|Load (N)", displacement_unit="mm")[1].title == "Displacement"


def test_two_columns_alike_are_asked_or_the_first_counts():
    titles = "time_s|Force (N)|displacement_mm|Force (N)"
    with pytest.raises(BadInput, match=r"may both be the force; expected --force-column, one of '2', '4'"):
        columns(titles)
    assert columns(titles, force_column="4")[2].place == 3
    load = columns(titles, first=True)[2]
    assert (load.place, load.alike) == (1, ("Force (N)",))


def test_columns_by_number_title_or_name():
    units = {"time_unit": "s", "displacement_unit": "mm", "force_unit": "N"}
    places = {"time_column": "3", "displacement_column": "1", "force_column": "2"}
    found = columns("", numbers=3, **units, **places)
    assert [(column.place, column.quantity.name) for column in found] == [
        (2, "time"),
        (0, "displacement"),
        (1, "force"),
    ]
    assert {column.how for column in found} == {"as you said"}
    found = columns(
        "Clock (s)|Travel [mm]|Cell (N)", time_column="clock", displacement_column="Travel [mm]", force_column="3"
    )
    assert [column.title for column in found] == ["Clock (s)", "Travel [mm]", "Cell (N)"]


@pytest.mark.parametrize(
    ("titles", "hints", "words"),
    [
        ("a|b|c", {}, "row 1: no column of time, nor of displacement, length or strain, nor of force or stress"),
        ("time_s|b|force_N", {}, "no column of displacement, length or strain"),
        ("time_s|u_mm|c", {}, "no column of force or stress"),
        ("time_s|u_mm|force_N", {"time_column": "4"}, "--time-column: '4' is no column; expected a number from 1 to 3"),
        ("time_s|u_mm|F_N|F_N", {"force_column": "F_N"}, "'F_N' names 2 columns"),
        ("time_s|u_mm|force_N", {"force_column": "u_mm"}, "no unit of the force or stress"),
        ("time_s|u_mm|c (N)", {"force_column": "3", "time_column": "3"}, "no unit of the time"),
        (
            "time (s)|u (mm)|force (g)",
            {},
            "unit 'g' of the force is not known (gf, if it is a weight); expected --force-u",
        ),
        ("time (h:m)|u (mm)|force (N)", {}, "unit 'h:m' of the time is not known; expected --time-unit, one of s"),
    ],
)
def test_columns_that_cannot_be_told_are_refused(titles, hints, words):
    with pytest.raises(BadInput) as refused:
        columns(titles, numbers=3 if not titles else None, **hints)
    assert words in str(refused.value)


def test_one_column_is_not_taken_for_two_things():
    with pytest.raises(BadInput, match="one column is taken for two things"):
        columns("time_s|u|F", displacement_column="2", force_column="2", displacement_unit="mm", force_unit="N")


def test_titles_that_do_not_fit_the_numbers_are_refused():
    with pytest.raises(BadInput, match="3 names above 6 columns of numbers; expected as many; commas"):
        columns("time_s|u_mm|F_N", numbers=6)
    with pytest.raises(BadInput, match="4 names above 3 columns"):
        columns("time_s|u| mm|F_N".replace(" ", ""), numbers=3, displacement_unit="mm")
    assert len(columns("time_s|u_mm|F_N|", numbers=4)) == 3, "a column without a title"
    assert len(columns("time_s|u_mm|F_N|comment", numbers=3)) == 3, "a column without numbers"


def test_of_many_columns_the_first_twelve_are_listed():
    with pytest.raises(NoColumn, match="'a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11'; expected"):
        columns("|".join(f"a{i}" for i in range(14)), numbers=6 + 8)
    with pytest.raises(NoColumn, match=r"or one of 'a0', .*, 'a11'; repeat"):
        columns("|".join(f"a{i}" for i in range(14)), numbers=14, time_column="x")


@pytest.mark.parametrize(
    ("titles", "hints", "quantity", "unit"),
    [
        ("Clock|Stretch|F_N", {"time_column": "1", "time_unit": "ms"}, "time", "ms"),
        ("t_s|Travel (mm)|F_N", {"displacement_column": "2"}, "displacement", "mm"),
        ("t_s|Travel|F_N", {"displacement_column": "2", "displacement_unit": "cm"}, "displacement", "cm"),
        ("t_s|L|F_N", {"displacement_column": "L"}, "stretch", "1"),
        ("t_s|L|F_N", {"displacement_column": "L", "displacement_unit": "mm"}, "length", "mm"),
        ("t_s|L (mm)|F_N", {"displacement_column": "l"}, "length", "mm"),
        ("t_s|Position (mm)|F_N", {"displacement_column": "Position"}, "position", "mm"),
        ("t_s|u_mm|Cell (kPa)", {"force_column": "cell"}, "stress", "kPa"),
        ("t_s|u_mm|Cell", {"force_column": "3", "force_unit": "kN"}, "force", "kN"),
        ("t_s|u_mm|F", {"force_column": "3", "force_unit": "MPa"}, "stress", "MPa"),
    ],
)
def test_a_column_that_is_named_is_what_its_title_or_its_unit_says(titles, hints, quantity, unit):
    (place,) = [i for i, name in enumerate(("time_column", "displacement_column", "force_column")) if name in hints]
    found = columns(titles, **hints)[place]
    assert (found.quantity.name, found.unit, found.how) == (quantity, unit, "as you said")


@pytest.mark.parametrize(
    ("first", "quantity"), [("1.0", "stretch"), ("0.9", "stretch"), ("0", "strain"), ("-0.02", "strain")]
)
def test_bare_numbers_are_a_stretch_or_a_strain_by_where_they_begin(first, quantity):
    table = table_of("t_s|str|F_N", f"0|{first}|1", f"1|{first}1|2", f"2|{first}2|3")
    hints = Hints(displacement_column="str", displacement_unit="1")
    assert recognise(table, hints)[1].quantity.name == quantity
    with pytest.raises(BadInput, match="no unit of the displacement"):
        recognise(table_of("t_s|str|F_N", "0|12|1", "1|13|2", "2|14|3"), hints)


def test_a_title_goes_before_a_number_and_a_whole_title_before_a_name():
    found = columns("2 (s)|u_mm|F_N|2", time_column="2", force_column="F_N", time_unit="s")
    assert found[0].place == 3
    found = columns("t_s|u_mm|Force (N)|Force", force_column=" Force ", force_unit="N")
    assert found[2].place == 3, "it is called exactly so"
    assert columns("t_s|u_mm|F_N|x|y|z|a|b|c|Load (N)", force_column="10")[2].title == "Load (N)"
    with pytest.raises(NoColumn):
        columns("t_s|u_mm|F_N", force_column="0")
    with pytest.raises(NoColumn):
        columns("t_s|u_mm|F_N", force_column="00003")


def test_a_column_without_a_title_is_called_by_its_number():
    with pytest.raises(BadInput) as refused:
        columns("|u_mm|F_N", units="ms||", time_column="1", time_unit="s")
    assert (
        str(refused.value) == "test.csv: 'column 1': unit 'ms', but --time-unit says s; expected one and the same unit"
    )


def table_of(titles: str, *rows: str) -> Table:
    cells = [(at, tuple(row.split("|"))) for at, row in enumerate(rows, start=2)]
    return Table("test.csv", (), tuple(titles.split("|")), (), cells, "|", ".", 1)


def test_of_columns_alike_none_is_taken_unless_that_is_asked_for():
    with pytest.raises(BadInput, match="may both be the force"):
        recognise(table_of("t_s|u_mm|F_N|F_N", *["0|1|2|3"] * 3), Hints())


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
    with pytest.raises(BadInput, match="may both be the"):
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
