"""What `sinew import` says of files that it cannot read or join, and how it names what it can."""

from pathlib import Path

import pytest

from sinew.runner.errors import BadInput
from sinew.tasks.data.exports import Reading, read_export, read_exports
from sinew.tasks.data.hints import Hints
from tests.effort import at_most
from tests.tasks.data.test_exports import BLOCK, EXTENSIONS, exported

STRESSES = "Pa, kPa, MPa, GPa, N/cm2, kgf/mm2, kgf/cm2, bar, mbar, psi, ksi"
TIMES = "s, ms, min, us, h"
OTHER = EXTENSIONS.replace("9", "8")
NEGATIVE = EXTENSIONS.replace("5", "-5").replace("9", "-9")
NEGATIVE_OTHER = NEGATIVE.replace("-9", "-8")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"time": "week"}, f"--time: 'week'; expected one of {TIMES}"),
        ({"stress": "N"}, f"--stress: 'N'; expected one of {STRESSES}"),
        (
            {"stress": "kPa", "hints": Hints(force_unit="N")},
            "--stress: kPa, but --force-unit says 'N'; expected one and the same unit",
        ),
        (
            {"time": "s", "hints": Hints(time_unit="ms")},
            "--time: s, but --time-unit says 'ms'; expected one and the same unit",
        ),
        ({"reference": 0.0}, "--reference: 0; expected above 0 and below 10"),
        ({"reference": 10.0}, "--reference: 10; expected above 0 and below 10"),
        ({"length_mm": -1.0}, "--length-mm: -1; expected at least 1e-06 and below 10000 mm"),
        ({"length_mm": 1e4}, "--length-mm: 10000; expected at least 1e-06 and below 10000 mm"),
        ({"area_mm2": 0.0}, "--area-mm2: 0; expected at least 1e-12 and below 1e+08 mm2"),
        ({"area_mm2": 1e8}, "--area-mm2: 1e+08; expected at least 1e-12 and below 1e+08 mm2"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_so_is_said(given, words):
    with pytest.raises(BadInput) as refused:
        Reading(**given)
    assert str(refused.value) == words


def test_units_may_be_given_twice_if_they_are_the_same():
    hints = Hints(time_unit="ms", force_unit="kPa", force_column="F")
    assert Reading(stress="kPa", time="ms", hints=hints).all_hints == hints
    assert Reading(hints=hints).all_hints == hints
    assert Reading(stress="MPa", time="s", hints=Hints(force_column="F")).all_hints == Hints(
        time_unit="s", force_unit="MPa", force_column="F"
    )


def refused_of_one(folder: Path, second: str, name: str = "second.csv", **more) -> str:
    paths = [exported(folder, BLOCK + EXTENSIONS, "first.csv"), exported(folder, second, name)]
    with pytest.raises(BadInput) as refused:
        read_exports(paths, **{"specimen": "s1", **more})
    return str(refused.value).replace(f"{folder}/", "")


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        (
            BLOCK.replace("20", "30") + OTHER, "second.csv",
            "second.csv: a bar of 30 mm, 3.14159 mm2, but 20 mm, 3.14159 mm2 in first.csv; "
            "expected files of one specimen",
        ),
        (
            BLOCK.replace("r,2", "r,4") + OTHER, "second.csv",
            "second.csv: a bar of 20 mm, 12.5664 mm2, but 20 mm, 3.14159 mm2 in first.csv; "
            "expected files of one specimen",
        ),
        (
            BLOCK + EXTENSIONS, "second.csv",
            "second.csv: has the numbers of first.csv; expected each protocol of a specimen once",
        ),
        (
            BLOCK + OTHER, "FIRST.csv",
            "FIRST.csv: has protocol FIRST, as first.csv; expected each protocol of a specimen once",
        ),
        (
            BLOCK + OTHER, "total.csv",
            "total.csv: its name cannot be used for a protocol: 'total'; expected a letter or digit in front, and not "
            "'total'",
        ),
    ],
)  # fmt: skip
def test_why_files_are_not_of_one_specimen_is_said(tmp_path, content, name, words):
    assert refused_of_one(tmp_path, content, name) == words


def test_names_that_are_given_are_checked(tmp_path):
    allowed = "expected letters, digits, '_', '-', '+' and '.'"
    assert refused_of_one(tmp_path, BLOCK + OTHER, specimen="a b") == f"--specimen: 'a b'; {allowed}"
    assert refused_of_one(tmp_path, BLOCK + OTHER, protocol="a/b") == f"--protocol: 'a/b'; {allowed}"
    assert refused_of_one(tmp_path, BLOCK + OTHER, protocol="pull") == (
        "--protocol: one name for 2 files of one specimen; expected names of files as protocols"
    )
    assert "second.csv: a duplicate of specimen first" in refused_of_one(tmp_path, BLOCK + EXTENSIONS, specimen=None)


@pytest.mark.parametrize(("name", "specimen"), [("-x", "x"), ("동일고무_2", "2"), ("力学", "specimen")])
def test_names_in_other_letters_become_plain(tmp_path, name, specimen):
    path = exported(tmp_path, BLOCK + EXTENSIONS).rename(tmp_path / f"{name}.csv")
    assert [one.name for one in read_exports([path]).specimens] == [specimen]


