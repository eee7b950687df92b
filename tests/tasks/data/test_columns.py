"""Which column holds what, in which unit: recognised by titles, read or given, never assumed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.columns import LIKELY, SURE, Column, recognise
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.quantities import DISPLACEMENT, FORCE, LENGTH, POSITION, STRAIN, STRESS, STRETCH
from sinew.tasks.data.questions import NoColumn, Unclear, UnknownUnit
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
    with pytest.raises(NoColumn, match=r"'a0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, \.\.\.'; expected"):
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


@pytest.mark.parametrize(
    "titles",
    [
        "Tijd (s)|Verplaatsing (mm)|Kracht (N)", "Čas [s]|Posunutí [mm]|Síla [N]", "Vreme (s)|Izduženje (mm)|Sila (kN)",
        "Tid (s)|Förlängning (mm)|Kraft (N)", "Aika (s)|Siirtymä (mm)|Voima (N)", "Idő (s)|Elmozdulás (mm)|Erő (N)",
        "Timp (s)|Deplasare (mm)|Forță (N)", "Waktu (s)|Perpindahan (mm)|Gaya (N)", "Час (с)|Переміщення (мм)|Сила (Н)",
        "Χρόνος (s)|Μετατόπιση (mm)|Δύναμη (N)", "Tid (s)|Forlængelse (mm)|Kraft (N)",
    ],
)  # fmt: skip
def test_titles_in_further_languages(titles):
    assert [one.quantity.name for one in columns(titles)] == ["time", "displacement", "force"]


@pytest.mark.parametrize("unit", ["deg", "Degrees", "°", "rad"])
def test_an_angle_is_no_displacement(unit):
    told = f"unit '{unit}' is that of an angle, which is no displacement; expected a column in one of mm, "
    with pytest.raises(BadInput, match=told):
        columns(f"Time (s)|Angle ({unit})|Force (N)", displacement_column="2")
    with pytest.raises(BadInput, match=told):
        columns("Time (s)|IMU|Force (N)", displacement_column="IMU", displacement_unit=unit)
    with pytest.raises(BadInput, match=told):
        columns(f"Time (s)|Displacement ({unit})|Force (N)", displacement_unit="mm")


def test_of_forces_along_axes_none_is_taken_unasked():
    """In a shear test, the force along the height is not that of the test."""
    for titles in ("Time (s)|Strain [-]|Fx (N)|Fz (N)", "Time (s)|Strain [-]|Fz (N)|Fy (N)"):
        with pytest.raises(Unclear, match=r"'Fz \(N\)' may both be the force|'F[xy] \(N\)' may both be the force"):
            columns(titles)
    assert columns("Time (s)|Strain [-]|Fz (N)")[2].title == "Fz (N)"


def test_frequencies_and_compliances_are_no_columns_of_a_test():
    assert columns("t [s]|x|u [mm]|f [Hz]|F [N]|D [1/MPa]")[1:] == columns("t [s]|x|u [mm]|y|F [N]|z")[1:]
