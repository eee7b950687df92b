"""Titles of columns, taken apart into a name and a unit."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.remarks import remarks
from sinew.tasks.data.titles import is_spread, name_and_unit, stations, without_numbers, without_station, without_suffix
from tests.effort import at_most
from tests.tasks.data.one_test_file import read


@pytest.mark.parametrize(
    ("title", "name", "unit"),
    [
        ("Force (N)", "force", "N"),
        ("FY(U=23) in kN", "fy(u=23)", "kN"),
        ("Kraft [kN]", "kraft", "kN"),
        ("Zeit / s", "zeit", "s"),
        ("force_N", "force", "N"),
        ("变形（ｍｍ）", "变形", "mm"),
        ("𝜆", "λ", ""),
        ("Tensile strain (Extension) (%)", "tensile strain", "%"),
        ("C_1_Force[kN]", "force", "kN"),
        ("Running Time", "running time", ""),
        ("Time_s_", "time", "s"),
        ("Force..kN.", "force", "kN"),
        ("Disp Min", "disp min", ""),
        ("Time min", "time", "min"),
        ("time_1_min", "time 1", "min"),
        ("Load_1_Min", "load 1 min", ""),
        ("Position (z), mm", "position", "mm"),
        ("Fz, gf", "fz", "gf"),
        ("Force (x 1000), N", "force x 1000 , n", "x 1000"),
        ("Position (target), mm", "position target , mm", "target"),
        ("[um] Displacement", "displacement", "um"),
        ("[s] Time Elapsed", "time elapsed", "s"),
        ("Перемещение [мм]", "перемещение", "мм"),
    ],
)
def test_a_title_has_a_name_and_a_unit(title, name, unit):
    assert name_and_unit(title) == (name, unit)


def test_the_unit_below_counts_where_the_title_has_none():
    assert name_and_unit("Force", "kN") == ("force", "kN")
    assert name_and_unit("Force (N)", "V") == ("force", "N"), "no unit that is known"


@pytest.mark.parametrize(
    ("title", "spread"), [("SD (N)", True), ("F_std(N)", True), ("F_avg(N)", False), ("std", True)]
)
def test_titles_of_spreads_are_told(title, spread):
    assert is_spread(title) == spread


@pytest.mark.parametrize(
    ("title", "below", "unit"),
    [
        ("Force (N)", "kN", "N or kN"),
        ("Force_N", "kN", "N or kN"),
        ("Kraft / N", "kN", "N or kN"),
        ("Force (kN) (N)", "", "kN or N"),
        ("N", "kN", "N or kN"),
        ("Time (s)", "Sec", "s"),
        ("Strain (mm/mm)", "%", "mm/mm or %"),
        ("Strain 1 (1) (%)", "", "%"),
    ],
)
def test_units_that_contradict_each_other_are_told_both(title, below, unit):
    assert name_and_unit(title, below)[1] == unit


def test_numbers_that_tell_tests_apart_are_no_part_of_names():
    names = ["time 1", "force 1", "time2", "force2"]
    assert without_numbers(names) == ["time", "force", "time", "force"]
    assert without_numbers(["time", "force", "time 2", "force 2"]) == ["time", "force", "time", "force"]
    assert without_numbers(["time", "load", "load 2"]) == ["time", "load", "load 2"], "two load cells"
    assert without_numbers(["time", "load 1", "load 2"]) == ["time", "load 1", "load 2"], "two load cells"
    titles = ["Force (N)", "Force (N).1", "t.2"]
    assert [without_suffix(title, titles) for title in titles] == ["Force (N)", "Force (N)", "t.2"]


def test_a_title_that_is_a_unit_is_told_from_a_letter():
    assert [name_and_unit(title) for title in ("N", "mm", "s")] == [("(N)", "N"), ("(mm)", "mm"), ("(s)", "s")]
    assert name_and_unit("n") == ("n", ""), "a number of samples, perhaps"
    assert name_and_unit("d") == ("d", "")


def test_columns_with_the_spread_of_a_mean():
    titles = ("SD", "SEM (kPa)", "std", "Standard deviation", "SD (kPa,\nof five)")
    assert [is_spread(title) for title in titles] == [True] * 5
    assert not is_spread("SDF")
    assert not is_spread("Temperature")


def test_titles_take_time_with_their_length_alone():
    with at_most(10):  # it took 40 s
        for title in (f"a{' ' * 297}b", f"a{'/a' * 140} b", f"a{' in' * 90} b c", f"a{',' * 290} b"):
            for number in range(2_000):
                name_and_unit(f"{number}{title}"[:300])


def test_a_page_of_text_is_no_name():
    name, unit = name_and_unit("Force (N)" * 20_000, "kN")
    assert (len(name), unit) == (300, "kN")


@pytest.mark.parametrize(
    "title",
    [
        "Force (N) x 1000", "Force (N) (x1000)", "Force (x1000) (N)", "Force [N]*1e3", "Force (N) / width",
        "Force (N)/width", "Force (N) change", "Force (N) per side", "Force (N)^2", "Force (N) limit",
        "Force (N) setpoint", "Force (N) [10 x]",
    ],
)  # fmt: skip
def test_what_stands_behind_a_unit_may_make_another_quantity_of_it(title):
    name, unit = name_and_unit(title)
    assert name.startswith("force ") and name != "force"
    assert unit in ("N", "x1000")


@pytest.mark.parametrize(
    "title", ["Force (N)", "Force (N) A", "Force [N] (Channel 1)", "Force (N) 2", "Force (kN) Ch:1"]
)
def test_labels_of_tests_and_channels_behind_a_unit_are_none_of_the_name(title):
    assert name_and_unit(title)[0] == "force"


@pytest.mark.parametrize("title", ["-Force (N)", "- Force (N)", "\u2212Force (N)"])
def test_a_title_with_a_minus_is_none_of_a_force(tmp_path, title):
    with pytest.raises(BadInput, match="no column of force or stress"):
        read(tmp_path, titles=f"Time (s),Extension (mm),{title}")


def test_a_true_stress_is_no_engineering_stress(tmp_path):
    with pytest.raises(BadInput, match="no column of force or stress"):
        read(tmp_path, titles="Time (s),Extension (mm),Stress (MPa) true")


@pytest.mark.parametrize(
    ("title", "name"),
    [
        ("Ch Force", "force"),
        ("Ch 1 Force", "force"),
        ("Station 1 Displacement", "displacement"),
        ("Ch Disp.", "disp"),
        ("Stretch ratio (-)", "stretch ratio"),
    ],
)
def test_words_for_channels_in_front_are_none_of_the_name(title, name):
    assert name_and_unit(title)[0] == name


MOTIONS, LOADS = ("displacement", "disp"), ("force", "load")


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["time", "esh b force", "esh b displacement", "analog 1"], ["time", "force", "displacement", "analog 1"]),
        (["esh b force", "ram displacement"], ["esh b force", "ram displacement"]),
        (["peak force", "peak displacement"], ["peak force", "peak displacement"]),
        (["rig max load", "rig max disp"], ["rig max load", "rig max disp"]),
        (["a force", "a disp", "b force", "b disp"], ["force", "disp", "force", "disp"]),
        (["time", "a force", "a disp", "b 1 force", "b 1 disp"], ["time", "force", "disp", "force", "disp"]),
        (["a force", "a disp", "b force", "b disp", "b time"], ["a force", "a disp", "b force", "b disp", "b time"]),
        (["a force", "a disp", "sim force", "sim disp"], ["a force", "a disp", "sim force", "sim disp"]),
        (["esh force", "esh force limit", "esh disp"], ["force", "esh force limit", "disp"]),
    ],
)
def test_words_in_front_of_motion_and_load_alike_name_the_station(names, found):
    before = stations(names, MOTIONS, LOADS)
    assert [without_station(*both) for both in zip(names, before, strict=True)] == found


def test_a_station_in_front_is_read_with_a_remark(tmp_path):
    found = read(tmp_path, titles="Time (s),ESH B Displacement (mm),ESH B Force (N)")
    assert remarks(found) == [
        "displacement from column 2, likely by 'displacement' in its title",
        "force from column 3, likely by 'force' in its title",
    ]
    with pytest.raises(BadInput, match="no column of displacement"):
        read(tmp_path, titles="Time (s),Peak Displacement (mm),Peak Force (N)")


@pytest.mark.parametrize(
    ("titles", "found"),
    [
        ("time_s,Strain_%,P_MPa", ["time", "strain", "stress"]),
        ("time_s,u_mm,P_N", ["time", "displacement", "force"]),
        ("time_s,Strain_Raw_%,force_N", ["time", "strain", "force"]),
        ("測定日時 s,変位 mm,荷重 kN", ["time", "displacement", "force"]),
    ],
)
def test_further_titles(tmp_path, titles, found):
    assert [one.quantity.name for one in read(tmp_path, titles=titles).columns] == found


def test_the_clock_of_japanese_loggers_is_the_time(tmp_path):
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},2019/11/01 17:06:{10 + i},{i / 10},{2 * i}\n" for i in range(8))
    path.write_bytes(f"名前,測定日時,変位 mm,荷重 kN\n{rows}".encode("cp932"))
    found = inspect(path).content()
    assert (found["time"], found["rows"]) == ({"column": "測定日時", "unit": "s"}, 8)


def test_titles_in_russian(tmp_path):
    found = read(tmp_path, titles="Время [с],Перемещение [мм],Усилие [кН]")
    assert [(one.quantity.name, one.factor) for one in found.columns] == [
        ("time", 1.0), ("displacement", 1.0), ("force", 1000.0),
    ]  # fmt: skip


def test_a_strain_may_be_called_unitless(tmp_path):
    found = read(tmp_path, titles="Time (s),Engineering Strain (unitless),Force Data (N)")
    assert (found.motion.quantity.name, found.motion.factor) == ("strain", 1.0)
