"""LabVIEW measurement files: each segment tells its units and times, and none of its keys is a number of a test."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sinew.runner.errors import BadInput
from sinew.tasks.data.hints import Hints
from sinew.tasks.data.recording import Recording
from sinew.tasks.data.recordings import read_recordings

FILE_HEADER = """\
LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\t{separator}
Decimal_Separator\t{decimal}
Multi_Headings\tYes
X_Columns\t{times}
Time_Pref\tRelative
Description\tGauge length 20 mm, force 20 N per volt
Date\t2026/05/11
Time\t14:32:07.5
***End_of_Header***
\t
"""
KEYS = """\
Channels\t2\t\t
Samples\t{0}\t{0}\t
Date\t2026/05/11\t2026/05/11\t
Time\t{1}\t{1}\t
Y_Unit_Label\t{2}\t{3}\t
X_Dimension\tTime\tTime\t
X_Unit_Label\t{4}\t{4}\t
X0\t{5}\t{5}\t
Delta_X\t0.05\t0.05\t
***End_of_Header***
"""
ROWS = [(0.05 * row, 0.1 * row, 0.01 * row) for row in range(12)]  # s, force, displacement


def segment(rows, *, times="One", units=("N", "mm"), second=7.5, unit="s", begin=0.0) -> str:
    """A segment that begins at 14:32 and some seconds."""
    clock = f"14:{32 + int(second // 60)}:{second % 60:06.3f}"
    head = KEYS.format(len(rows), clock, *units, unit, begin)
    if times == "Multi":  # each value stands above its channel, and nothing above its column of times
        keys = [line.split("\t") for line in head.splitlines()]
        spaced = [[key[0], key[1], "", *key[2:]] if len(key) > 2 and key[0] != "Channels" else key for key in keys]
        head = "".join("\t".join(key) + "\n" for key in spaced) + "X_Value\tForce\tX_Value\tWay\tComment\n"
        return head + "".join(f"{t:.6f}\t{f:.6f}\t{t:.6f}\t{d:.6f}\t\n" for t, f, d in rows)
    head += "X_Value\tForce\tDisplacement\tComment\n"
    return head + "".join(f"{'' if times == 'No' else f'{t:.6f}'}\t{f:.6f}\t{d:.6f}\t\n" for t, f, d in rows)


def file(folder: Path, *segments: str, times="One", separator="\t", decimal=".") -> Path:
    named = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}[separator]
    text = FILE_HEADER.format(separator="{separator}", decimal="{decimal}", times=times) + "\n".join(segments)
    text = text.replace(".", decimal) if decimal != "." else text
    text = text.replace("\t", separator).format(separator=named, decimal=decimal)
    path = folder / "test.lvm"
    path.write_text(text)
    return path


def read(path: Path, **hints) -> Recording:
    (found,) = read_recordings(path, Hints(**hints))
    return found


@pytest.mark.parametrize("times", ["One", "No", "Multi"])
@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), ("\t", ","), (";", ","), (",", ".")])
def test_times_and_units_are_those_of_the_file(tmp_path, times, separator, decimal):
    titles = {"displacement_column": "Way (mm)"} if times == "Multi" else {}
    path = file(tmp_path, segment(ROWS, times=times), times=times, separator=separator, decimal=decimal)
    found = read(path, **titles)
    np.testing.assert_allclose(found.numbers, [(t, d, f) for t, f, d in ROWS], rtol=1e-9)
    assert [column.unit for column in found.columns] == ["s", "mm", "N"]
    path = file(tmp_path, segment(ROWS, times=times, units=("kgf", "cm")), times=times)
    found = read(path, **({"displacement_column": "Way (cm)"} if times == "Multi" else {}))
    np.testing.assert_allclose(found.numbers[:, 1:], [(10 * d, 9.80665 * f) for _, f, d in ROWS], rtol=1e-9)


@pytest.mark.parametrize("times", ["One", "No", "Multi"])
@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e-3), ("min", 60.0)])
@pytest.mark.parametrize("again", [True, False])
def test_segments_are_one_test_and_their_keys_are_no_numbers(tmp_path, times, unit, factor, again):
    """Their times start again, or go on; the second begins 0.6 units of time after the first."""
    late = 0.6
    second = [(t + (0.0 if again else late), f + 2.0, d + 0.12) for t, f, d in ROWS]
    segments = (
        segment(ROWS, times=times, unit=unit, second=0.0),
        segment(second, times=times, unit=unit, second=late * factor, begin=0.0 if again else late),
    )
    titles = {"displacement_column": "Way (mm)"} if times == "Multi" else {}
    found = read(file(tmp_path, *segments, times=times), **titles)
    expected = [(t * factor, d, f) for t, f, d in (*ROWS, *((t + late, f + 2.0, d + 0.12) for t, f, d in ROWS))]
    np.testing.assert_allclose(found.numbers, expected, rtol=1e-6, atol=0.5e-3)  # clocks have milliseconds


def test_values_above_channels_only_are_theirs_too(tmp_path):
    path = file(tmp_path, segment(ROWS, times="Multi"), times="Multi")
    path.write_text(re.sub(r"(?m)^(\w+\t\S+\t)\t(\S+\t)", r"\1\2", path.read_text()))
    assert "Y_Unit_Label\tN\tmm\t" in path.read_text()
    assert [column.unit for column in read(path, displacement_column="Way (mm)").columns] == ["s", "mm", "N"]


def test_units_are_above_their_channels_though_one_has_none(tmp_path):
    path = file(tmp_path, segment(ROWS, times="Multi", units=("", "mm")), times="Multi")
    with pytest.raises(BadInput, match="no unit of the force"):
        read(path, displacement_column="Way (mm)")


@pytest.mark.parametrize(
    ("times", "old", "new", "words"),
    [
        ("One", "Delta_X\t0.05\t0.05", "Delta_X\t0.05\t0.1", "Delta_X 0.05, 0.1; expected one X0 and one Delta_X"),
        ("Multi", "0.200000\t0.4", "0.210000\t0.4", r"row \d+: channels at different times, 0.210000 and 0.200000"),
    ],
)
def test_channels_at_different_times_are_refused(tmp_path, times, old, new, words):
    path = file(tmp_path, segment(ROWS, times=times), times=times)
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(BadInput, match=words):
        read(path)


def test_a_channel_may_be_shorter(tmp_path):
    path = file(tmp_path, segment(ROWS, times="Multi"), times="Multi")
    *lines, last = path.read_text().splitlines()
    _, force, time, moved, *_ = last.split("\t")
    path.write_text("\n".join([*lines, f"\t{force}\t{time}\t{moved}\t", ""]))
    assert read(path, displacement_column="Way (mm)").numbers[-1, 0] == pytest.approx(0.55)


def test_a_pause_of_half_a_minute_is_kept(tmp_path):
    path = file(tmp_path, segment(ROWS), segment([(t, f + 2.0, d + 0.12) for t, f, d in ROWS], second=37.5))
    first, second = read_recordings(path, Hints(tables="apart"))
    assert second.numbers[0, 0] - first.numbers[0, 0] == pytest.approx(30.0)


def test_times_since_1904_have_all_their_digits(tmp_path):
    path = file(tmp_path, segment(ROWS, times="No", begin=3_660_000_000.25), times="No")
    np.testing.assert_allclose(np.diff(read(path).numbers[:, 0]), 0.05, atol=1e-5)


def test_what_only_some_program_understands_is_passed_over(tmp_path):
    special = "***Start_Special***\t\nY_Unit_Label\tkN\tm\t\nSeparator\tComma\n***End_Special***\t\n"
    path = file(tmp_path, special + segment(ROWS))
    path.write_text(path.read_text().replace("Time_Pref", f"{special}Separator_Note\tComma\nTime_Pref", 1) + special)
    assert read(path).numbers[-1] == pytest.approx([0.55, 0.11, 1.1])


def test_units_that_a_person_gives_do_not_replace_those_of_the_file(tmp_path):
    with pytest.raises(BadInput, match="unit 'kgf', but --force-unit says N"):
        read(file(tmp_path, segment(ROWS, units=("kgf", "mm"))), force_unit="N")
    with pytest.raises(BadInput, match="unit 'Volt' is that of a sensor's signal, no force"):
        read(file(tmp_path, segment(ROWS, units=("Volt", "mm"))), force_unit="N")
    other = segment([(t + 0.6, f, d) for t, f, d in ROWS], units=("N", "um"), second=8.1)
    with pytest.raises(
        BadInput, match=r"row \d+: a segment of 'Time .*, but .* above; expected segments with the same"
    ):
        read(file(tmp_path, segment(ROWS), other))
    with pytest.raises(BadInput, match="no unit of the force"):
        read(file(tmp_path, segment(ROWS, units=("", "mm"))))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "***End_of_Header***\n\t\n",
            "\t\n",
            "'X_Value Force Displacement Comment' behind an empty line or the header",
        ),
        ("Separator\tTab", "Separator\tPipe", "'Separator Pipe, .*'; expected a LabVIEW measurement file with"),
        ("X_Columns\tNo", "X_Columns\tAll", "X_Columns All"),
        ("Delta_X\t0.05\t0.05", "Delta_X\t0.05\t0.1", "X0 0.0, 0.0 and Delta_X 0.05, 0.1; expected one X0"),
        ("Delta_X\t0.05\t0.05\t\n", "", "X0 0.0, 0.0 and Delta_X ; expected one X0 and one Delta_X"),
        ("Time\t14:32:07.500\t", "Time\t14:32:07.900\t", "a segment whose channels begin 0.4 s apart"),
        ("\t0.500000\t0.050000\t\n", "\t0.500000\t0.050000\t\n\t\t\t\n", "behind an empty line or the header"),
        ("X_Value\tForce", "Force\tForce", "'Force' as first title; expected X_Value"),
    ],
)
def test_files_that_make_no_sense_are_refused_in_one_line(tmp_path, old, new, words):
    path = file(tmp_path, segment(ROWS, times="No"), times="No")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(BadInput, match=words):
        read(path)


@given(cut=st.integers(0, 1000), length=st.integers(0, 40), odd=st.text(max_size=6))
def test_any_damage_is_read_or_refused_in_one_line(tmp_path_factory, cut, length, odd):
    folder = tmp_path_factory.mktemp("damaged")
    path = file(folder, segment(ROWS, times="No"), times="No")
    text = path.read_text()
    path.write_text(text[:cut] + odd + text[cut + length :], "utf-8", "replace")
    try:
        read_recordings(path, Hints())
    except BadInput as refused:
        assert "\n" not in str(refused)
