"""Files of tests become specimens; normalised tables become bars of unit size; files can be protocols of one."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.exports import Reading, read_export, read_exports
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.inspection import inspect
from sinew.tasks.data.noise import noise_of_all
from sinew.tasks.model import Specimen
from sinew.tasks.model.phases import phases
from tests.conftest import SHARED
from tests.tasks.cli.bad_input import EXPORT
from tests.tasks.inputs import mutated, read_or_refuse

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
    assert tared.curves[0].name == "test"
    assert tared.curves[0].force_N.tolist() == pytest.approx([0.0, 0.0035, 0.0095, 0.0075])


def test_files_of_one_specimen_are_its_protocols(tmp_path):
    fast = exported(tmp_path, NORMALISED, "fast 0.1s.csv")
    slow = exported(tmp_path, NORMALISED.replace("\n4,", "\n400,"), "slow.csv")
    found = read_exports([fast, slow], specimen="muscle", reading=KPA)
    (specimen,) = found.specimens
    assert specimen.name == "muscle"
    assert [curve.name for curve in specimen.curves] == ["fast_0.1s", "slow"]
    assert specimen.curves[1].protocol.time_s.tolist() == [0.0, 0.5, 1.0, 398.0]
    assert found.spreads == {"muscle/fast_0.1s": ("SD",), "muscle/slow": ("SD",)}


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (("a/ramp.csv", "9"), "has protocol ramp, as "),
        (("copy.csv", "8"), "has the numbers of "),
        (("total.csv", "9"), "its name cannot be used for a protocol: 'total'"),
    ],
)
def test_files_that_cannot_be_protocols_of_one_specimen(tmp_path, second, words):
    (tmp_path / "a").mkdir()
    paths = [exported(tmp_path, NORMALISED), exported(tmp_path, NORMALISED.replace("8", second[1]), second[0])]
    with pytest.raises(BadInput) as refused:
        read_exports(paths, specimen="muscle", reading=KPA)
    assert words in str(refused.value)


EXTENSIONS = "Time,Extension,Load\n(s),(mm),(N)\n0,0,0\n1,0.1,5\n2,0.2,9\n"
BLOCK = "Length,20,mm\nDiameter,2,mm\n"


@pytest.mark.parametrize(
    ("content", "reading", "sizes"),
    [
        (BLOCK + EXTENSIONS, Reading(), (20.0, 1.772453851)),
        ("Length,20\nDiameter,2\n" + EXTENSIONS, Reading(), (20.0, 1.772453851)),
        (BLOCK + EXTENSIONS, Reading(length_mm=5.0, area_mm2=4.0), (5.0, 2.0)),
        (BLOCK + NORMALISED, KPA, (20.0, 1.772453851)),
        ("Width,2,mm\n" + NORMALISED, KPA, (1.0, 1.0)),
        ("Width,2,mm\nThickness,2,mm\n" + NORMALISED, KPA, (1.0, 2.0)),
        (NORMALISED.replace("L", "L (mm)"), KPA, (0.95, 1.0)),
        (NORMALISED.replace("L", "Strain (%)"), KPA, (1.0, 1.0)),
    ],
)
def test_sizes_of_the_bar(tmp_path, content, reading, sizes):
    if "Strain" in content or "(mm)" in content:
        reading = Reading(stress="kPa", time="s") if reading is KPA else reading
    specimen = read_export(exported(tmp_path, content), reading=reading)
    assert (specimen.length_mm, specimen.width_mm) == sizes
    assert specimen.thickness_mm == specimen.width_mm


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (EXTENSIONS, "Length: missing in the lines above the table; expected a length with its unit, or --length-mm"),
        ("Length,20,mm\n" + EXTENSIONS, "Width: missing in the lines above the table"),
        (
            BLOCK.replace("20", "ten") + EXTENSIONS,
            "Length: 'ten mm'; expected a number at least 1e-06 and below 10000 mm",
        ),
        (BLOCK.replace("20,mm", "20,fur") + EXTENSIONS, "Length: '20 fur'; expected"),
        (BLOCK.replace("20", "0") + EXTENSIONS, "Length: '0 mm'; expected"),
    ],
)
def test_sizes_that_are_missing_or_impossible(tmp_path, content, words):
    with pytest.raises(BadInput) as refused:
        read_export(exported(tmp_path, content))
    assert words in str(refused.value)


def test_the_protocol_is_named_by_the_file_or_by_you(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS)
    assert read_export(path).curves[0].name == "test"
    named = read_export(path, protocol="pull", name="s1")
    assert (named.name, named.curves[0].name) == ("s1", "pull")
    path.write_text("Test : Start of hold value,0.05,mm/mm\n" + BLOCK + EXTENSIONS)
    assert read_export(path).curves[0].name == "relaxation"


def test_of_two_columns_alike_the_first_counts_and_that_is_remarked_on(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS.replace("Load", "Load,Load").replace("(N)", "(N),(N)"))
    path.write_text("\n".join(f"{line},1" if line[0].isdigit() else line for line in path.read_text().splitlines()))
    found = read_exports([path])
    assert found.specimens[0].curves[0].force_N.tolist() == [0, 5, 9]
    assert found.remarks == {"ramp/test": ("force from column 3; it may be in another: 'Load'",)}


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Reading(time="week"), "--time: 'week'; expected one of s"),
        (lambda: Reading(stress="N"), "--stress: 'N'; expected one of Pa"),
        (lambda: Reading(stress="kPa", hints=Hints(force_unit="N")), "--stress: kPa, but --force-unit says 'N'"),
        (lambda: Reading(reference=0.0), "--reference: 0; expected above 0 and below 10"),
    ],
)
def test_a_reading_that_is_impossible(make, words):
    with pytest.raises(BadInput) as refused:
        make()
    assert words in str(refused.value)


def test_hints_name_columns_and_units(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS.replace("Load", "Cell A").replace("(N)", ""))
    hints = Hints(force_column="cell a", force_unit="kN")
    assert read_export(path, reading=Reading(hints=hints)).curves[0].force_N[-1] == 9000


EXPORT_PIECES = (
    'Time|Extension|Load|Length|Diameter|Width|Hold|,|;|\n|\r|"|(s)|[mm]|(kN)|(N)|mm|in|1|2.5|-3|1e308|nan| : |\0|µm|()'
    "|(\n)|Time,Extension,Load\n(s),(mm),(N)\n|Length,10,mm\n|Diameter,5,mm\n|1,1,1\n|2,2,2\n|3,3,3\n"
)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.binary()
    | mutated(EXPORT)
    | mutated(NORMALISED)
    | st.lists(st.sampled_from(EXPORT_PIECES.split("|")), max_size=30).map("".join)
)
@example("a\rb")
@example("x" * 200_000)
@example(EXPORT.replace("(N)", "(kN)").replace("5.0", "1e307"))
@example(EXPORT.replace('"2.0"', '"1e308"').replace('"0.0"', '"-1e308"'))
@example(NORMALISED.replace("1.14", "1e-320"))
def test_any_bytes_as_export(content):
    for reading in (Reading(), KPA):
        read = partial(read_export, reading=reading)
        specimen = read_or_refuse(read, "test.csv", files={"test.csv": content})
        if specimen is None:
            continue
        (curve,) = specimen.curves
        assert all(0 < size < 1e4 for size in (specimen.length_mm, specimen.width_mm, specimen.thickness_mm))
        assert np.isfinite([curve.protocol.time_s, curve.protocol.displacement_mm, curve.force_N]).all()
        assert (np.diff(curve.protocol.time_s) > 0).all()
        assert curve.protocol.displacement_mm.min() > -specimen.length_mm


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


def test_each_of_several_tests_in_a_file_is_a_specimen_or_a_protocol(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS + EXTENSIONS.replace("9", "8"), "bench day.csv")
    found = read_exports([path])
    assert [one.name for one in found.specimens] == ["bench_day_1", "bench_day_2"]
    assert [one.curves[0].force_N.tolist() for one in found.specimens] == [[0, 5, 9], [0, 5, 8]]
    (one,) = read_exports([path], specimen="T1").specimens
    assert [curve.name for curve in one.curves] == ["bench_day_1", "bench_day_2"]
    with pytest.raises(BadInput, match="2 tests; expected one test, or read_exports for all of them"):
        read_export(path)


def test_a_size_that_an_option_replaces_is_remarked_on(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS)
    for reading, told in (
        (Reading(length_mm=20.01), ()),
        (Reading(length_mm=5.0), ("length 5 mm by --length-mm; the file gives 20 mm",)),
        (Reading(area_mm2=4.0), ("cross-section 4 mm2 by --area-mm2; the file gives 3.142 mm2",)),
        (Reading(area_mm2=3.1416), ()),
    ):
        assert [*read_exports([path], reading=reading).remarks.values()] == ([told] if told else [])


def test_cross_sections_that_contradict_each_other_are_refused_unless_one_is_given(tmp_path):
    path = tmp_path / "a.csv"
    sizes = "Length,20,mm\nArea (mm2),12\nWidth,5,mm\nThickness,1,mm\n"
    path.write_text(f"{sizes}Time (s),Displacement (mm),Force (N)\n0,0,0\n0.5,0.1,1\n1,0.2,2\n")
    differs = "a cross-section of 12 mm2, but 5 x 1 mm is 5 mm2"
    with pytest.raises(BadInput, match=f"a.csv: gives {differs}; expected sizes that agree, or --area-mm2"):
        read_exports([path])
    imported = read_exports([path], reading=Reading(area_mm2=12.0))
    assert imported.specimens[0].area_mm2 == pytest.approx(12.0)
    assert imported.remarks == {"a/test": (f"cross-section 12 mm2 by --area-mm2; the file gives {differs}",)}


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (
            "Width,0.33\nThickness,0.16\nArea,34.06,mm2\n",
            r"cross-section of 34.06 mm2, but sizes without a unit that make",
        ),
        ("Diameter,0.5\nArea,126.7,mm2\n", r"cross-section of 126.7 mm2, but sizes without a unit that make"),
    ],
)
def test_a_cross_section_with_its_unit_is_not_replaced_by_sizes_without(tmp_path, lines, words):
    path = tmp_path / "test.csv"
    path.write_text(f"Length,20,mm\n{lines}Time (s),Disp (mm),Force (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    with pytest.raises(BadInput, match=words):
        read_exports(path)
    (specimen,) = read_exports(path, reading=Reading(area_mm2=34.06)).specimens
    assert specimen.area_mm2 == pytest.approx(34.06)


@pytest.mark.parametrize("unit", ["mm", ""])
def test_a_cross_section_of_an_ellipse_is_remarked_on(tmp_path, unit):
    path = tmp_path / "test.csv"
    sizes = f"Length,20,mm\nWidth,8,{unit}\nThickness,4,{unit}\nArea,25.13,mm2\n"
    path.write_text(f"{sizes}Time (s),Disp (mm),Force (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    found = read_exports(path)
    words = "the file gives a cross-section of 25.13 mm2, that of the bar is 32 mm2; --area-mm2"
    assert words in found.remarks["test/test"]


def test_a_size_of_zero_was_not_filled_in(tmp_path):
    path = tmp_path / "test.csv"
    sizes = "Length,20,mm\nDiameter,0.00,mm\nWidth,8,mm\nThickness,4,mm\n"
    path.write_text(f"{sizes}Time (s),Disp (mm),Force (N)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    (specimen,) = read_exports(path).specimens
    assert (specimen.width_mm, specimen.thickness_mm) == (8.0, 4.0)


def test_lengths_that_begin_far_from_the_gauge_length_are_remarked_on(tmp_path):
    path = tmp_path / "test.csv"
    titles = "Time (s),Grip to grip separation (mm),Force (N)"
    path.write_text(f"Length,20,mm\nArea,10,mm2\n{titles}\n0,50.0,0\n1,50.5,5\n2,51.0,9\n")
    words = "its lengths begin at 50 mm, a strain of 150 % of the gauge length, 20 mm"
    assert words in read_exports(path).remarks["test/test"]


def test_sizes_of_zero_are_as_if_the_file_gave_none(tmp_path):
    path = tmp_path / "test.csv"
    titles = "Time (s),Strain (%),Stress (kPa)"
    path.write_text(f"Gauge length,0,mm\nWidth,0,mm\nThickness,0,mm\n{titles}\n0,0.1,0\n1,1,5\n2,2,9\n")
    (specimen,) = read_exports(path).specimens
    assert (specimen.length_mm, specimen.area_mm2) == (1.0, 1.0)


def test_a_gauge_length_that_nobody_knows_is_said_to_be_one_millimetre(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("Time (s),Strain (1),Stress (MPa)\n0,0,0\n1,0.1,5\n2,0.2,9\n")
    told = "no gauge length: taken as 1 mm, so that displacements are strains; --length-mm"
    assert told in read_exports(path).remarks["a/test"]
    assert not any("length" in one for one in inspect(path).questions) and told in inspect(path).remarks
    path.write_text("Time (s),Stretch,Stress (MPa)\n0,1,0\n1,1.1,5\n2,1.2,9\n")
    assert not inspect(path).questions and told in inspect(path).remarks
    given = Reading(length_mm=20.0)
    assert told not in read_exports(path, reading=given).remarks.get("a/test", ())
