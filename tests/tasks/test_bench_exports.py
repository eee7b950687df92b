"""Tables of length ratio and stress become curves of a bar; several files can be protocols of one specimen."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tasks import cli
from tasks.bench_exports import Reading, read_export, read_exports
from tasks.measurements import read_cohort
from tasks.model import Specimen
from tasks.model.phases import phases
from tasks.noise import noise_of_all
from tests.conftest import SHARED

NORMALISED = "Time,L,F,SD\n2,0.95,0.5,0.1\n2.5,1.045,4,0.2\n3,1.14,10,0.3\n4,1.14,8,0.3\n"
KPA = Reading(stress="kPa", time="s", reference=0.95)


def exported(folder: Path, content: str, name: str = "ramp.csv") -> Path:
    path = folder / name
    path.write_text(content, "utf-8")
    return path


def numbers(specimen: Specimen) -> list[list[float]]:
    """Time, displacement and force of the only curve, rounded."""
    (curve,) = specimen.curves
    columns = (curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N)
    return [np.round(column, 9).tolist() for column in columns]


def test_stretch_and_stress_become_displacement_and_force(tmp_path):
    specimen = read_export(exported(tmp_path, NORMALISED), reading=KPA)
    assert (specimen.name, specimen.length_mm, specimen.area_mm2) == ("ramp", 1.0, 1.0)
    assert numbers(specimen) == [[0.0, 0.5, 1.0, 2.0], [0.0, 0.1, 0.2, 0.2], [0.0005, 0.004, 0.01, 0.008]]


def test_a_bar_of_any_size_has_the_same_stretch_and_stress(tmp_path):
    path = exported(tmp_path, NORMALISED)
    bar = read_export(path, reading=Reading("kPa", "s", 0.95, length_mm=5.0, area_mm2=4.0))
    assert (bar.length_mm, bar.width_mm, bar.thickness_mm) == (5.0, 2.0, 2.0)
    unit = read_export(path, reading=KPA)
    assert np.allclose(bar.stretch(bar.curves[0].protocol), unit.stretch(unit.curves[0].protocol))
    assert np.allclose(bar.curves[0].force_N / bar.area_mm2, unit.curves[0].force_N / unit.area_mm2)


@pytest.mark.parametrize(
    ("titles", "reading"),
    [
        ("Time (s),Stretch,Stress (kPa)", Reading("kPa")),
        ("Time (s),Stretch ratio (-),Tension [kPa]", Reading("kPa")),
        ("time,L/L0,F\n(s),(1),(kPa)", Reading("kPa")),
        ("Time,L (L/L0),Nominal stress", Reading("kPa", "s")),
    ],
)
def test_names_and_units_of_columns(tmp_path, titles, reading):
    specimen = read_export(exported(tmp_path, f"{titles}\n0,1,0\n1,1.1,4\n2,1.2,9\n"), reading=reading)
    assert numbers(specimen) == [[0.0, 1.0, 2.0], [0.0, 0.1, 0.2], [0.0, 0.004, 0.009]]


@pytest.mark.parametrize(("unit", "newton"), [("Pa", 9e-6), ("kPa", 9e-3), ("MPa", 9.0)])
def test_units_of_stress(tmp_path, unit, newton):
    path = exported(tmp_path, "Time (s),L,F\n0,1,0\n1,1.1,4\n2,1.2,9\n")
    assert read_export(path, reading=Reading(unit)).curves[0].force_N[-1] == pytest.approx(newton)


def test_a_ratio_with_a_force_and_the_gauge_of_its_header(tmp_path):
    block = "Length,20,mm\nWidth,2,mm\nThickness,3,mm\n"
    path = exported(tmp_path, f"{block}Time (s),Stretch (%),Load (N)\n0,100,0\n1,105,4\n2,110,9\n")
    specimen = read_export(path)
    assert (specimen.length_mm, specimen.width_mm, specimen.thickness_mm) == (20.0, 2.0, 3.0)
    assert numbers(specimen) == [[0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0, 4.0, 9.0]]


def test_a_displacement_goes_before_a_ratio_and_a_force_before_a_stress(tmp_path):
    block = "Length,20,mm\nDiameter,2,mm\n"
    titles = "Time (s),Stretch,Tensile stress (MPa),Extension (mm),Load (N)"
    path = exported(tmp_path, f"{block}{titles}\n0,1,7,0,0\n1,1,7,1,4\n2,1,7,2,9\n")
    assert numbers(read_export(path)) == [[0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0, 4.0, 9.0]]
    assert read_export(path, reading=Reading("MPa")).curves[0].force_N[0] == pytest.approx(7 * np.pi)


def test_tare_subtracts_the_first_force_only_where_asked(tmp_path):
    path = exported(tmp_path, NORMALISED)
    kept, tared = (read_export(path, reading=Reading("kPa", "s", 0.95, tare=tare)) for tare in (False, True))
    assert kept.curves[0].force_N[0] == pytest.approx(0.0005)
    assert tared.curves[0].force_N.tolist() == pytest.approx([0.0, 0.0035, 0.0095, 0.0075])


def test_files_of_one_specimen_are_its_protocols(tmp_path, monkeypatch, capsys):
    fast = exported(tmp_path, NORMALISED, "fast 0.1s.csv")
    slow = exported(tmp_path, NORMALISED.replace("\n4,", "\n400,"), "slow.csv")
    options = ("--specimen", "muscle", "--stress", "kPa", "--time", "s", "--reference", "0.95")
    monkeypatch.setattr(sys, "argv", ["sinew", "import", str(fast), str(slow), *options, "--out", str(tmp_path / "c")])
    cli.main()
    (specimen,) = read_cohort(tmp_path / "c").specimens
    assert specimen.name == "muscle"
    assert [curve.name for curve in specimen.curves] == ["fast_0.1s", "slow"]
    assert specimen.curves[1].protocol.time_s.tolist() == [0.0, 0.5, 1.0, 398.0]
    said = capsys.readouterr().out
    assert "muscle: slow, 4 points, 1 x 1 x 1 mm, stretch 1 to 1.2, peak 0.01 N" in said
    assert "muscle/slow: SD left out" in said


def test_columns_of_spread_are_told_and_no_others(tmp_path):
    path = exported(tmp_path, NORMALISED.replace("SD", "SEM (kPa)"))
    assert read_exports([path], reading=KPA).spreads == {"ramp/test": ("SEM (kPa)",)}
    path.write_text(NORMALISED.replace("SD", "Temperature"))
    assert read_exports([path], reading=KPA).spreads == {}


@pytest.mark.shared
def test_means_of_relaxed_muscle(tmp_path):
    paths = sorted((SHARED / "real" / "titin-passive").glob("*.csv"))
    (specimen,) = read_exports(paths, specimen="titin", reading=KPA).specimens
    assert [curve.force_N.size for curve in specimen.curves] == [119, 99, 99, 99]
    for curve, ramp_s in zip(specimen.curves, (0.1, 100.0, 10.0, 1.0), strict=True):
        assert curve.protocol.time_s[0] == 0.0
        assert specimen.stretch(curve.protocol)[[0, -1]] == pytest.approx([1.0, 1.2373], abs=1e-3)
        load, hold = phases(curve.protocol)
        assert (load.kind, hold.kind) == ("load", "hold")
        assert curve.protocol.time_s[hold.start] == pytest.approx(ramp_s)
        assert 0.005 < curve.force_N.max() < 0.02  # N on 1 mm2: 5 to 20 kPa
    noise = noise_of_all(specimen.curves, proportional=False)
    assert 1e-5 < noise.sd_N < 5e-4
