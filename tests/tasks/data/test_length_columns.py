"""What strains and stresses in a table say beside its displacements and forces."""

import pytest

from sinew.tasks.data.hints import Hints
from sinew.tasks.data.init import init
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.specimen_sizes import Sizes

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
        "look at a, test: 'Tensile strain (%)' comes to 5.8 %, the displacement to 29 % of the length; which is the "
        "strain of the specimen?",
    ]
    right = init([written(tmp_path)], tmp_path / "right", sizes=Sizes(50.0, 14.5, 2.0), hints=CHOSEN)
    assert not [line for line in right.lines if line.startswith("look at a,")]


CHOSEN = Hints(displacement_column="Displacement (mm)")