def test_one_file_may_have_a_protocol_of_any_name(tmp_path):
    path = exported(tmp_path, BLOCK + EXTENSIONS)
    (specimen,) = read_exports([path], specimen="s1", protocol="pull").specimens
    assert (specimen.name, specimen.curves[0].name) == ("s1", "pull")
    (specimen,) = read_exports([path]).specimens
    assert (specimen.name, specimen.curves[0].name) == ("ramp", "test")


def test_several_files_are_several_specimens(tmp_path):
    paths = [exported(tmp_path, BLOCK + EXTENSIONS, "one 1.csv"), exported(tmp_path, BLOCK + OTHER, "two+2.csv")]
    found = read_exports(paths, protocol="pull")
    assert [(one.name, one.curves[0].name) for one in found.specimens] == [("one_1", "pull"), ("two+2", "pull")]
    assert (found.specimens[0].length_mm, found.specimens[0].width_mm) == (20.0, 1.772453851)
    assert (found.spreads, found.remarks) == ({}, {})


def test_files_of_one_specimen_have_its_sizes_and_remarks(tmp_path):
    block = "Length,20,mm\nWidth,2,mm\nThickness,3,mm\n"
    paths = [exported(tmp_path, block + table, f"{at}.csv") for at, table in enumerate((NEGATIVE, NEGATIVE_OTHER))]
    found = read_exports(paths, specimen="s1")
    (specimen,) = found.specimens
    assert (specimen.length_mm, specimen.width_mm, specimen.thickness_mm) == (20.0, 2.0, 3.0)
    assert sorted(found.remarks) == ["s1/0", "s1/1"]
    assert "forces are negative" in found.remarks["s1/1"][0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            EXTENSIONS,
            "Length: missing in the lines above the table; expected a length with its unit, or --length-mm",
        ),
        (
            "Length,20,mm\n" + EXTENSIONS,
            "Width: missing in the lines above the table; expected a length with its unit, or --area-mm2",
        ),
        (
            "Length,20,mm\nWidth,2,mm\n" + EXTENSIONS,
            "Thickness: missing in the lines above the table; expected a length with its unit, or --area-mm2",
        ),
        (
            "Length,20,mm\nDiameter,thin,mm\n" + EXTENSIONS,
            "Diameter: 'thin mm'; expected a number at least 1e-06 and below 10000 mm and a unit such as mm, or "
            "--area-mm2",
        ),
        (
            BLOCK.replace("20", "ten") + EXTENSIONS,
            "Length: 'ten mm'; expected a number at least 1e-06 and below 10000 mm and a unit such as mm, or "
            "--length-mm",
        ),
    ],
)
def test_a_size_that_is_missing_is_said_with_the_option_that_gives_it(tmp_path, content, words):
    path = exported(tmp_path, content)
    with pytest.raises(BadInput) as refused:
        read_export(path)
    assert str(refused.value) == f"{path}: {words}"


def test_a_label_with_hold_makes_a_relaxation_and_a_value_does_not(tmp_path):
    for line, name in (
        ("Test : HOLD value,0.05,mm/mm\n", "relaxation"),
        ("Operator,hold\n", "test"),
        ("Holder : Anna,\n", "test"),
        (",\nhold time,3\n", "relaxation"),
        ("Zero velocity threshold,3\n", "test"),
    ):
        assert read_export(exported(tmp_path, line + BLOCK + EXTENSIONS)).curves[0].name == name


def test_a_length_that_is_recorded_begins_with_the_gauge_or_that_of_the_header(tmp_path):
    table = "Time (s),Length (mm),Load (N)\n0,12,0\n1,12.5,5\n2,13,9\n"
    for header, length, first in (("", 12.0, 0.0), ("Length,10,mm\n", 10.0, 2.0)):
        specimen = read_export(exported(tmp_path, header + "Diameter,2,mm\n" + table))
        assert specimen.length_mm == length
        assert specimen.curves[0].protocol.displacement_mm[0] == first


def test_the_side_of_a_bar_is_rounded_to_what_can_be_measured(tmp_path):
    bar = read_export(exported(tmp_path, BLOCK + EXTENSIONS), reading=Reading(area_mm2=2.0))
    assert (bar.width_mm, bar.thickness_mm) == (1.414213562, 1.414213562)


LONG = {
    "title": "{}displacement (mm)",
    "unit": "displacement ({}mm)",
    "between": "displacement{}(mm)",
    "size": "displacement (mm)",
}


@pytest.mark.parametrize("piece", [" ", "\t", "(", "(a", "1", " mm", "a=", ": ", "\u2003", "'"])
@pytest.mark.parametrize("place", LONG)
def test_a_line_of_nearly_100_000_characters_takes_no_time(tmp_path, place, piece):
    """Patterns that try every way to divide spaces would take hours: read or refused, in seconds of a processor."""
    long = (piece * 100_000)[:99_900]  # longer lines are refused unread
    size = long if place == "size" else " "
    titles = f"time (s),{LONG[place].format(long)},force (N)"
    path = tmp_path / "a.csv"
    path.write_text(f"length:{size}10 mm\nwidth: 4 mm\nthickness: 1 mm\n{titles}\n0,0,0\n1,1,5\n2,2,9\n")
    with at_most(5):
        try:
            read_export(path)
        except BadInput as error:
            assert "\n" not in str(error)
            assert len(str(error)) < 2000
