"""Tables of results, a row for each of many tests, which are no curves."""

import numpy as np
import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import Reading, inspect
from sinew.tasks.data.recordings import read_recordings


def table(path, titles, columns):
    lines = (",".join(map(str, row)) for row in zip(*columns, strict=True))
    path.write_text("\n".join([titles, *lines]) + "\n")
    return path


def results(count):
    drawn = np.random.default_rng(3).random((2, count)).round(3)
    return [range(count), *drawn.tolist()]


def test_numbers_in_any_order_are_refused(tmp_path):
    path = table(tmp_path / "a.csv", "No,Strain (%),Stress (MPa)", results(12))
    with pytest.raises(BadInput, match="no times, and the strain goes up and down from row to row: results of many"):
        inspect(path)
    assert inspect(path, Reading(hints=Hints(rate_hz=1.0))).rows == 12  # somebody says that they follow each other
    assert inspect(table(tmp_path / "b.csv", "No,Strain (%),Stress (MPa)", results(11))).rows == 11  # too few to tell


def test_a_curve_is_none_of_them(tmp_path):
    numbers, motion, load = results(40)
    cycles = np.abs(np.arange(40) % 20 - 10).tolist()
    for columns in ([numbers, sorted(motion), load], [numbers, cycles, cycles], [numbers, motion, sorted(load)]):
        assert inspect(table(tmp_path / "a.csv", "No,Strain (%),Stress (MPa)", columns)).rows == 40


def test_rows_with_names_of_their_own_are_refused(tmp_path):
    up = [0.1 * i for i in range(8)]
    names = [f"S{i}" for i in range(8)]
    titles = "Specimen,Elongation (%),Yield"
    with pytest.raises(BadInput, match="each row has another name in 'Specimen': results of many tests, and no curve"):
        inspect(table(tmp_path / "a.csv", titles, [names, up, up]))
    for named in (["S1"] * 8, [*names[:7], "S0"], [*names[:7], ""], [f"{i}" for i in range(8)]):
        assert inspect(table(tmp_path / "a.csv", titles, [named, up, up])).rows == 8


def test_titles_of_results_without_a_time_or_a_force_are_refused(tmp_path):
    up = [0.1 * i for i in range(8)]
    with pytest.raises(BadInput, match="no titles of time and force, but 'Yield' and 'UTS': results, and no curve"):
        inspect(table(tmp_path / "a.csv", "Elongation,Yield,UTS", [up, up, up]))
    assert inspect(table(tmp_path / "a.csv", "Elongation,Yield,Load", [up, up, up])).rows == 8
    assert inspect(table(tmp_path / "a.csv", "Elongation,Yield,UTS,Load", [up, up, up, up])).rows == 8
    named = Reading(hints=Hints(force_column="UTS", force_unit="N"))
    assert inspect(table(tmp_path / "a.csv", "Elongation,Yield,UTS", [up, up, up]), named).rows == 8


@pytest.mark.parametrize(
    "titles",
    ["Time (s),Strain (%),F (N),Storage modulus (Pa)", "t_s,Strain (%),F (N),tan(δ)", "t in s,h in mm,Fn in N,G' in Pa",
     "t_s,u_mm,F_N,E''"],
)  # fmt: skip
def test_moduli_of_oscillations_are_refused_with_or_without_a_person(tmp_path, titles):
    up = [0.1 * i for i in range(8)]
    path = table(tmp_path / "a.csv", titles, [up] * 4)
    columns = Hints(time_column="1", displacement_column="2", force_column="3")
    for look in (inspect, lambda path: read_recordings(path, Hints()), lambda path: read_recordings(path, columns)):
        with pytest.raises(BadInput, match="amplitudes of oscillations, and no curve"):
            look(path)


def test_a_curve_behind_moduli_of_oscillations_is_read(tmp_path):
    up = [0.1 * i for i in range(8)]
    path = table(tmp_path / "a.csv", "Time (s),Strain (%),Force (N),G'", [up] * 4)
    path.write_text(path.read_text() + "\n\nTime (s),Extension (mm),Load (N)\n" + "1,2,3\n2,3,4\n3,4,5\n4,5,6\n")
    (found,) = read_recordings(path, Hints())
    assert found.columns[1].title == "Extension (mm)"


def test_a_test_in_shear_is_refused_with_or_without_a_person(tmp_path):
    up = [0.1 * i for i in range(8)]
    path = table(tmp_path / "a.csv", "Time [s],Shear Strain [%],Shear Stress [Pa]", [up] * 3)
    columns = Hints(displacement_column="Shear Strain", force_column="Shear Stress")
    for look in (inspect, lambda path: read_recordings(path, Hints()), lambda path: read_recordings(path, columns)):
        with pytest.raises(BadInput, match="test in shear; expected a test in tension or compression"):
            look(path)
    titles = "Time (s),Strain (%),Stress (MPa),Shear Strain [%],Shear Stress [Pa]"
    assert inspect(table(tmp_path / "b.csv", titles, [up] * 5)).rows == 8
