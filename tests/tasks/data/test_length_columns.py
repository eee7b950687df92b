"""What strains and stresses in a table say beside its displacements and forces."""

import pytest

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import init
from sinew.tasks.data.length_columns import Repeats
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.specimen_sizes import Sizes
from sinew.tasks.data.told import as_told

TITLES = "Time (s),Displacement (mm),Load (N),Tensile strain (%),Tensile stress (MPa)"


def written(folder, titles=TITLES, stress=1 / 29):
    rows = "".join(f"{i},{i / 10},{5 * i},{i / 5},{5 * i * stress:.6f}\n" for i in range(30))
    path = folder / "a.csv"
    path.write_text(f"{titles}\n{rows}")
    return path


def test_strains_and_stresses_are_kept_as_what_they_say_of_sizes(tmp_path):
    said = read_recordings(written(tmp_path), Hints())[0].repeats
    assert said.strain == ("Tensile strain (%)", pytest.approx(0.058))
    assert said.area_mm2 == ("Tensile stress (MPa)", pytest.approx(29.0, rel=1e-4))


NO_UNITS = TITLES.replace(" (%)", "").replace(" (MPa)", "")


@pytest.mark.parametrize("titles", [NO_UNITS, "Time (s),Displacement (mm),Load (N),a,b"])
def test_columns_without_a_unit_say_nothing(tmp_path, titles):
    said = read_recordings(written(tmp_path, titles), Hints())[0].repeats
    assert (said.strain, said.area_mm2) == (None, None)


def test_sizes_that_a_file_contradicts_are_told(tmp_path):
    made = init([written(tmp_path)], tmp_path / "out", sizes=Sizes(10.0, 10.0, 2.0), hints=CHOSEN)
    looks = [line for line in made.lines if line.startswith("look at a,")]
    assert looks == [
        "look at a, test: force over 'Tensile stress (MPa)' is 29 mm2, but width x thickness is 20 mm2; which is the "
        "cross-section?",
        "look at a, test: 'Tensile strain (%)' changes by 5.8 %, but displacement over length by 29 %; which is the "
        "strain of the specimen?",
    ]
    right = init([written(tmp_path)], tmp_path / "right", sizes=Sizes(50.0, 14.5, 2.0), hints=CHOSEN)
    assert not [line for line in right.lines if line.startswith("look at a,")]


@pytest.mark.parametrize(
    ("length_mm", "width_mm", "told"),
    [(50.0 / 1.15, 14.5, 0), (50.0 / 1.25, 14.5, 1), (50.0 / 0.85, 14.5, 0), (50.0 / 0.75, 14.5, 1),
     (50.0, 14.5 / 1.04, 0), (50.0, 14.5 / 1.06, 1), (50.0, 14.5 / 0.96, 0), (50.0, 14.5 / 0.94, 1)],
)  # fmt: skip
def test_small_differences_are_not_told(tmp_path, length_mm, width_mm, told):
    made = init([written(tmp_path)], tmp_path / "out", sizes=Sizes(length_mm, width_mm, 2.0), hints=CHOSEN)
    assert len([line for line in made.lines if line.startswith("look at a,")]) == told


CHOSEN = Hints(displacement_column="Displacement (mm)")


def test_what_a_table_says_of_all_rows_is_not_of_some_of_them(tmp_path):
    """Of rows after a preload, and of tables whose times go on."""
    path = tmp_path / "a.csv"
    rows = [f"{i},{(i if i < 30 else i - 30) / 10},{5 * i},{i / 5},{i}\n" for i in range(60)]
    path.write_text(f"{TITLES}\n{''.join(rows[:30])}{''.join(row for row in rows[30:])}")
    (whole,) = read_recordings(path, Hints())
    assert whole.repeats.strain is not None
    assert as_told(whole, Hints(preload="leave-out")).repeats == Repeats()
    path.write_text(f"{TITLES}\n{''.join(rows[:30])}\n{TITLES}\n{''.join(rows[30:])}")
    (joined,) = read_recordings(path, Hints())
    assert len(joined.rows) == 60
    assert joined.repeats == Repeats()


def test_columns_of_tests_beside_each_other_are_not_left_out(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Disp (mm),Load (N),Camera,Time (s),Disp (mm),Load (N)\n"
                    + "".join(f"{i},{i / 10},{5 * i},1,{i},{i / 5},{6 * i}\n" for i in range(9)))  # fmt: skip
    assert [one.left_out for one in read_recordings(path, Hints())] == [("Camera",), ("Camera",)]


@pytest.mark.parametrize(
    ("strain", "length"),
    [
        ("Tensile strain (%)", None),
        ("Tensile strain (Strain 1) (%)", 25.0),
        ("Tensile strain (Extensometer) (%)", 25.0),
    ],
)
def test_strains_of_an_extensometer_contradict_no_length(tmp_path, strain, length):
    path = written(tmp_path, f"Length : 25 mm\n{TITLES.replace('Tensile strain (%)', strain)}")
    (found,) = read_recordings(path, Hints())
    assert ("length" in found.sizes) == (length is not None)
    assert found.sizes["length"].mm == length if length else found.notes[0].startswith("the gauge length is not taken")


def test_the_size_along_the_axis_of_a_displacement_is_its_length(tmp_path):
    path = tmp_path / "biaxial.csv"
    titles = "Time_S,XSize_um,YSize_um,XDisplacement_um,YDisplacement_um,XForce_mN,YForce_mN"
    rows = "".join(f"{i},{7500 + 10 * i},{6000 + 20 * i},{10 * i},{20 * i},{i},{2 * i}\n" for i in range(9))
    path.write_text(f"{titles}\n{rows}")
    for axis, length in (("X", 7.5), ("Y", 6.0)):
        chosen = Hints(displacement_column=f"{axis}Displacement_um", force_column=f"{axis}Force_mN")
        assert read_recordings(path, chosen)[0].sizes["length"].mm == pytest.approx(length)
    path.write_text(f"{titles.replace('YSize', 'Size')}\n{rows}")
    chosen = Hints(displacement_column="YDisplacement_um", force_column="YForce_mN")
    assert read_recordings(path, chosen)[0].sizes["length"].mm == pytest.approx(6.0)
