"""Units and factors that lines above a table tell."""

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recordings import read_recordings
from sinew.tasks.data.remarks import remarks
from tests.tasks.data.one_test_file import read


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("Load scale factor: 1000\n", "'Load scale factor: 1000'"),
        ("Force,scaling,0.5\n", "'Force scaling 0.5'"),
        ("Scale factor load: 1000\n", "'Scale factor load: 1000'"),
        ("Force multiplier,1000\n", "'Force multiplier 1000'"),
        ("Force (x1000)\n", "'Force (x1000)'"),
        ("Force scale factor: 1,000.0\n", "'Force scale factor: 1 000.0'"),
        ("Calibration factor: 2.5\n", "'Calibration factor: 2.5'"),
        ("Load scale factor: 1.0\n", None),
        ("Load cell: 1000 N\n", None),
        ("Safety factor: 3\n", None),
    ],
)
def test_a_factor_above_the_table_is_told(tmp_path, line, told):
    found = remarks(read(tmp_path, above=line))
    assert found == ([] if told is None else [f"the file gives {told}; numbers are read as they stand, without it"])


def test_a_unit_above_the_table_may_not_contradict_the_title(tmp_path):
    with pytest.raises(BadInput, match="the force has two units: 'N' and 'kN'"):
        read(tmp_path, above="Force unit: kN\n")
    assert read(tmp_path, above="Force unit: N\n").numbers[-1, 2] == 50.0
    found = read(tmp_path, above="Force unit: kN\n", titles="Time (s),Extension (mm),Force")
    assert (found.numbers[-1, 2], found.load.unit) == (50_000.0, "kN")


@pytest.mark.parametrize("line", ["Load unit: kN", "Unit of force: kN", "Force units (kN)", "Extension unit: um"])
def test_units_are_compared_by_what_a_column_is(tmp_path, line):
    with pytest.raises(BadInput, match="has two units: "):
        read(tmp_path, above=f"{line}\n", titles="Time (s),Displacement (mm),Force (N)")


@pytest.mark.parametrize(
    ("above", "more", "told"),
    [
        ("", ",Flexure stress (MPa)", "'Flexure stress (MPa)'"),
        ("Support span,60,mm\n", "", "'Support span 60 mm'"),
        ("Length,20,mm\nSupport span,60,mm\n", "", ""),
        ("Length,20,mm\nSupport span,60,mm\nEssai de flexion\n", "", "'Essai de flexion'"),
        ("Essai de flexion\n", "", "'Essai de flexion'"),
        ("Tension\n", ",Tensile stress (MPa)", ""),
    ],
)
def test_a_bending_is_told(tmp_path, above, more, told):
    path = tmp_path / "a.csv"
    rows = "".join(f"{i},{i / 10},{i * i}{',1' if more else ''}\n" for i in range(9))
    path.write_text(f"{above}Time (s),Extension (mm),Load (N){more}\n{rows}")
    lines = [line for line in remarks(read_recordings(path, Hints())[0]) if line.startswith("a bending test")]
    assert [line.split(":")[0] for line in lines] == ([f"a bending test, by {told}"] if told else [])
